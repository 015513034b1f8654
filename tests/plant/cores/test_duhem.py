"""Duhem, Coleman-Hodgdon: the closed form of a branch, its steady loop, an independent integration."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from rdpi_gym.plant.cores.bouc_wen import BoucWen
from rdpi_gym.plant.cores.duhem import Duhem
from tests.looping import over
from tests.plant.cores.integration import corners, run, sampled


@over("length", [0.3, 4.0, 80.0])
@over("b, c", [(1.0, 0.6), (0.5, 1.4)])
def test_it_equals_an_independent_integration_of_its_own_equation(b, c, length: float) -> None:
    path, alpha, y, expected = corners(), 1.0 / length, 0.0, []
    for first, last in zip(np.concatenate([[0.0], path]), path, strict=False):
        sign = float(np.sign(last - first))

        def slope(w: float, x: np.ndarray, first=first, sign=sign) -> list[float]:
            return [alpha * (b * (first + sign * w) - float(x[0])) + c * sign]

        part = solve_ivp(slope, (0.0, abs(last - first)), [y], "DOP853", rtol=1e-11, atol=1e-12)
        y = float(part.y[0, -1])
        expected.append(y)
    for longest_V in (50.0, 0.1):
        u, turns = sampled(path, longest_V)
        found = run(Duhem(b, c, length), u)[turns]
        np.testing.assert_allclose(found, expected, atol=1e-9 * np.ptp(expected))


def test_a_branch_is_a_line_and_an_exponential() -> None:
    # Coleman, Hodgdon: y = b u + s (c - b) / α + (y0 - b u0 - s (c - b) / α) exp(-α |u - u0|)
    b, c, length = 1.0, 0.7, 5.0
    up = run(Duhem(b, c, length), np.array([7.0]))[0]
    u = np.linspace(7.0, -20.0, 300)
    line = (c - b) * length
    branch = b * u - line + (up - b * 7.0 + line) * np.exp(-(7.0 - u) / length)
    np.testing.assert_allclose(run(Duhem(b, c, length), u), branch, atol=1e-12)


def test_it_is_the_bouc_wen_model_of_one_exponent_and_no_gamma() -> None:
    u = 20.0 * np.sin(np.linspace(0.0, 30.0, 700)) + 5.0 * np.sin(np.linspace(0.0, 170.0, 700))
    other = BoucWen(k=1.0, d=-0.3, limit_V=4.0, sigma=1.0, exponent=1.0)
    np.testing.assert_allclose(run(Duhem(1.0, 0.7, 4.0), u), run(other, u), atol=1e-12)


def test_no_step_is_too_long_and_a_long_length_is_a_line() -> None:
    assert run(Duhem(1.0, 0.7, 1e-9), np.array([1e300, -1e300])).tolist() == [1e300, -1e300]
    u = np.cumsum(np.random.default_rng(1).normal(size=1000))
    np.testing.assert_allclose(run(Duhem(1.0, 0.7, 1e9), u), 0.7 * u, atol=1e-5)


@over("gains", [[1.0, 0.0], [1.0, -3.0], [0.0, 0.0], [-1.0, 2.0]])
def test_a_fit_stays_where_the_displacement_rises_with_the_command(gains) -> None:
    path, _ = sampled(corners(), 0.02)
    core = Duhem(1.0, 0.7, 2.0).with_gains(gains)
    assert core.a0 > 0.0
    assert np.all(np.diff(run(core, path)) * np.diff(path) >= -1e-12)
