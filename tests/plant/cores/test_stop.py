"""The stop-type core: laws of Masing and Maxwell, an integration of its own, and what it refuses."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from rdpi_gym.plant.cores.stop import Stop
from rdpi_gym.support.arrays import Array
from tests.plant.cores.integration import path, run

FRICTION = Stop(weights=(2.0, 0.7, 0.3), thresholds_V=(0.5, 2.0, 6.0), slope=-0.05)


def slipping(r: float, corners: Array, samples: int) -> Array:
    """A spring with a slider, ds/dt = du/dt while it sticks and 0 while it slips, at every corner and between."""
    s, out = 0.0, [0.0]
    for a, b in pairwise(corners):
        rate, times, sticks = b - a, np.linspace(0.0, 1.0, samples)[1:], np.array([])
        bound = np.copysign(r, rate)
        slips_at = 0.0
        if abs(s - bound) > 1e-12:

            def reached(t: float, s: Array, bound: float = bound) -> float:
                return float(s[0] - bound)

            reached.terminal = True  # type: ignore[attr-defined]
            stuck = solve_ivp(
                lambda t, s, rate=rate: [rate], (0.0, 1.0), [s],
                events=reached, rtol=1e-10, atol=1e-12,
            )  # fmt: skip
            slips_at = float(stuck.t[-1])
            sticks = np.interp(times[times <= slips_at], stuck.t, stuck.y[0])
            s = float(stuck.y[0, -1])
        out += [*sticks, *[s] * int(np.sum(times > slips_at))]
    return np.array(out)


def test_it_is_an_independent_integration_of_springs_with_sliders() -> None:
    corners = np.concatenate([[0.0], np.random.default_rng(3).uniform(-9.0, 9.0, 40)])
    u = path(corners, 50)
    y = FRICTION.slope * u
    for w, r in zip(FRICTION.weights, FRICTION.thresholds_V, strict=True):
        y += w * slipping(r, corners, 50)
    np.testing.assert_allclose(run(FRICTION, u), y, atol=1e-6 * np.ptp(y))


@given(st.floats(0.1, 20.0), st.floats(0.0, 1.0))
def test_masing_a_branch_after_a_turn_is_the_virgin_curve_twice_as_large(
    peak: float, share: float
) -> None:
    fall = 2.0 * peak * share
    u = np.array([peak, peak - fall])
    y = run(FRICTION, u)
    assert y[0] - y[1] == pytest.approx(2.0 * run(FRICTION, np.array([0.5 * fall]))[0], abs=1e-10)


def test_the_force_while_all_slip_is_half_the_height_of_the_loop() -> None:
    core = Stop((2.0, 0.7), (0.5, 2.0))
    u = path(np.array([0.0, 20.0, -20.0, 20.0]), 50)
    assert float(np.ptp(run(core, u))) == pytest.approx(2.0 * core.force_um, rel=1e-12)


def test_gains_that_leave_no_stiffness_at_a_turn_are_moved_until_there_is_one() -> None:
    soft = FRICTION.with_gains([-10.0, 1.0, 2.0, -1.0])
    assert soft.weights == (1.0, 2.0, 0.0)
    assert 0.0 < soft.a0 < 1e-5
    assert FRICTION.with_gains([0.0, 0.0, 0.0, 0.0]).a0 > 0.0
    assert FRICTION.with_gains([0.4, 0.0, 0.0, 0.0]).gains[0] == 0.4
