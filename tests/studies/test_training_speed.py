"""How fast trainings are: the command that measures it."""

import pandas as pd
import pytest

pytest.importorskip("torch")

from studies import training_speed


def test_the_committed_table_has_every_case():
    table = pd.read_csv(training_speed.RESULTS / "training_speed.csv")
    assert list(zip(table["learner"], table["threads"], strict=True)) == list(training_speed.CASES)
    reference, one = (table.iloc[i]["steps_per_process_s"] for i in (0, 1))
    assert one > 3.0 * reference


def test_the_command_writes_a_row_for_each_case(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(training_speed, "CASES", (("native-ppo", 2),) * 3)
    words = ["--rounds", "1", "--rollouts", "1", "--out", str(tmp_path)]
    assert training_speed.main(words) == 0
    (row,) = pd.read_csv(tmp_path / "training_speed.csv").to_dict("records")
    assert (row["learner"], row["threads"], row["steps"]) == ("native-ppo", 2, 512 * 64)
    assert row["steps_per_process_s"] > 0.0
    assert "written to" in capsys.readouterr().out
