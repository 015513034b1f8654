"""The committed share of a training that the environment takes, and the command that measures it."""

import pandas as pd
import pytest

pytest.importorskip("stable_baselines3")

from studies import training_share


def test_the_committed_training_does_not_wait_for_its_environment():
    table = pd.read_csv(training_share.RESULTS / "training_share.csv").set_index("case")
    assert list(table.index) == list(training_share.CASES)
    assert (table["lanes"] == 256).all()
    assert (table["share_percent"] < 15.0).all(), table.to_string()


def test_the_command_writes_the_table(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(training_share, "CASES", {"increment": {"action": "increment"}})
    training_share.main(["--lanes", "4", "--updates", "1", "--out", str(tmp_path)])
    (row,) = pd.read_csv(tmp_path / "training_share.csv").to_dict("records")
    assert row["steps"] == 4 * 128
    assert 0.0 < row["environment_s"] < row["seconds"]
    assert "| increment | 4 |" in (tmp_path / "training_share.md").read_text()
    assert "written to" in capsys.readouterr().out
