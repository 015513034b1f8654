"""A minute of training beside the best fixed compensator: the command, and what is committed of it."""

import pandas as pd
import pytest

pytest.importorskip("torch")

from studies import training_race


def test_the_committed_trainings_beat_the_best_fixed_compensator_within_a_minute():
    table = pd.read_csv(training_race.RESULTS / "race.csv").set_index("entrant")
    assert table.index.tolist() == list(training_race.ENTRANTS)
    short = table.loc[training_race.SHORT]
    assert short["seeds"] == 5
    assert training_race.is_reached(short)
    assert training_race.is_reached(table.loc[training_race.FIRST])
    assert (table["failed"] == 0.0).all()
    rows = pd.read_csv(training_race.RESULTS / "seeds.csv")
    rival = training_race.best_fixed(training_race.read_rankings())
    again = training_race.medians(rows, rival["iqm_percent"]).set_index("entrant")
    pd.testing.assert_frame_equal(again, table, rtol=2e-3, check_dtype=False)


def test_the_command_trains_and_scores_each_seed_once(tmp_path, monkeypatch, capsys):
    entrants = (training_race.SHORT, training_race.FIRST)
    trained, errors = [], iter([0.2, 0.2, 0.5, 0.5, 0.1, 0.1])

    def train(out, seed):
        trained.append(seed)
        return out

    def run_unit(unit):
        assert (unit.task, unit.plants) == ("Stage", (0, 1))
        left = {"rmse_percent": next(errors), "failure": "", "sees": "preview", "certificate": None}
        return [{"controller": unit.controller, "plant": number} | left for number in unit.plants]

    monkeypatch.setattr(training_race, "ENTRANTS", dict.fromkeys(entrants, train))
    monkeypatch.setattr(training_race, "run_unit", run_unit)
    words = ["--plants", "2", "--out", str(tmp_path / "out"), "--runs", str(tmp_path / "runs")]
    assert training_race.main([*words, "--seeds", "2"]) == 0
    assert training_race.main([*words, "--seeds", "3"]) == 0
    assert trained == [0, 0, 1, 1, 2, 2]
    said = capsys.readouterr().out
    assert "\nNot reached: " in said
    assert "\nReached: " in said
    rows = pd.read_csv(tmp_path / "out" / "seeds.csv")
    assert rows["iqm_percent"].tolist() == [0.2, 0.5, 0.1] * 2
