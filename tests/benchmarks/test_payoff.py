"""The payoff: beliefs are kept and hold, the error falls, and the tables say by how much."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.payoff import __main__ as command
from benchmarks.payoff import scores
from benchmarks.payoff.report import (
    payoff_part,
    payoff_picture,
    payoff_section,
    payoff_summary,
    payoff_text,
    summary_view,
)
from benchmarks.payoff.scores import (
    BELIEFS,
    HIDDEN_PLANTS,
    HiddenPlant,
    make_beliefs,
    stored_beliefs,
)
from benchmarks.tracking import selection
from benchmarks.tracking.evaluation import COLUMNS
from rdpi_gym.cli import main
from rdpi_gym.face import benchmarking
from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import CATALOGUE, forms_of
from rdpi_gym.support.errors import InputError
from tests.looping import over

LAG = HIDDEN_PLANTS[2]
TABLES = Path(__file__).parents[2] / "studies" / "results" / "payoff"


@over("hidden", HIDDEN_PLANTS)
def test_the_beliefs_of_this_release_name_what_is_hidden(hidden):
    found = stored_beliefs(hidden)
    assert tuple(found) == BELIEFS
    assert found["bare"].effects == found["fitted"].effects == ()
    assert found["true"].effects == hidden.hidden
    discovered = {effect.name: effect.values for effect in found["discovered"].effects}
    assert set(discovered) == {effect.name for effect in hidden.hidden}
    for effect in hidden.hidden:
        values = discovered[effect.name]
        if effect.name == "asymmetry":  # only c / Y is seen
            values = {"coefficient": values["coefficient"] * effect.span_um / values["span_um"]}
        for name, value in values.items():
            assert value == pytest.approx(effect.values[name], rel=0.01)


def test_the_table_of_this_release_is_whole_and_the_error_falls():
    table = pd.read_csv(TABLES / "payoff.csv")
    assert tuple(table.columns) == scores.COLUMNS
    assert len(table) == len(HIDDEN_PLANTS) * len(scores.CONTROLLERS) * len(BELIEFS) * 6
    summary = payoff_summary(table)
    assert set(summary["plant"]) == {hidden.name for hidden in HIDDEN_PLANTS}
    # compensation by a discovered belief is as good as by the truth
    causal = summary[summary["controller"] != scores.PREVIEW_INVERSION]
    assert (causal["discovered"] < 1.05 * causal["true"]).all()
    falls = summary[["fall_from_bare", "fall_from_fitted"]].to_numpy()
    assert np.nanmin(falls) > 1.3
    # a feedback that does not know of a resonance diverges
    lost = summary.loc[summary["diverged"] != "", ["plant", "controller", "diverged"]]
    assert set(lost["controller"]) == {"pi-extended-inverse"}
    assert all("resonance" in plant for plant in lost["plant"])
    assert set(lost["diverged"]) == {"bare, fitted"}


def guesses():
    """Beliefs that cost nothing: the truth in place of what a diagnosis finds."""
    return {"bare": P10, "fitted": P10, "discovered": LAG.plant, "true": LAG.plant}


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    out = tmp_path_factory.mktemp("payoff")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scores, "CONTROLLERS", ("extended-inverse", scores.PREVIEW_INVERSION))
        patch.setattr(scores, "_WANTED", (("sine", 50.0), ("sine", 100.0)))
        yield out, scores.payoff_table({LAG: guesses()}, out)


def test_the_error_falls_with_the_belief(small):
    keys = ["controller", "belief", "reference", "frequency_hz"]
    table = small[1].set_index(keys).sort_index()
    assert (table["status"] == "ok").all()
    assert len(table) == 16
    for controller, fall in (("extended-inverse", 10.0), (scores.PREVIEW_INVERSION, 100.0)):
        rows = table.loc[controller]
        assert rows.loc[("true", "sine", 50.0), "fall"] > fall
        assert (rows.loc["bare", "fall"] == 1.0).all()
        assert rows.loc["true", "rmse_um"].tolist() == rows.loc["discovered", "rmse_um"].tolist()
    assert (table.loc[(scores.PREVIEW_INVERSION, "true"), "optimality_gap"] == 1.0).all()


def test_finished_rows_are_kept_and_those_of_another_belief_set_aside(small, monkeypatch):
    out, table = small
    calls = []
    original = scores.run_task
    monkeypatch.setattr(scores, "run_task", lambda task: calls.append(task) or original(task))
    again = scores.payoff_table({LAG: guesses()}, out)
    pd.testing.assert_frame_equal(again, table)
    assert calls == []
    changed = guesses() | {"fitted": replace(P10, offset_um=0.5)}
    scores.payoff_table({LAG: changed}, out)
    assert {(task.controller, task.name) for task in calls} == {
        ("extended-inverse", "fitted"),
        (scores.PREVIEW_INVERSION, "fitted"),
    }


def test_tables_page_and_picture_say_what_diverged(small):
    table = small[1].copy()
    lost = (table["controller"] == scores.PREVIEW_INVERSION) & (table["belief"] == "bare")
    table.loc[lost, "status"] = "diverged: the error is larger than that of standing still"
    summary = payoff_summary(table)
    oracle = summary[summary["controller"] == scores.PREVIEW_INVERSION].iloc[0]
    assert oracle["diverged"] == "bare"
    assert np.isnan(oracle["bare"])
    assert summary_view(summary).loc[1, "bare"] == "diverged"
    part = table[(table["controller"] == "extended-inverse") & (table["belief"] == "true")]
    mean = np.exp(np.log(part["rmse_percent"]).mean())
    assert summary.loc[0, "true"] == pytest.approx(mean)
    for text in (payoff_text(table), payoff_part(table)):
        assert "| P10 with creep and sensor_lag | preview-inversion | diverged |" in text
    assert payoff_picture(summary).startswith(b"\x89PNG")
    panels = payoff_section(table).figure.panels
    notes = [mark.text for panel in panels for mark in panel.marks if hasattr(mark, "text")]
    assert "bare: diverged" in notes
    assert set(COLUMNS) < set(table.columns)


def test_a_whole_benchmark_shows_the_payoff(small, tmp_path, monkeypatch):
    few = selection.select(["none"], ["P5"], ["sine"], [1e-3], [0])
    monkeypatch.setattr(benchmarking, "select", lambda *args, **options: few)
    asked = []
    monkeypatch.setattr(
        scores, "payoff_table", lambda found, out, **options: asked.append(found) or small[1]
    )
    assert main(["bench", "--out", str(tmp_path), "--jobs", "1"]) == 0
    assert list(asked[0]) == list(HIDDEN_PLANTS)
    table = pd.read_csv(tmp_path / "leaderboard.csv")
    assert tuple(table.columns) == COLUMNS
    rows = table[table["plant"] == LAG.name]
    assert set(rows["belief"]) == set(BELIEFS)
    assert len(table) == len(rows) + 4
    assert "## What it pays to know the effect" in (tmp_path / "leaderboard.md").read_text()
    assert "What it pays to know the effect" in (tmp_path / "report.html").read_text()
    # a part of the benchmark does not
    assert main(["bench", "--out", str(tmp_path), "--jobs", "1", "--plants", "P5"]) == 0
    assert len(asked) == 1
    assert len(pd.read_csv(tmp_path / "leaderboard.csv")) == 4


def test_beliefs_are_made_once_and_anew_for_other_records(tmp_path, monkeypatch):
    calls = []

    def measured(dataset, base, seed):
        calls.append(seed)
        assert len(dataset.records) == 16
        return {"fitted": base, "discovered": LAG.plant}

    monkeypatch.setattr(scores, "_measured", measured)
    monkeypatch.setattr(scores, "simulate_dataset", lambda truth: _Records(truth))
    found = make_beliefs(LAG, tmp_path)
    assert found["discovered"].effects == LAG.hidden
    assert make_beliefs(LAG, tmp_path) == found
    assert stored_beliefs(LAG, tmp_path) == found
    assert calls == [0]
    monkeypatch.setattr(scores, "study_fingerprint", lambda: "changed")
    make_beliefs(LAG, tmp_path)
    make_beliefs(LAG, tmp_path, seed=3)
    assert calls == [0, 0, 3]
    with pytest.raises(InputError, match="holds no belief about P10 with creep and sensor_lag"):
        stored_beliefs(LAG, tmp_path)  # those files are of seed 3 now
    for path in tmp_path.iterdir():
        assert json.loads(path.read_text())["format"] == "rdpi-plant"


class _Records:
    def __init__(self, truth):
        assert truth.hidden == LAG.hidden
        self.records = truth.experiments()


def test_bad_input_is_one_line_and_status_2(capsys):
    for arguments, message in (
        (["--seed", "-1"], "--seed is -1; give 0 or more"),
        (["--jobs", "0"], "--jobs is 0; give the number of processes"),
        (["--out", __file__], "is a file; give a folder"),
    ):
        assert command.main(arguments) == 2, arguments
        error = capsys.readouterr().err
        assert message in error, arguments
        assert error.count("\n") == 1, arguments


def test_a_plant_with_another_form_has_a_name_and_files_of_its_own():
    lags = [HiddenPlant((kind(),)) for kind in forms_of(CATALOGUE["sensor_lag"])]
    assert len({lag.slug for lag in lags}) == len({lag.name for lag in lags}) == len(lags)
    assert lags[1].slug == "p10-sensor_lag-second-order"
