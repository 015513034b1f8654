"""One environment steps at least as fast as CartPole-v1 in the same process."""

import pytest

speed = pytest.importorskip("benchmarks.environment_speed")


def test_no_slower_than_cartpole():
    table = speed.measure(rounds=5, duration_s=0.1, measures=["benchmark_step"])
    assert len(table) == len(speed.CASES)
    assert (table["ratio"] >= 1.0).all(), table.to_string()
