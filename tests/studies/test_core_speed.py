"""The committed measurement: what a sample of each hysteresis core takes, beside the RDPI model."""

import pandas as pd

from studies import core_speed


def test_the_committed_table_holds_every_core_and_none_is_below_a_third_at_usual_sampling():
    table = pd.read_csv(core_speed.RESULTS / "core_speed.csv")
    assert set(table["core"]) == set(core_speed.cases())
    usual = table[table["samples_a_period"] >= 200]
    assert usual["block_ratio"].min() >= 1.0 / 3.0, usual.to_string()


def test_the_command_measures_every_core(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(core_speed, "SAMPLES", 5)
    monkeypatch.setattr(core_speed.measure, "__defaults__", ((16,), (200,)))
    core_speed.main(["--rounds", "1", "--out", str(tmp_path)])
    table = pd.read_csv(tmp_path / "core_speed.csv")
    assert table["core"].tolist() == list(core_speed.cases())
    assert (table[["block_ns", "block_ratio", "steps_ratio"]] > 0).all(axis=None)
    assert "The slowest is" in capsys.readouterr().out
