"""Dahl: closed forms of the slide, an independent integration, its limit."""

from __future__ import annotations

import numpy as np
import pytest

from rdpi_gym.plant.cores.bouc_wen import BoucWen
from rdpi_gym.plant.cores.dahl import Dahl
from tests.looping import over
from tests.plant.cores.integration import corners, integrated, run, sampled


@over("limit", [0.7, 5.0, 60.0])
@over("exponent", [0.5, 0.9, 1.0, 1.0 + 1e-9, 1.3, 2.0, 4.0])
def test_it_equals_an_independent_integration(limit: float, exponent: float) -> None:
    def slope(z: float, sign: float) -> float:
        return max(1.0 - sign * z / limit, 0.0) ** exponent

    expected = 1.7 * integrated(slope, corners())
    size = float(np.ptp(expected))
    for longest_V in (50.0, 0.1, 0.002):
        u, turns = sampled(corners(), longest_V)
        found = run(Dahl(1.7, limit, exponent), u)[turns]
        # the reference itself meets the end of a slide of i < 1, where its slope has no derivative
        np.testing.assert_allclose(found, expected, atol=(1e-7 if exponent < 1 else 1e-9) * size)


def test_the_first_loading_is_that_of_the_closed_forms() -> None:
    u = np.linspace(0.0, 9.0, 400)
    forms = {
        0.0: np.minimum(u, 2.0),
        0.5: 2.0 * (1.0 - np.maximum(1.0 - u / 4.0, 0.0) ** 2),
        1.0: -2.0 * np.expm1(-u / 2.0),
        2.0: 2.0 * (1.0 - 1.0 / (1.0 + u / 2.0)),
        3.0: 2.0 * (1.0 - (1.0 + u) ** -0.5),
    }
    for exponent, z in forms.items():
        np.testing.assert_allclose(run(Dahl(1.0, 2.0, exponent), u), z, atol=1e-12)


def test_an_exponent_of_zero_is_one_stop_operator() -> None:
    u, _ = sampled(corners(), 0.03)
    z, last, stop = 0.0, 0.0, []
    for value in u:
        z = min(max(z + value - last, -2.5), 2.5)
        last = value
        stop.append(z)
    np.testing.assert_allclose(run(Dahl(1.0, 2.5, 0.0), u), stop, atol=1e-12)


def test_it_is_the_bouc_wen_model_of_one_exponent_and_no_gamma() -> None:
    u = 20.0 * np.sin(np.linspace(0.0, 30.0, 700)) + 5.0 * np.sin(np.linspace(0.0, 170.0, 700))
    other = BoucWen(k=0.0, d=2.0, limit_V=4.0, sigma=1.0, exponent=1.0)
    np.testing.assert_allclose(run(Dahl(2.0, 4.0, 1.0), u), run(other, u), atol=1e-12)


def test_it_never_passes_its_limit_and_no_step_is_too_long() -> None:
    rng = np.random.default_rng(2)
    for exponent in (0.0, 0.3, 1.0, 1.7, 4.0):
        u = rng.normal(size=500) * 10.0 ** rng.uniform(-200.0, 300.0, 500)
        y = run(Dahl(1.0, 2.0, exponent), u)
        assert np.all(np.abs(y) <= 2.0)
        far = run(Dahl(1.0, 1e-9, exponent), np.array([1e308, -1e308]))
        assert far == pytest.approx([1e-9, -1e-9], rel=1e-12)


def test_a_long_limit_is_a_spring_to_the_last_digit() -> None:
    u = np.cumsum(np.random.default_rng(1).normal(size=1000))
    for exponent in (0.0, 0.6, 1.0, 2.5):
        np.testing.assert_allclose(run(Dahl(1.0, 1e9, exponent), u), u, atol=1e-4)
