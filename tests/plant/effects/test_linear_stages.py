"""Linear and slow effects in all forms: exact for an input linear between samples, nested, of static gain one."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.linalg import expm
from scipy.signal import lsim

from rdpi_gym.plant.effects import CATALOGUE, DataScale, forms_of
from rdpi_gym.plant.effects.linear import linear_block, pack_modes, pack_two_lags
from tests.looping import over

SCALE = DataScale(0.0, 40.0, 40.0, 3e3, 1e-4, 10.0, end_s=90.0)


def form(name, words):
    return next(kind for kind in forms_of(CATALOGUE[name]) if kind.form == words)


def rough(length, seed=3):
    x = np.random.default_rng(seed).normal(0, 5, length).cumsum()
    return x - x[0]


def mode(f0_hz, damping):
    w = 2 * np.pi * f0_hz
    return [w * w], [1.0, 2 * damping * w, w * w]


def side_by_side(*paths):
    """Numerator and denominator of shares of modes, none for a share that is static."""
    num, den = np.zeros(1), np.ones(1)
    for share, path in paths:
        n, d = path or ([1.0], [1.0])
        num, den = np.polyadd(np.polymul(num, d), share * np.polymul(n, den)), np.polymul(den, d)
    return num, den


W0, ZETA = 2 * np.pi * 700.0, 0.03
SYSTEMS = {
    "actuator_lag": ({"time_constant_s": 3e-4}, ([1.0], [3e-4, 1.0])),
    "sensor_lag": ({"time_constant_s": 3e-4}, ([1.0], [3e-4, 1.0])),
    "resonance": ({"f0_hz": 700.0, "damping": ZETA}, ([W0**2], [1.0, 2 * ZETA * W0, W0**2])),
}
LINEAR = {
    **{(name, "", None): system for name, system in SYSTEMS.items()},
    **{
        (name, "second order", ratio): (
            {"time_constant_s": 7e-4, "second_ratio": ratio},
            ([1.0], [ratio * 7e-4**2, (1 + ratio) * 7e-4, 1.0]),
        )
        for name in ("actuator_lag", "sensor_lag")
        for ratio in (1e-3, 0.4, 0.999, 0.9999999, 1.0)
    },
    **{
        (name, "fourth order", (c, d, e)): (
            {"time_constant_s": 7e-4, "second_share": c, "third_share": d, "fourth_share": e},
            ([1.0], [c * c * d * (1 - d) * e * 7e-4**4, c * d * 7e-4**3, c * 7e-4**2, 7e-4, 1.0]),
        )
        for name, c, d, e in (
            ("sensor_lag", 3 / 7, 2 / 9, 0.3),  # of Bessel
            ("sensor_lag", 0.5, (2**0.5 - 1) / 2**0.5, 2**0.5 - 1),  # of Butterworth
            ("sensor_lag", 3 / 8, 1 / 6, 0.2),  # four equal poles
            ("sensor_lag", 0.5, 1 / 4, 0.0),  # third order of Butterworth
            ("actuator_lag", 0.2, 0.01, 0.1),
        )
    },
    ("resonance", "with a zero", 0.25): (
        {"f0_hz": 700.0, "damping": 0.03, "static_share": 0.25},
        side_by_side((0.75, mode(700.0, 0.03)), (0.25, None)),
    ),
    ("resonance", "two modes", 0.2): (
        {"f0_hz": 700.0, "damping": 0.03, "second_hz": 1900.0, "second_damping": 0.05,
         "second_share": 0.2},
        side_by_side((0.8, mode(700.0, 0.03)), (0.2, mode(1900.0, 0.05))),
    ),
}  # fmt: skip


@over("ts", [1e-5, 1e-4, 1e-3, 1e-2])
@over("case", LINEAR)
def test_a_linear_form_equals_lsim_with_a_first_order_hold(case, ts):
    values, system = LINEAR[case]
    x = rough(300)
    expected = lsim(system, x, np.arange(300) * ts, interp=True)[1]
    y = form(*case[:2])(**values).run(x, ts)
    np.testing.assert_allclose(y, expected, atol=1e-7 * np.abs(x).max())


@over("case", LINEAR)
def test_a_linear_form_has_a_static_gain_of_one(case):
    effect = form(*case[:2])(**LINEAR[case][0])
    assert effect.run(np.r_[0.0, np.full(20000, 7.0)], 1e-4)[-1] == pytest.approx(7.0, rel=1e-9)
    np.testing.assert_allclose(effect.run(np.full(50, 7.0), 1e-4), 7.0, rtol=1e-12)


@over("ts", [1e-7, 1e-4, 1.0])
@over("ratio", [0.0, 1e-9, 1e-4, 0.5, 1.0 - 1e-12, 1.0])
def test_two_lags_stay_lags_at_any_ratio_of_their_times(ratio, ts):
    """The numbers of two lags in a row lie between 0 and 1 and what comes in adds up to 1."""
    p = np.array(pack_two_lags(1e-3, ratio * 1e-3, ts))
    assert np.all(p[:8] >= -1e-15)
    assert np.all(p[:8] <= 1.0 + 1e-15)
    np.testing.assert_allclose([p[0] + p[4] + p[6], p[2] + p[3] + p[5] + p[7]], 1.0, atol=1e-14)


@over("ratio", [0.0, 0.02, 0.5, 1.0])
@over("ts", [1e-6, 1e-4, 1e-2])
def test_two_lags_are_a_filter_without_its_third_order(ratio, ts):
    x = rough(500)
    two = form("actuator_lag", "second order")(4e-4, ratio)
    shares = {"second_share": ratio / (1 + ratio) ** 2, "third_share": 0.0}
    one = form("actuator_lag", "fourth order")(4e-4 * (1 + ratio), **shares)
    np.testing.assert_allclose(one.run(x, ts), two.run(x, ts), atol=1e-10 * np.abs(x).max())


@over("ts", [1e-4, 3e-3])
@over("samples", [0.0, 0.4, 1.0, 9.6])
def test_a_delay_in_samples_is_that_delay_at_every_sampling_time(samples, ts):
    x = rough(200)
    plain = CATALOGUE["delay"](delay_s=samples * ts) if samples * ts <= 0.02 else None
    y = form("delay", "whole samples")(samples).run(x, ts)
    np.testing.assert_allclose(y, np.interp(np.arange(200) - samples, np.arange(200), x), atol=1e-9)
    if plain is not None:
        np.testing.assert_allclose(y, plain.run(x, ts), atol=1e-9)


def test_a_gain_that_settles_ends_at_its_limit_and_begins_as_a_linear_drift():
    x, ts = np.full(4001, 10.0), 0.1
    y = form("gain_drift", "to a limit")(rate_per_s=1e-3, time_constant_s=20.0).run(x, ts)
    assert y[-1] == pytest.approx(10.0 * (1.0 + 1e-3 * 20.0), rel=1e-6)
    linear = CATALOGUE["gain_drift"](rate_per_s=1e-3).run(x, ts)
    t = ts * np.arange(4001)
    short = linear - y  # Taylor: κ t² / (2 τ), less what the next power takes back
    assert np.all(short <= 10.0 * 1e-3 * t**2 / 40.0 + 1e-12)
    assert np.all(short >= 10.0 * 1e-3 * (t**2 / 40.0 - t**3 / 2400.0) - 1e-12)


def test_straight_lines_between_knots_are_any_polyline_and_stay_where_they_end():
    knots = [0.3, -0.2, 0.5, 0.5, 0.1, -0.4]
    kind = form("thermal_drift", "piecewise linear")
    wander = kind(60.0, *knots)
    t = 0.37 * np.arange(300)
    expected = np.interp(t, 10.0 * np.arange(7), [0.0, *knots])
    np.testing.assert_allclose(wander.run(np.full(300, 5.0), 0.37), 5.0 + expected, atol=1e-12)
    gain = form("gain_drift", "piecewise linear")(60.0, *knots)
    np.testing.assert_allclose(gain.run(np.full(300, 5.0), 0.37), 5.0 * (1 + expected), atol=1e-12)


def curve(name, duration_s, knots):
    kind = form(name, "smooth curve")
    names = [p.name for p in kind.parameters if not p.fixed]
    return kind(duration_s=duration_s, **dict(zip(names, knots, strict=True)))


COUNT = len(form("thermal_drift", "smooth curve").parameters) - 1


def test_a_smooth_curve_is_the_natural_spline_through_its_knots_and_stays_where_it_ends():
    knots = np.random.default_rng(5).normal(0.0, 0.3, COUNT)
    natural = CubicSpline(10.0 * np.arange(COUNT + 1), [0.0, *knots], bc_type="natural")
    t = 0.37 * np.arange(700)
    expected = np.where(t < 10.0 * COUNT, natural(t), knots[-1])
    drift = curve("thermal_drift", 10.0 * COUNT, knots)
    np.testing.assert_allclose(drift.run(np.full(700, 5.0), 0.37), 5.0 + expected, atol=1e-12)
    gain = curve("gain_drift", 10.0 * COUNT, knots)
    np.testing.assert_allclose(gain.run(np.full(700, 5.0), 0.37), 5.0 * (1 + expected), atol=1e-12)


def test_hum_with_harmonics_is_a_sum_of_sines():
    kind = form("mains_hum", "with harmonics")
    values = dict(zip(("second_sine_um", "second_cosine_um"), (0.03, -0.02), strict=True))
    hum = kind(0.05, 50.3, 0.4, **values, third_sine_um=-0.01, third_cosine_um=0.04)
    t = 1e-4 * np.arange(30000)
    angle = 2 * np.pi * 50.3 * t
    expected = 0.05 * np.sin(angle + 0.4) + 0.03 * np.sin(2 * angle) - 0.02 * np.cos(2 * angle)
    expected += -0.01 * np.sin(3 * angle) + 0.04 * np.cos(3 * angle)
    np.testing.assert_allclose(hum.run(np.zeros(30000), 1e-4), expected, atol=1e-11)
    fifth = form("mains_hum", "with harmonics to the fifth")
    more = fifth(**hum.values, fourth_cosine_um=0.02, fifth_sine_um=-0.03)
    expected += 0.02 * np.cos(4 * angle) - 0.03 * np.sin(5 * angle)
    np.testing.assert_allclose(more.run(np.zeros(30000), 1e-4), expected, atol=1e-11)
    assert fifth.from_simpler(hum, SCALE) == (fifth(**hum.values),)


STARTED = {
    ("sensor_lag", "second order"): {"time_constant_s": 3e-4},
    ("actuator_lag", "second order"): {"time_constant_s": 3e-4},
    ("sensor_lag", "fourth order"): {"time_constant_s": 3e-4},
    ("resonance", "with a zero"): {"f0_hz": 600.0, "damping": 0.05},
    ("resonance", "two modes"): {"f0_hz": 600.0, "damping": 0.05},
    ("gain_drift", "to a limit"): {"rate_per_s": 2e-4},
    ("gain_drift", "piecewise linear"): {"rate_per_s": 2e-4},
    ("gain_drift", "smooth curve"): {"rate_per_s": 2e-4},
    ("thermal_drift", "two time constants"): {"rate_um_s": 0.01, "time_constant_s": 30.0},
    ("thermal_drift", "piecewise linear"): {"rate_um_s": 0.01, "time_constant_s": 30.0},
    ("thermal_drift", "smooth curve"): {"rate_um_s": 0.01, "time_constant_s": 30.0},
    ("mains_hum", "with harmonics"): {"amplitude_um": 0.5, "phase_rad": 0.3},
    ("delay", "whole samples"): {"delay_s": 2e-4},
}


@over("case", STARTED)
def test_a_form_starts_close_to_the_simpler_one_that_was_fitted(case):
    """One start at least changes a fraction of what the simpler form explains already."""
    simpler = CATALOGUE[case[0]](**STARTED[case])
    ts = SCALE.lasts_s / 4500 if case[0].endswith("drift") else SCALE.shortest_s
    x = 30.0 * np.sin(2 * np.pi * np.arange(4500) * 0.01)
    known = simpler.run(x, ts)
    starts = form(*case).from_simpler(simpler, SCALE)
    nearest = min(np.std(start.run(x, ts) - known) for start in starts)
    assert nearest <= 0.2 * np.std(known - x)


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


def test_every_mode_that_the_sampling_shows_lies_near_a_start():
    """A mode that rings for fifteen periods was not found from a start 12 % above it."""
    ts = 5e-5
    scale = DataScale(0.0, 40.0, 40.0, 3e3, ts, 0.6)
    starts = np.array([start.values["f0_hz"] for start in CATALOGUE["resonance"].starts(scale)])
    modes = np.geomspace(0.01 / ts, 0.25 / ts, 200)
    nearest = np.abs(np.log(modes[:, None] / starts)).min(axis=1)
    assert nearest.max() < np.log(1.25)


@over("low_um", [0.0, 3.0])
def test_a_mode_that_rings_is_the_highest_peak_of_a_residual_over_its_surroundings(low_um):
    t = np.arange(6000) * 1e-4
    left = low_um * np.sin(2 * np.pi * 10.0 * t) + 0.1 * np.random.default_rng(0).normal(
        size=t.size
    )
    for corner in 0.05 + 0.1 * np.arange(5):
        after = np.maximum(t - corner, 0.0)
        left += np.exp(-0.05 * W0 * after) * np.sin(W0 * after)
    first, *_ = CATALOGUE["resonance"].seen_in(t, left)
    assert first.f0_hz == pytest.approx(700.0, rel=0.05)


@over("ts", [1e-6, 1e-3])
def test_a_filter_is_stable_wherever_its_numbers_lie(ts):
    rng = np.random.default_rng(0)
    kind = form("sensor_lag", "fourth order")
    for _ in range(300):
        shares = 10.0 ** rng.uniform(-6.0, 0.0, 3) * [1.0, 0.8, 0.8]
        p = kind(10.0 ** rng.uniform(-12.0, -1.0), *shares).coefficients(ts, None)
        assert np.abs(np.linalg.eigvals(np.reshape(p[:16], (4, 4)))).max() < 1.0
