"""The study of trained agents, tiny: every stage, resumption, and the laws of its summary."""

import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("stable_baselines3")

from rdpi_gym.support.errors import InputError
from studies.agents import scores, training
from studies.agents.__main__ import main
from studies.agents.scores import GAP, GROUPS, with_literal
from studies.agents.tables import estimate, interquartile_mean, summarise
from studies.agents.training import FULL, QUICK, all_trainings
from tests.looping import over


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("agents")
    assert main(arguments(made)) == 0
    return made


def arguments(made, stage="all"):
    folders = ["--out", str(made / "out"), "--runs", str(made / "runs")]
    return ["--quick", "--jobs", "1", "--stage", stage, *folders]


def test_agents_stand_beside_the_compensators_group_by_group(folder):
    table = pd.read_csv(folder / "out" / "scores.csv")
    assert tuple(table.columns) == scores.COLUMNS
    names = {agent.name for agent in QUICK.agents} | set(QUICK.rivals)
    keys = ["contestant", "world", "plant_seed"]
    assert len(table) == len(names) * len(GROUPS) * QUICK.plants
    assert not table.duplicated(keys).any()
    assert set(table.loc[table["kind"] == "agent", "training_seed"]) == set(QUICK.seeds)
    assert table.loc[table["kind"] != "agent", "training_seed"].isna().all()
    summary = pd.read_csv(folder / "out" / "summary.csv")
    assert set(summary["contestant"]) == names
    assert len(summary) == len(names) * (len(GROUPS) + 1)
    best = summary[summary["contestant"] == summary["best"]]
    assert (best["rmse_ratio"] == 1.0).all()
    assert (best["kind"] == "feedforward").all()
    # An agent that has learned nothing and corrects a compensator is near it.
    near = summary.loc[summary["contestant"] == "ppo-correction", "rmse_ratio"]
    assert near.between(0.8, 1.6).all()
    assert "## Plants: all groups" in (folder / "out" / "agents.md").read_text()
    trained = pd.read_csv(folder / "out" / "trainings.csv")
    assert (trained["seconds"] > 0).all()
    assert (trained["timesteps"] == QUICK.timesteps).all()


def test_every_domain_of_the_gap_stands_beside_its_literal_twin(folder):
    gap = pd.read_csv(folder / "out" / "gap.csv")
    assert list(gap["domain"].unique()) == list(QUICK.domains)
    ratio = gap["literal_rmse_percent"] / gap["rmse_percent"]
    np.testing.assert_allclose(ratio, gap["literal_ratio"], rtol=1e-4)
    rows = pd.read_csv(folder / "out" / "gap-scores.csv")
    assert set(rows["world"]) == {w.name for name in QUICK.domains for w in with_literal(GAP[name])}


def test_what_is_finished_is_not_done_again(folder, monkeypatch, capsys):
    written = (folder / "out" / "scores.csv").read_bytes()

    def refuse(case):
        raise AssertionError(f"done again: {case}")

    monkeypatch.setattr(training, "train_one", refuse)
    monkeypatch.setattr(scores, "score_run", refuse)
    assert main(arguments(folder)) == 0
    assert capsys.readouterr().out.startswith("0 trained now, 2 in all")
    assert (folder / "out" / "scores.csv").read_bytes() == written


def test_an_interrupted_training_goes_on_and_a_policy_alone_is_finished(folder, tmp_path):
    runs = tmp_path / "runs"
    shutil.copytree(folder / "runs", runs)
    one = all_trainings(QUICK, runs)[0]
    # Where it was trained is no option: it may be moved.
    assert one.is_finished()
    curve = one.folder / "training.csv"
    curve.write_text("".join(curve.read_text().splitlines(keepends=True)[:-1]))
    assert not one.is_finished()
    with pytest.raises(InputError, match="other options"):
        all_trainings(replace(QUICK, lanes=8), runs)[0].is_finished()
    for path in one.folder.iterdir():
        if path.name != "policy":
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert one.is_finished()
    assert one.row()["seconds"] is None


@over("stage", ["score", "gap", "curves"])
def test_without_a_training_nothing_is_written(stage, tmp_path, capsys):
    assert main(arguments(tmp_path, stage)) == 2
    said = capsys.readouterr().err
    assert "holds no finished training" in said
    assert said.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_literal_plant_is_the_other_without_its_low_pass():
    for world in (*GROUPS, *GAP.values()):
        own, literal = (each.truth(3) for each in with_literal(world))
        limit = own.hysteresis.rate_bandwidth_hz
        assert limit is not None
        assert literal.hysteresis.rate_bandwidth_hz is None
        assert literal.with_hysteresis(literal.hysteresis.band_limited(limit)) == own
        assert not world.belief.effects


def test_the_full_study_has_what_it_is_to_compare():
    assert len(FULL.seeds) == 5
    assert {agent.name for agent in FULL.agents} == {
        "ppo-correction", "ppo-increment", "sac-correction", "sac-increment",
    }  # fmt: skip
    assert set(FULL.domains) == set(GAP)
    kinds = [one.kind for one in scores.contestants(FULL.rivals, [])]
    assert kinds.count("preview") == 1
    assert min(kinds.count("feedforward"), kinds.count("feedback")) > 4


def test_the_interquartile_mean_is_moved_by_no_outlier_and_no_repetition():
    draws = np.arange(1.0, 9.0)
    assert interquartile_mean(draws) == pytest.approx(4.5)
    assert interquartile_mean(np.append(draws[:-1], np.inf)) == pytest.approx(4.5)
    draws = np.random.default_rng(2).uniform(size=10)
    assert interquartile_mean(np.tile(draws, 5)) == pytest.approx(interquartile_mean(draws))


def test_the_interval_covers_the_mean_as_often_as_it_says():
    rng = np.random.default_rng(0)
    covered = 0
    for trial in range(200):
        found = estimate([rng.normal(3.0, 1.0, (1, 40))], 300, seed=trial).row("x")
        covered += found["x_low"] <= 3.0 <= found["x_high"]
    # 95 % of 200, less what forty plants and the trimming cost.
    assert 176 <= covered <= 199


def test_the_same_error_times_a_factor_is_that_ratio_on_whatever_plants():
    rng = np.random.default_rng(1)
    base = rng.uniform(1.0, 2.0, (2, 6))
    rows = [
        {
            "contestant": name, "kind": kind, "training_seed": seed, "world": world,
            "plant_seed": plant, "rmse_percent": factor * base[i, plant],
            "command_variation_V_s": 2.0 * factor,
        }
        for name, kind, seed, factor in (
            ("one", "feedback", None, 1.0), ("two", "feedforward", None, 3.0),
            ("mine", "agent", 0, 0.5), ("mine", "agent", 1, 0.5), ("seer", "oracle", None, 0.1),
        )
        for i, world in enumerate(("a", "b"))
        for plant in range(6)
    ]  # fmt: skip
    summary = summarise(pd.DataFrame(rows), 200).set_index(["contestant", "world"])
    for world in ("all groups", "a", "b"):
        assert summary.loc[("two", world), "best"] == "one"
        mine = summary.loc[("mine", world)]
        for column in ("rmse_ratio", "rmse_ratio_low", "rmse_ratio_high", "variation_ratio"):
            assert mine[column] == pytest.approx(0.5)
        assert mine["best_feedforward"] == "two"
        assert mine["rmse_over_feedforward_high"] == pytest.approx(0.5 / 3.0)
        assert mine["rmse_percent_low"] < mine["rmse_percent"] < mine["rmse_percent_high"]
