"""Exponentials and powers of the lanes: those of the mathematics library to their last digits."""

from __future__ import annotations

import numpy as np
import pytest

from rdpi_gym.plant.cores.elementary import VECTOR_LANES, expm1_lanes, power_lanes

LANES = [1, VECTOR_LANES - 1, VECTOR_LANES, 4001]


@pytest.mark.parametrize("lanes", LANES)
def test_expm1_keeps_its_digits_near_zero_and_far_from_it(lanes: int) -> None:
    for w in (-np.geomspace(1e-300, 1e-3, lanes), -np.geomspace(1e-3, 800.0, lanes)):
        out = np.empty(lanes)
        expm1_lanes(w, out)
        np.testing.assert_allclose(out, np.expm1(w), rtol=1e-15)


def test_expm1_of_nothing_and_of_all() -> None:
    out = np.empty(16)
    expm1_lanes(np.full(16, -0.0), out)
    assert np.all(out == 0.0)
    expm1_lanes(np.full(16, -np.inf), out)
    assert np.all(out == -1.0)


@pytest.mark.parametrize("lanes", LANES)
def test_powers_keep_thirteen_digits(lanes: int) -> None:
    x = np.concatenate([np.geomspace(1e-12, 2.0, lanes - 1), [1.0]])
    for n in (-1.0, -0.37, 0.0, 0.5, 1.0, 1.4, 3.0, 16.0):
        out = np.empty(lanes)
        power_lanes(x, np.full(lanes, n), out)
        np.testing.assert_allclose(out, x**n, rtol=1e-13)
        assert out[-1] == 1.0


@pytest.mark.parametrize("lanes", LANES)
def test_a_power_of_zero_is_nothing_and_of_next_to_it_is_finite(lanes: int) -> None:
    out = np.empty(lanes)
    power_lanes(np.zeros(lanes), np.full(lanes, 1.5), out)
    assert np.all(out <= 1e-300)
    power_lanes(np.full(lanes, 5e-324), np.full(lanes, 16.0), out)
    assert np.all(out <= 1e-300)
