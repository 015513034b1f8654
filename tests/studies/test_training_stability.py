"""Whether long trainings end as well as they were: what the command makes of learning curves."""

import pandas as pd
import pytest

pytest.importorskip("torch")

from baselines.learned import training
from studies import training_stability

LAST = {0: 0.5, 1: 0.9}


def test_the_committed_trainings_end_as_they_were_at_their_best():
    table = pd.read_csv(training_stability.RESULTS / "seeds.csv")
    assert len(table) == 5
    assert (table["timesteps"] >= 20_000_000).all()
    assert (table["last_over_best"] <= training_stability.GOAL).all()
    assert (table["last_rmse_um"] < table["compensator_rmse_um"]).all()


def test_the_command_trains_each_seed_and_says_which_ends_worse(tmp_path, monkeypatch, capsys):
    asked = []

    def train(options, progress):
        asked.append((options.seed, options.timesteps, options.threads, options.action))
        options.out.mkdir(parents=True)
        curve = pd.DataFrame({"timesteps": [0, 5, 10], "seconds": [0.0, 1.0, 2.0]})
        curve["rmse_um"] = [9.0, 0.5, LAST[options.seed]]
        curve["command_variation_V_s"], curve["compensator_rmse_um"] = 7.0, 1.0
        curve.to_csv(options.out / "training.csv", index=False)

    native = training.Trainer(training.NativeOptions, train)
    monkeypatch.setattr(training, "trainer", {"native-ppo": native}.get)
    words = ["--seeds", "2", "--timesteps", "10", "--out", str(tmp_path / "out")]
    assert training_stability.main([*words, "--runs", str(tmp_path / "runs")]) == 0
    assert asked == [(0, 10, 1, "increment"), (1, 10, 1, "increment")]
    said = capsys.readouterr().out
    assert "Not every seed of 2 ends within 1.2 times its best evaluation" in said
    table = pd.read_csv(tmp_path / "out" / "seeds.csv")
    assert table["last_over_best"].tolist() == [1.0, 1.8]
    assert len(pd.read_csv(tmp_path / "out" / "curves.csv")) == 6
