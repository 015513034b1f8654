"""Linear effects are exact for an input that is linear between samples, at every Ts."""

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.signal import lsim

from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.creep import TIME_CONSTANTS_S
from rdpi_gym.plant.effects.linear import linear_block, pack_modes
from rdpi_gym.plant.parameters import DataScale
from tests.looping import over

W0, ZETA = 2 * np.pi * 700.0, 0.03
SYSTEMS = {
    "actuator_lag": ({"time_constant_s": 3e-4}, ([1.0], [3e-4, 1.0])),
    "sensor_lag": ({"time_constant_s": 3e-4}, ([1.0], [3e-4, 1.0])),
    "resonance": ({"f0_hz": 700.0, "damping": ZETA}, ([W0**2], [1.0, 2 * ZETA * W0, W0**2])),
}


def rough(length: int, seed: int = 3) -> np.ndarray:
    x = np.random.default_rng(seed).normal(0, 5, length).cumsum()
    return x - x[0]


@over("ts", [1e-5, 1e-4, 1e-3, 1e-2])
@over("name", SYSTEMS)
def test_stage_equals_lsim_with_a_first_order_hold(name, ts):
    values, system = SYSTEMS[name]
    x = rough(300)
    expected = lsim(system, x, np.arange(300) * ts, interp=True)[1]
    y = CATALOGUE[name](**values).run(x, ts)
    np.testing.assert_allclose(y, expected, atol=1e-7 * np.abs(x).max())


@over("name", SYSTEMS)
def test_stage_equals_the_differential_equation_between_corners(name):
    values, (_, denominator) = SYSTEMS[name]
    ts, x = 2e-4, rough(40)
    times = np.arange(40) * ts
    order = len(denominator) - 1

    def slope(t: float, z: np.ndarray) -> list[float]:
        drive = np.interp(t, times, x) - z[0]
        if order == 1:
            return [drive / denominator[0]]
        return [z[1], W0**2 * drive - 2 * ZETA * W0 * z[1]]

    z, expected = np.zeros(order), [0.0]
    for begin, end in pairwise(times):
        z = solve_ivp(slope, (begin, end), z, rtol=1e-10, atol=1e-10).y[:, -1]
        expected.append(z[0])
    y = CATALOGUE[name](**values).run(x, ts)
    np.testing.assert_allclose(y, expected, atol=1e-6 * np.abs(x).max())


LINEAR = {**{k: v[0] for k, v in SYSTEMS.items()}, "delay": {"delay_s": 3.3e-4}, "creep": {}}


@over("name", LINEAR)
def test_input_linear_between_samples_gives_the_same_at_an_eighth_of_ts(name):
    effect = CATALOGUE[name](**LINEAR[name])
    x, ts = rough(200), 1e-3
    fine = np.interp(np.arange(199 * 8 + 1) / 8, np.arange(200), x)
    np.testing.assert_allclose(
        effect.run(fine, ts / 8)[::8], effect.run(x, ts), atol=1e-9 * np.abs(x).max()
    )


@over("name", [*LINEAR, "slew_limit"])
def test_a_parameter_means_the_same_at_every_sampling_time(name):
    """A smooth input at Ts and Ts/8: they differ by less than 2 (ω Ts)² of the amplitude."""
    effect = CATALOGUE[name](**LINEAR.get(name, {"rate_V_s": 2000.0}))
    for ts in (4e-4, 1e-4):
        t = np.arange(round(0.1 / ts * 8) + 1) * ts / 8
        x = 10 * np.sin(2 * np.pi * 40 * t)
        difference = effect.run(x, ts / 8)[::8] - effect.run(x[::8], ts)
        assert np.abs(difference).max() < 2 * (2 * np.pi * 40 * ts) ** 2 * 10


def van_loan(a, b, ts):
    """F, G0, G1 of x' = a x + b u for u linear over each interval, by a block exponential."""
    m = len(b)
    block = np.zeros((m + 2, m + 2))
    block[:m, :m], block[:m, m], block[m, m + 1] = a * ts, b * ts, 1.0
    step = expm(block)
    return step[:m, :m], step[:m, m] - step[:m, m + 1], step[:m, m + 1]


