"""The order of controllers on two sets of plants: what the study runs, and what it says."""

import pytest

from benchmarks.stages.ranking import agreement
from studies import rank_order


def rows(errors, plants=range(6)):
    return [
        {
            "controller": name, "task": "Bare", "plant": plant, "failure": "", "sees": "preview",
            "rmse_percent": error * (1.0 + 0.001 * plant), "rmse_noise": 1.0, "seed": 0,
            "command_variation_V_s": 1.0, "microseconds_per_sample": 1.0, "tuning_samples": 0,
            "certificate": "",
        }
        for name, error in errors.items()
        for plant in plants
    ]  # fmt: skip


def test_the_same_order_agrees_and_the_reverse_disagrees():
    first = rows({"a": 1.0, "b": 2.0, "c": 3.0, "d": 4.0})
    assert agreement(first, rows({"a": 2.0, "b": 3.0, "c": 5.0, "d": 9.0})) == 1.0
    assert agreement(first, rows({"a": 9.0, "b": 5.0, "c": 3.0, "d": 2.0})) == -1.0


def test_a_line_says_who_is_first_on_each(monkeypatch):
    one = rank_order.line(
        "Bare", rows({"a": 1.0, "b": 2.0, "c": 3.0}), rows({"b": 1.0, "a": 2.0, "c": 3.0})
    )
    assert one["first on each"] == "a and b"
    assert one["two sets"] == pytest.approx(0.5)
    assert one["plants of the first on which one failed"] == 0
    assert "at least 0.5" in rank_order.report([one], 6, 1)
