"""The committed measurement: one environment steps at least as fast as CartPole-v1 beside it."""

from pathlib import Path

import pandas as pd
import pytest

speed = pytest.importorskip("studies.environment_speed")
RESULTS = "environment_speed.csv"


def test_the_measured_ratio_is_at_least_one():
    table = pd.read_csv(Path(speed.__file__).parent / "results" / RESULTS)
    measured = table[table["measure"] == "benchmark_step"]
    assert len(measured) == len(speed.CASES)
    assert (measured["ratio"] >= 1.0).all(), measured.to_string()


def test_the_benchmark_measures_every_case():
    table = speed.measure(rounds=1, duration_s=0.02, measures=["benchmark_step"])
    assert len(table) == len(speed.CASES)
    assert (table[["steps_per_s", "cartpole_steps_per_s"]] > 0).all(axis=None)
