"""Exponentials and powers of the lanes: those of the mathematics library to their last digits."""

from __future__ import annotations

import numpy as np

from rdpi_gym.plant.cores.elementary import VECTOR_LANES, expm1_lanes, log, log1p, power
from tests.looping import over

LANES = [1, VECTOR_LANES - 1, VECTOR_LANES, 4001]


@over("lanes", LANES)
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


def test_powers_keep_thirteen_digits() -> None:
    x = np.concatenate([np.geomspace(1e-12, 2.0, 400), [1.0]])
    for n in (-1.0, -0.37, 0.0, 0.5, 1.0, 1.4, 3.0, 16.0):
        found = np.array([power(value, n) for value in x.tolist()])
        np.testing.assert_allclose(found, x**n, rtol=1e-13)
        assert found[-1] == 1.0


def test_logarithms_keep_their_digits_near_one_and_far_from_it() -> None:
    near = np.concatenate([np.geomspace(1e-300, 1e9, 400), -np.geomspace(1e-300, 1.0, 300)[:-1]])
    found = np.array([log1p(value) for value in near.tolist()])
    np.testing.assert_allclose(found, np.log1p(near), rtol=2e-15)
    x = np.geomspace(1e-300, 1e300, 400)
    found = np.array([log(value) for value in x.tolist()])
    np.testing.assert_allclose(found, np.log(x), rtol=1e-14, atol=1e-15)


def test_a_power_of_zero_is_nothing_and_of_next_to_it_is_finite() -> None:
    assert power(0.0, 1.5) <= 1e-300
    assert power(5e-324, 16.0) <= 1e-300
