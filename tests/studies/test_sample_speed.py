"""The committed measurement: what a hundred thousand samples take, beside NumPy alone."""

import pandas as pd

from rdpi_gym.signals import SIGNALS
from studies import sample_speed

CASES = [*SIGNALS, "read a text file"]


def test_the_committed_table_holds_every_case_well_under_a_second():
    table = pd.read_csv(sample_speed.RESULTS / "sample_speed.csv").set_index("case")
    assert sorted(table.index) == sorted(CASES)
    assert (table["milliseconds"].drop("read a text file") < 300.0).all(), table.to_string()
    assert table.loc["read a text file", "milliseconds"] < 1000.0


def test_the_command_measures_every_case(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sample_speed, "SAMPLES", 200)
    sample_speed.main(["--rounds", "1", "--out", str(tmp_path)])
    table = pd.read_csv(tmp_path / "sample_speed.csv")
    assert table["case"].tolist() == CASES
    assert (table[["milliseconds", "yardstick_milliseconds", "ratio"]] > 0).all(axis=None)
    assert "| read a text file |" in (tmp_path / "sample_speed.md").read_text()
    assert "written to" in capsys.readouterr().out
