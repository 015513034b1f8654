"""A trained policy is scored by the benchmark as every other controller is."""

import csv

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("torch")

import torch

from baselines.learned.policy import SHIPPED, Network, Policy
from benchmarks.tracking import controllers as learned
from benchmarks.tracking.controllers import task_fingerprint
from benchmarks.tracking.evaluation import evaluate
from benchmarks.tracking.run import benchmark
from benchmarks.tracking.selection import select
from rdpi_gym.cli import main
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.plant import named_plant
from rdpi_gym.support.errors import InputError

P5 = named_plant("P5")
TS_S = 4e-4
BASELINE = "classical-reference-rate"


def save(folder, weight=0.0):
    """Keep a policy that corrects a baseline by a constant: by nothing where the weight is 0."""
    layout = ObservationLayout.for_plant(P5, TS_S, preview=2, action="correction")
    actor = Network((layout.size, 1), "Tanh", "Hardtanh").build()
    with torch.no_grad():
        actor[0].weight.zero_()
        actor[0].bias.fill_(weight)
    Policy(layout, 0, 100.0, 0.02, actor, BASELINE).save(folder)
    return f"learned:{folder}"


def test_one_that_corrects_nothing_scores_as_the_baseline_that_it_corrects(tmp_path):
    name = save(tmp_path / "idle")
    out = tmp_path / "out"
    asked = [
        "bench", "--controllers", BASELINE, "--controller", name, "--references", "triangle",
        "--plants", "P5", "--seeds", "1", "--jobs", "1", "--out", str(out),
    ]  # fmt: skip
    assert main(asked) == 0
    with (out / "leaderboard.csv").open(encoding="utf-8") as file:
        rows = {(row["controller"], float(row["ts_s"])): row for row in csv.DictReader(file)}
    own, base = rows[name, TS_S], rows[BASELINE, TS_S]
    assert own["status"] == base["status"] == "ok"
    # Its observations are float32.
    assert float(own["rmse_um"]) == pytest.approx(float(base["rmse_um"]), rel=1e-3)
    # It runs at no other sampling time: there it has no rows, and the ranking is without it.
    assert [ts for who, ts in rows if who == name] == [TS_S]
    ranked = pd.read_csv(out / "ranking.csv")
    assert name not in set(ranked.loc[ranked["ts_s"].isna(), "controller"])
    # Where it runs it is ranked beside the others.
    there = ranked[np.isclose(ranked["ts_s"], TS_S)].set_index("controller")
    assert there.loc[name, "rmse_percent"] == pytest.approx(float(own["rmse_percent"]))
    assert there.loc[BASELINE, "rows"] == 1
    text = (out / "leaderboard.md").read_text(encoding="utf-8")
    assert "## Ranking at Ts = 0.0004 s" in text
    assert (
        f"Ranked at Ts = 0.0004 s only, where they were trained and can run: {name}; on P5." in text
    )
    assert "Ranking at Ts = 0.0004 s" in (out / "report.html").read_text(encoding="utf-8")


def test_the_ranking_is_the_same_with_policies_and_without(tmp_path):
    name = save(tmp_path / "idle")
    found = []
    for names in (["none", "pi"], ["none", "pi", name]):
        selection = select(names, ["P5"], ["triangle"], None, [0, 1])
        outcome = benchmark(selection, tmp_path / str(len(names)), jobs=1)
        found.append(evaluate(selection, outcome).ranking.drop(columns="microseconds_per_sample"))
    pd.testing.assert_frame_equal(*found)


def test_its_rows_belong_to_its_weights(tmp_path):
    name = save(tmp_path / "mine")
    before = task_fingerprint(name, P5)
    save(tmp_path / "mine")
    assert task_fingerprint(name, P5) == before
    save(tmp_path / "mine", weight=0.5)
    assert task_fingerprint(name, P5) != before


def test_the_given_sampling_times_are_kept_and_a_policy_of_another_is_refused(tmp_path):
    name = save(tmp_path / "mine")
    # policies alone are ranked where they were trained
    stages = select([name], ["P5", "picma"], ["triangle"]).stages
    assert [(stage.plant.name, stage.ts_s) for stage in stages] == [("P5", (TS_S,))]
    (stage,) = select([name], ["P5"], ["sine"], [1e-3, TS_S], [0]).stages
    assert stage.every_ts_s == (TS_S, 1e-3)
    for plant, times in (("P5", [1e-3, 2e-4]), ("picma", None)):
        with pytest.raises(InputError, match=r"trained at Ts = 0\.0004 s, at which none") as error:
            select([name, "none"], [plant], ["sine"], times, [0])
        assert "give --ts 0.0004" in str(error.value)


def test_a_folder_without_a_policy_and_one_that_was_cut_off_are_refused(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["bench", "--controller", f"learned:{tmp_path}", "--out", str(out)]) == 2
    line = capsys.readouterr().err
    assert "no policy is at" in line
    assert line.count("\n") == 1
    assert not out.exists()
    name = save(tmp_path / "cut")
    weights = tmp_path / "cut" / "weights.pt"
    weights.write_bytes(weights.read_bytes()[:100])
    with pytest.raises(InputError, match="cut off"):
        select([name], ["P5"])


def test_shipped_policies_are_scored_by_default_and_left_out_without_torch(tmp_path, monkeypatch):
    assert learned.POLICIES == SHIPPED
    save(tmp_path / "mine")
    monkeypatch.setattr(learned, "POLICIES", tmp_path)
    monkeypatch.setattr("baselines.learned.policy.SHIPPED", tmp_path)
    assert "learned:mine" in select(None, ["P5"]).controllers
    before = task_fingerprint("learned:mine", P5)
    save(tmp_path / "mine", weight=0.5)
    assert task_fingerprint("learned:mine", P5) != before
    monkeypatch.setattr(learned, "find_spec", lambda name: None)
    without = select(None, ["P5"])
    assert "learned:mine" not in without.controllers
    assert without.notes == ("Left out, since torch is not installed (rdpi-gym[rl]): mine.",)
