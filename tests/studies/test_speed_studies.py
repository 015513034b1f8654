"""Studies of speed: the committed tables keep what the pages promise, the commands measure every case."""

import shutil
from pathlib import Path

import pandas as pd
import pytest

from rdpi_gym.signals import SIGNALS
from studies import core_speed, jax_copies, sample_speed
from studies.firmware_speed import as_markdown, measure
from studies.runner import RESULTS

SAMPLED = [*SIGNALS, "read a text file"]


def committed(name):
    return pd.read_csv(RESULTS / f"{name}.csv")


def measured(study, words, out):
    """Run a study and return its table."""
    assert study.main([*words, "--out", str(out)]) == 0
    return pd.read_csv(Path(out) / f"{study.main.name}.csv")


def test_no_core_is_below_a_third_of_the_rdpi_models_speed_at_usual_sampling():
    table = committed("core_speed")
    assert set(table["core"]) == set(core_speed.cases())
    usual = table[table["samples_a_period"] >= 200]
    assert usual["block_ratio"].min() >= 1.0 / 3.0, usual.to_string()


def test_every_core_is_measured(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(core_speed, "SAMPLES", 5)
    monkeypatch.setattr(core_speed.measure, "__defaults__", ((16,), (200,)))
    table = measured(core_speed, ["--rounds", "1"], tmp_path)
    assert table["core"].tolist() == list(core_speed.cases())
    assert (table[["block_ns", "block_ratio", "steps_ratio"]] > 0).all(axis=None)
    assert "The slowest is" in capsys.readouterr().out


def test_a_hundred_thousand_samples_take_well_under_a_second():
    table = committed("sample_speed").set_index("case")
    assert sorted(table.index) == sorted(SAMPLED)
    assert (table["milliseconds"].drop("read a text file") < 300.0).all(), table.to_string()
    assert table.loc["read a text file", "milliseconds"] < 1000.0


def test_every_signal_is_measured(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sample_speed, "SAMPLES", 200)
    table = measured(sample_speed, ["--rounds", "1"], tmp_path)
    assert table["case"].tolist() == SAMPLED
    assert (table[["milliseconds", "yardstick_milliseconds", "ratio"]] > 0).all(axis=None)
    assert "| read a text file |" in (tmp_path / "sample_speed.md").read_text()
    assert "written to" in capsys.readouterr().out


def test_one_environment_steps_at_least_as_fast_as_cartpole_beside_it():
    speed = pytest.importorskip("studies.environment_speed")
    table = committed("environment_speed")
    table = table[table["measure"] == "benchmark_step"]
    assert len(table) == len(speed.CASES)
    assert (table["ratio"] >= 1.0).all(), table.to_string()
    table = speed.measure(rounds=1, duration_s=0.02, measures=["benchmark_step"])
    assert len(table) == len(speed.CASES)
    assert (table[["steps_per_s", "cartpole_steps_per_s"]] > 0).all(axis=None)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler to measure the code of")
def test_ten_plays_are_timed_in_every_precision():
    table = measure(rounds=1, names=["pi-classical-reference-rate"])
    timed = table[["double_ns", "float_ns", "Q31_ns", "python_ns"]].iloc[0]
    assert (timed > 0.0).all()
    assert timed["python_ns"] > 10.0 * timed["double_ns"]
    assert "Ten plays with PI take" in as_markdown(table, 1)


def test_the_native_ppo_is_faster_than_the_reference(tmp_path, monkeypatch):
    pytest.importorskip("torch")
    from studies import training_speed

    table = committed("training_speed")
    assert list(zip(table["learner"], table["threads"], strict=True)) == list(training_speed.CASES)
    reference, one = (table.iloc[i]["steps_per_process_s"] for i in (0, 1))
    assert one > 3.0 * reference
    monkeypatch.setattr(training_speed, "CASES", (("native-ppo", 2),) * 3)
    table = measured(training_speed, ["--rounds", "1", "--rollouts", "1"], tmp_path)
    (row,) = table.to_dict("records")
    assert (row["learner"], row["threads"], row["steps"]) == ("native-ppo", 2, 512 * 64)
    assert row["steps_per_process_s"] > 0.0


def test_without_jax_the_study_of_copies_is_one_line(monkeypatch, tmp_path, capsys):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(jax_copies, "import_module", missing)
    assert jax_copies.main(["--out", str(tmp_path)]) == 2
    assert "needs jax, which is not installed" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_sentence_on_copies_is_the_tables(monkeypatch):
    monkeypatch.setattr(jax_copies, "version", lambda name: "0.1")
    columns = ["lanes", "actions_shared_percent", "observations_shared_percent"]
    table = pd.DataFrame([(1, 100.0, 44.5), (64, 90.0, 100.0)], columns=columns)
    text = jax_copies.as_markdown(table, 3)
    assert "44 % of the observations at least, and the environment that of 90 % of" in text
