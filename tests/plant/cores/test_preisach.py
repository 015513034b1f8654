"""The Preisach core: relays with ramps, its rest, its loops, its grid, and the dense model it tends to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import nnls

from rdpi_gym.plant import RDPI, Plant, PlantModel
from rdpi_gym.plant.cores.preisach import Preisach, triangle_roughness
from rdpi_gym.support.arrays import Array
from tests.looping import over
from tests.plant.cores.integration import path, run

TS_S = 1e-3


def grid(count: int, weights: Array | float = 1.0, low=-10.0, high=10.0, share=1.0, c=0.05):
    """Levels whose cells tile a range; the ramp's share of their distance."""
    apart = (high - low) / count
    levels = tuple(low + (i + 0.5) * apart for i in range(count))
    each = np.broadcast_to(weights, (count * (count + 1) // 2,))
    return Preisach(c, levels, share * apart, tuple(each.tolist()))


def uneven(count: int, seed: int = 0, **how):
    """A grid whose weights have no symmetry."""
    return grid(count, np.random.default_rng(seed).random(count * (count + 1) // 2), **how)


def relays(core: Preisach, u: Array) -> Array:
    """Every relay by its own definition, ``(T, K)``, from the demagnetised state."""
    a, b = np.array([(hi, lo) for hi in core.levels_V for lo in core.levels_V if lo <= hi]).T
    out = np.clip(-(a + b) / core.ramp_V, -1.0, 1.0)
    path = []
    for x in u:
        rises = np.clip(2.0 * (x - a) / core.ramp_V, -1.0, 1.0)
        falls = np.clip(2.0 * (x - b) / core.ramp_V, -1.0, 1.0)
        out = np.maximum(rises, np.minimum(falls, out))
        path.append(out)
    return np.array(path)


def reversal_curves(core: Preisach, samples: int = 200) -> Array:
    """Down from above the top to each level, and up again."""
    top, half = core.levels_V[-1] + core.apart_V, 0.5 * core.apart_V
    corners = [c for level in core.levels_V for c in (top, level - half)]
    return path([0.0, *corners, top], samples)


COMMANDS = arrays(np.float64, 60, elements=st.floats(-14.0, 14.0, width=32))


@over("share", [1.0, 0.3])
@over("count", [2, 3, 9, 20])
@over("low", [-10.0, 0.0, -3.0])
def test_it_is_the_sum_of_its_relays(count, share, low):
    core = uneven(count, low=low, share=share)
    rng = np.random.default_rng(count)
    u = np.concatenate([rng.uniform(-14.0, 14.0, 300), np.cumsum(rng.standard_normal(600))])
    moved = relays(core, u) - relays(core, np.zeros(1))
    expected = core.reversible_um_V * u + moved @ np.array(core.weights_um)
    size = float(np.ptp(expected))
    np.testing.assert_allclose(run(core, u), expected, atol=1e-12 * size)
    columns = core.responses(u, np.zeros_like(u), core.settled(()))
    np.testing.assert_allclose(columns[:, 1:], moved, atol=1e-12)


@given(COMMANDS, arrays(np.float64, 60, elements=st.floats(0.0, 5.0)))
def test_more_command_is_more_displacement_and_its_gain_stays_within_its_bounds(u, above):
    core = uneven(8, share=0.7)
    assert np.all(run(core, u) <= run(core, u + above) + 1e-12)
    change, step = np.diff(run(core, u)), np.diff(u)
    slack = 1e-11
    assert np.all(np.abs(change) >= core.a0 * np.abs(step) - slack)
    assert np.all(np.abs(change) <= core.A * np.abs(step) + slack)


def test_its_largest_gain_is_met():
    core = uneven(5)
    u = path([-12.0, 12.0, -12.0], 4001)
    steepest = np.max(np.abs(np.diff(run(core, u))[1:] / np.diff(u)[1:]))
    assert steepest == pytest.approx(core.A, rel=1e-9)


def test_rest_is_what_a_slow_oscillation_leaves_that_dies_away():
    core = uneven(12)
    phase = np.linspace(0.0, 4000.0 * np.pi, 200_001)
    u = 14.0 * np.linspace(1.0, 0.0, len(phase)) * np.cos(phase)
    y = run(core, np.append(u, 0.0))
    assert abs(y[-1]) < 1e-3 * np.ptp(y)
    assert run(core, np.zeros(3)) == pytest.approx(np.zeros(3), abs=1e-13)


def test_weights_alike_along_diagonals_are_a_sum_of_plays():
    count, rng = 11, np.random.default_rng(4)
    by_diagonal = rng.random(count)
    each = np.array([by_diagonal[a - b] for a in range(count) for b in range(a + 1)])
    core = grid(count, each)
    slope = 2.0 * by_diagonal / core.ramp_V
    plays = RDPI((core.reversible_um_V + slope[0], *slope[1:]), core.thresholds_V, 0.0)
    u = np.clip(np.cumsum(rng.standard_normal(3000)), -10.0, 10.0)
    np.testing.assert_allclose(run(core, u), run(plays, u), atol=1e-11)


def density(a: Array, b: Array) -> Array:
    return np.asarray(np.exp(-0.02 * (a - 3.0) ** 2 - 0.05 * (b + 1.0) ** 2) * (1.2 + 0.1 * a))


def test_memory_of_other_weights_is_the_same_plays():
    one, other = uneven(9, seed=1), uneven(9, seed=2)
    u, rest = path([0.0, 7.0, -4.0, 5.0, -1.0], 200), path([-1.0, 3.0, -6.0, 9.0], 200)
    model = PlantModel(other, "demo", (-99.0, 99.0), (0.0, 5.0))  # type: ignore[arg-type]
    before = Plant(PlantModel(one, "demo", (-99.0, 99.0), (0.0, 5.0)), TS_S)  # type: ignore[arg-type]
    before.simulate(u)
    after = Plant(model, TS_S)
    after.reset(memory=before.memory)
    np.testing.assert_array_equal(
        after.simulate(rest), run(other, np.concatenate([u, rest]))[len(u) :]
    )
    columns = other.responses(rest, rest, before.memory[:, 0])
    np.testing.assert_allclose(
        columns, other.responses(np.append(u, rest), rest, other.settled(()))[len(u) :], atol=1e-12
    )
    after.reset(u0_V=-20.0, memory=before.memory)
    assert after.simulate(np.array([-20.0]))[0] == pytest.approx(run(other, np.array([-20.0]))[0])


def test_reversal_curves_give_its_numbers_back():
    core = uneven(12, c=0.3)
    u = reversal_curves(core, samples=150)
    columns = core.responses(u, np.zeros_like(u), core.settled(()))
    gains, _ = nnls(columns, run(core, u))
    np.testing.assert_allclose(gains, core.gains, rtol=1e-6)
    fitted = core.with_gains(gains)
    np.testing.assert_allclose(run(fitted, u), run(core, u), atol=1e-9)


def test_c_stays_above_zero_in_a_fit():
    core = grid(4).with_gains([-1.0, *[1.0] * 10])
    assert 0.0 < core.a0 < 1e-5 * core.A
    assert replace(core, reversible_um_V=0.0).a0 == 0.0


def test_evenly_spaced_levels_may_be_rounded():
    Preisach(0.1, (0.0, 3.3333333, 6.6666667, 10.0), 3.3333333, (1.0,) * 10)


def test_roughness_is_that_of_the_density_on_any_grid():
    for count in (5, 20):
        areas = np.array([1.0 if b < a else 0.5 for a in range(count) for b in range(a + 1)])
        rough = triangle_roughness(count)
        assert rough.shape == (1 + len(areas),) * 2
        even = np.concatenate([[3.0], areas])
        assert even @ rough @ even == pytest.approx(0.0, abs=1e-9)
    # p = s (α ± β) over a triangle of side L and area L²/2: slopes along the diagonals 2 s and 0
    area = 20.0**2 / 2.0
    for sign, slopes in ((1, 4.0 + 0.125), (-1, 0.125)):
        values = []
        for count in (20, 40):
            apart = 20.0 / count
            weights = [
                0.01 * (a + sign * b) * apart * apart**2 * (1.0 if b < a else 0.5)
                for a in range(count)
                for b in range(a + 1)
            ]
            gains = np.array([0.0, *weights])
            values.append(float(gains @ triangle_roughness(count) @ gains))
        exact = 20.0**4 * slopes * 0.01**2 * area
        assert values[0] == pytest.approx(exact, rel=0.11)
        assert values[1] == pytest.approx(exact, rel=0.06)


def test_a_price_on_roughness_keeps_weights_from_learning_noise():
    count = 10
    core = grid(count)
    a, b = np.array([(a, b) for a in core.levels_V for b in core.levels_V if b <= a]).T
    truth = density(a, b) * core.apart_V**2 * np.where(a > b, 1.0, 0.5)
    core = replace(core, weights_um=tuple(truth.tolist()))
    u = reversal_curves(core, samples=20)
    rng = np.random.default_rng(2)
    y = run(core, u)
    noisy = y + 0.01 * np.ptp(y) * rng.standard_normal(len(u))
    columns = core.responses(u, np.zeros_like(u), core.settled(()))
    miss = []
    for price in (0.0, 1e-6):
        rough = price * len(u) * triangle_roughness(count)
        values, vectors = np.linalg.eigh(rough)
        root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        gains, _ = nnls(np.vstack([columns, root]), np.append(noisy, np.zeros(len(root))))
        miss.append(float(np.linalg.norm(gains[1:] - truth) / np.linalg.norm(truth)))
    assert miss[1] < 0.1 < 0.3 < miss[0]
