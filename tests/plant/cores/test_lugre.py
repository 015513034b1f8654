"""LuGre: Stribeck's curve, an independent integration in time, what becomes of it at slow rates."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rdpi_gym.plant.cores.dahl import Dahl
from rdpi_gym.plant.cores.lugre import LuGre
from tests.looping import over
from tests.plant.cores.integration import corners, run, sampled

CORE = LuGre(8.0, 0.02, 0.01, coulomb_V=0.4, static_ratio=1.6, stribeck_V_s=30.0)


@over("ts", [1e-4, 2e-2, 1.0])
def test_it_equals_an_independent_integration_in_time(ts: float) -> None:
    # The canonical numbers as forces: s0, Fc = s0 zc, Fs, and the stiff equation in time.
    c, u = CORE, np.concatenate([sampled(corners(), 0.6)[0], [0.5, 0.5]])
    coulomb, static = c.s0 * c.coulomb_V, c.s0 * c.coulomb_V * c.static_ratio
    z, last, expected = 0.0, 0.0, []
    for k, value in enumerate(u):
        v = (value - last) / ts
        v_read = 0.0 if k == 0 else v  # a record begins here: v(0) = 0, z walks there slowly
        g = coulomb + (static - coulomb) * np.exp(-((v_read / c.stribeck_V_s) ** 2))

        def slope(_: float, x: np.ndarray, v: float = v, g: float = g) -> list[float]:
            return [v - c.s0 * abs(v) / g * float(x[0])]

        part = solve_ivp(slope, (0.0, ts), [z], "LSODA", rtol=1e-11, atol=1e-13)
        z, last = float(part.y[0, -1]), float(value)
        moves = v_read - c.s0 * abs(v_read) / g * z
        expected.append(c.s0 * z + c.s1_s * moves + c.s2_s * v_read)
    # the stroke of the friction itself: at short times the viscous terms dwarf it
    np.testing.assert_allclose(run(c, u, ts), expected, atol=1e-6 * coulomb, rtol=1e-8)


@over("rate", [1e-3, 5.0, 30.0, 200.0, -60.0])
def test_at_a_constant_rate_it_is_stribecks_curve(rate: float) -> None:
    u = rate * 1e-3 * np.arange(20_000) * max(1.0, 20.0 / abs(rate))
    ts = 1e-3 * max(1.0, 20.0 / abs(rate))
    assert run(CORE, u, ts)[-1] == pytest.approx(CORE.steady_um(rate), rel=1e-9)
    assert CORE.steady_um(1e-9) == pytest.approx(8.0 * 0.4 * 1.6)
    assert CORE.steady_um(1e6) == pytest.approx(8.0 * 0.4 + 0.01 * 1e6)


def test_a_slow_walk_is_dahls_model_of_the_static_limit() -> None:
    u, _ = sampled(corners(), 0.05)
    other = Dahl(8.0, 0.4 * 1.6, 1.0)
    np.testing.assert_allclose(run(CORE, u, 1e6), run(other, u), atol=1e-6)


def test_the_slow_model_of_a_friction_that_nothing_moves_is_within_its_bounds() -> None:
    stuck = LuGre(8.0, 0.02, 0.01, coulomb_V=1e9, static_ratio=2.5, stribeck_V_s=30.0)
    assert (stuck.static().coulomb_V, stuck.static().static_ratio) == (1e9, 1.0)


def test_the_response_of_a_stiffer_state_is_stable_at_any_rate() -> None:
    rng = np.random.default_rng(4)
    u = rng.normal(size=400) * 10.0 ** rng.uniform(-6.0, 100.0, 400)
    core = LuGre(1.0, 0.0, 0.0, coulomb_V=1e-9, static_ratio=1.5, stribeck_V_s=1e-9)
    y = run(core, u, 1e-9)
    assert np.all(np.abs(y) <= 1.5e-9 * (1 + 1e-12))


def test_a_low_passed_rate_stands_in_the_viscous_terms() -> None:
    u = np.concatenate([np.zeros(5), np.full(40, 2.0)])
    literal, smooth = run(CORE, u), run(CORE.band_limited(20.0), u)
    assert np.max(np.abs(smooth)) < 0.3 * np.max(np.abs(literal))
    assert smooth[-1] == pytest.approx(CORE.s0 * CORE.coulomb_V, rel=0.7)