@over("ts", [1e-7, 1e-5, 1e-3, 3e-2])
@over("damping", [1e-4, 0.03, 0.7])
def test_modes_in_closed_form_are_the_block_exponential(ts, damping):
    w = 2 * np.pi * 90.0
    a, b = np.array([[0.0, w], [-w, -2 * damping * w]]), np.array([0.0, w])
    expected = np.concatenate([part.ravel() for part in van_loan(a, b, ts)])
    found = pack_modes([(1.0, 90.0, damping)], 0.0, ts)
    np.testing.assert_allclose(found[:8], expected, atol=1e-11)
    assert found[8:] == [1.0, 0.0, 0.0, 1.0, 0.0]


def test_linear_block_takes_any_order_and_a_feedthrough():
    a = np.array([[-50.0, 20.0, 0.0], [-20.0, -50.0, 3.0], [1.0, 0.0, -7.0]])
    b, c = np.array([1.0, 2.0, -1.0]), np.array([3.0, -4.0, 20.0])
    ts, x = 5e-3, rough(150)
    f, g0, g1 = van_loan(a, b, ts)
    p = np.array([*f.ravel(), *g0, *g1, *c, 0.4, *np.linalg.solve(-a, b)])[:, None]
    y, state = np.empty((150, 1)), np.full((4, 1), np.nan)
    linear_block(x[:, None].copy(), x[:, None].copy(), p, state, ts, y)
    system = (a, b[:, None], c[None, :], np.array([[0.4]]))
    expected = lsim(system, x, np.arange(150) * ts, interp=True)[1]
    np.testing.assert_allclose(y[:, 0], expected, atol=1e-10 * np.abs(x).max())


@over("samples", [0.0, 0.25, 1.0, 1.5, 7.0, 7.75, 60.5])
def test_delay_shifts_a_polyline_exactly(samples):
    x, index = rough(200), np.arange(200.0)
    expected = np.interp(index - samples, index, x)
    y = CATALOGUE["delay"](delay_s=samples * 1e-4).run(x, 1e-4)
    np.testing.assert_allclose(y, expected, atol=1e-9)


def test_slew_limit_is_exact_where_output_and_command_meet_between_samples():
    effect = CATALOGUE["slew_limit"](rate_V_s=100.0)
    x = rough(120)
    fine = np.interp(np.arange(119 * 512 + 1) / 512, np.arange(120), x)
    coarse, expected = effect.run(x, 1e-2), effect.run(fine, 1e-2 / 512)[::512]
    np.testing.assert_allclose(coarse, expected, atol=1e-9)
    assert np.abs(np.diff(coarse)).max() <= 1.0 + 1e-12
    # The same limiter in the small: 512 clipped steps a sample.
    naive, value = [x[0]], x[0]
    for k in range(1, len(fine)):
        value += np.clip(fine[k] - value, -1.0 / 512, 1.0 / 512)
        naive.append(value)
    np.testing.assert_allclose(coarse, naive[::512], atol=0.1)


def test_every_element_of_creep_is_an_exact_lag():
    x, ts = rough(400), 0.02
    lag, gain = CATALOGUE["sensor_lag"], 0.04
    elements = [lag(time_constant_s=tau).run(x, ts) for tau in TIME_CONSTANTS_S if tau <= 0.1]
    times = np.arange(400) * ts
    for tau in TIME_CONSTANTS_S:
        if tau > 0.1:
            elements.append(lsim(([1.0], [tau, 1.0]), x, times, interp=True)[1])
    expected = x + gain / 2 * np.sum(elements, axis=0)
    y = CATALOGUE["creep"](gain_per_decade=gain).run(x, ts)
    np.testing.assert_allclose(y, expected, atol=1e-9 * np.abs(x).max())


def test_every_mode_that_the_sampling_shows_lies_near_a_start():
    """A mode that rings for fifteen periods was not found from a start 12 % above it."""
    ts = 5e-5
    scale = DataScale(0.0, 40.0, 40.0, 3e3, ts, 0.6)
    starts = np.array([start.values["f0_hz"] for start in CATALOGUE["resonance"].starts(scale)])
    modes = np.geomspace(0.01 / ts, 0.25 / ts, 200)
    nearest = np.abs(np.log(modes[:, None] / starts)).min(axis=1)
    assert nearest.max() < np.log(1.25)
