"""The benchmark's cases run, count the bytes they must move, and what is committed agrees."""

from pathlib import Path

import pandas as pd
import pytest
import torch

from studies.torch_speed import CASES, RESULTS, least_bytes

LANES = 32
# P10: 10 plays read and written in float32; command, rate and displacement in float64.
STATE = 2 * (10 * 4 + 2 * 8) + 8 + 8
# Weights and thresholds in float32, a_0 and δ2 in float64.
PARAMETERS = 2 * 10 * 4 + 2 * 8


@pytest.mark.parametrize("case", CASES)
def test_cases_run_and_state_what_a_step_must_move(case: tuple[str, str]) -> None:
    runs, moved = CASES[case](LANES, torch.device("cpu"))
    for name, run in runs.items():
        if "compiled" not in name:
            run()
    once_for_all = moved % LANES  # what the lanes share
    per_lane = moved // LANES
    if case == ("plant", "shared"):
        assert per_lane == STATE + (PARAMETERS + 16) // LANES
    elif case == ("plant", "per lane"):
        assert per_lane == STATE + PARAMETERS
    else:
        # Nine samples of the reference read, eleven numbers shown, action and reward in float32;
        # displacement and error written, last command and count of clipped steps read and written.
        # The displacement passes from plant to observation without memory, the command likewise.
        assert per_lane == STATE - 16 + PARAMETERS + (9 + 11 + 2) * 4 + (2 + 4) * 8
    assert once_for_all < LANES


def test_bytes_of_tensors() -> None:
    a, b = torch.zeros(3, dtype=torch.float64), torch.zeros(2)
    assert least_bytes([a], [b]) == 3 * 8 + 2 * 2 * 4


def test_committed_agreement_is_within_a_millionth_of_the_stroke() -> None:
    table = pd.read_csv(RESULTS / "cpu-agreement.csv")
    exact = ~table["plant"].str.contains("rounded")
    assert exact.sum() == 3
    assert (table.loc[exact, "plays in float32"] < 1e-6).all()
    assert (table.loc[~exact, "plays in float32"] > 1e-6).all()


def test_the_page_quotes_the_committed_figures() -> None:
    page = Path(__file__).parents[2] / "docs" / "torch-plant.md"
    speed = pd.read_csv(RESULTS / "cpu.csv", dtype=str)
    speed = speed[speed["parameters"] == "per lane"].set_index(
        ["workload", "lanes", "implementation"]
    )
    speed = speed.sort_index()
    rows = [line.strip("| ").split(" | ") for line in page.read_text().splitlines()]
    quoted = [row for row in rows if row[0] in ("bare plant", "whole step")]
    assert len(quoted) == 8
    for workload, lanes, numba, plain, compiled, share in quoted:
        measured = speed.loc[("plant" if workload == "bare plant" else "tracking", lanes)]
        steps = measured["steps_per_s"]
        assert numba == steps["numba (float64, one core)"]
        assert plain == steps["torch"]
        assert (compiled, share) == tuple(
            measured.loc["torch compiled", ["steps_per_s", "share_of_limit"]]
        )
    agreed = pd.read_csv(RESULTS / "cpu-agreement.csv", dtype=str)
    for row in agreed[["plant", "plays in float32", "plays in float64"]].to_numpy().tolist():
        assert row in rows
