"""Further forms of effects: nested in each other, exact between samples, right at rest."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from rdpi_gym.plant import P10, RDPI, Plant
from rdpi_gym.plant.effects import CATALOGUE, Effect, forms_of, load_effect
from rdpi_gym.plant.effects.base import DataScale
from rdpi_gym.plant.effects.creep import TIME_CONSTANTS_S
from tests.looping import over

TS = 1e-3
LINEAR_NAMES = {
    "actuator_lag", "sensor_lag", "resonance", "thermal_drift", "mains_hum", "gain_drift",
}  # fmt: skip
FORMS = [kind for simplest in CATALOGUE.values() for kind in forms_of(simplest)[1:]]


def form(name: str, words: str = "") -> type[Effect]:
    return load_effect(name, words)


def rough(length: int = 400, seed: int = 3) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, 5, length).cumsum()


def ran(effect: Effect, x: np.ndarray, ts: float = TS) -> np.ndarray:
    return effect.run(x, ts, 0.9 * x + 2.0 * np.sin(x), P10.hysteresis)


NESTED = [  # an effect, a form with its numbers, and a simpler form that is the same
    ("creep", "between two times", (0.02, 10**-2.25, 10**3.25), "", (0.02,)),
    ("creep", "between two times", (0.02, 10**3.25, 10**-2.25), "", (0.02,)),
    ("creep", "two time constants", (0.03, 0.2, 0.0, 7.0), "one time constant", (0.03, 0.2)),
    ("creep", "two time constants", (0.01, 0.2, 0.02, 0.2), "one time constant", (0.03, 0.2)),
    ("creep", "three time constants", (0.01, 0.2, 0.0, 1.0, 0.02, 7.0), "two time constants", (0.01, 0.2, 0.02, 7.0)),
    ("creep", "spectrum", (0.0, 0.01, 0.0, 0.02, 0.0, 0.0), "two time constants", (0.01, 0.1, 0.02, 10.0)),
    ("saturation", "hard rails", (-1e9, 9.0), "hard upper rail", (9.0,)),
    ("saturation", "hard rails", (-9.0, 1e9), "hard lower rail", (-9.0,)),
    ("saturation", "soft unlike rails", (60.0, 3.0), "", (60.0, 3.0)),
    ("asymmetry", "cubic", (0.1, 0.0, 30.0), "", (0.1, 30.0)),
    ("asymmetry", "unlike branches", (0.1, 0.0, 5.0, 30.0), "", (0.1, 30.0)),
    ("asymmetry", "to the fifth degree", (0.1, -0.2, 0.0, 0.0, 30.0), "cubic", (0.1, -0.2, 30.0)),
    ("rate_law", "piecewise power", (0.6, 0.6, 0.6, 0.6, 30.0), "", (0.6, 30.0)),
    ("slew_limit", "unlike up and down", (4e3, 4e3), "", (4e3,)),
    ("congruency", "about the middle of the range", (0.2, 30.0, 0.0), "", (0.2, 30.0)),
    ("congruency", "odd and even", (0.0, 0.2, 30.0), "", (0.2, 30.0)),
    ("congruency", "to the fourth degree", (-0.1, 0.2, 0.0, 0.0, 30.0), "odd and even", (-0.1, 0.2, 30.0)),
    ("actuator_lag", "second order", (4e-4, 0.0), "", (4e-4,)),
    ("sensor_lag", "second order", (4e-4, 0.0), "", (4e-4,)),
    ("sensor_lag", "fourth order", (4e-4, 0.0, 0.3, 0.1), "", (4e-4,)),
    ("resonance", "with a zero", (700.0, 0.03, 0.0), "", (700.0, 0.03)),
    ("resonance", "two modes", (700.0, 0.03, 90.0, 0.1, 0.0), "", (700.0, 0.03)),
    ("thermal_drift", "two time constants", (0.3, 20.0, 0.0, 90.0), "", (0.3, 20.0)),
    ("mains_hum", "with harmonics", (0.4, 49.9, 0.7), "", (0.4, 49.9, 0.7)),
    ("gain_drift", "to a limit", (1e-5, 1e7), "", (1e-5,)),
]  # fmt: skip


@over("name, richer, numbers, simpler, fewer", NESTED)
def test_a_richer_form_holds_the_simpler_one(name, richer, numbers, simpler, fewer):
    # a slow change is compared at a time that is short against its constant
    ts, x = (1e-4, rough(1500)) if name in LINEAR_NAMES else (TS, rough())
    size = 1e-12 * np.abs(x).max()
    found, expected = (form(name, w)(*n) for w, n in ((richer, numbers), (simpler, fewer)))
    np.testing.assert_allclose(ran(found, x, ts), ran(expected, x, ts), rtol=1e-12, atol=size)


@over(
    "kind",
    [
        f
        for f in FORMS
        if f.name in ("asymmetry", "congruency", "creep") or f.form == "piecewise power"
    ],
)
def test_a_form_at_its_neutral_values_changes_nothing(kind):
    x = rough()
    neutral = {p.name: p.neutral for p in kind.parameters if p.neutral is not None}
    np.testing.assert_allclose(ran(kind(**neutral), x), x, rtol=1e-12)


@over("words", [kind.form for kind in forms_of(CATALOGUE["creep"])])
@over("ts", [1e-4, 0.3])
def test_creep_in_every_form_is_a_sum_of_exact_lags(words, ts):
    effect = form("creep", words)()
    x = rough()
    ladder = [0.015 / 2] * len(TIME_CONSTANTS_S), TIME_CONSTANTS_S
    gains, taus = effect.elements() if words else ladder
    times = np.arange(len(x)) * ts
    elements = [lsim(([1.0], [tau, 1.0]), x - x[0], times)[1] + x[0] for tau in taus]
    expected = x + np.asarray(gains) @ np.array(elements)
    # lsim loses digits where the time constant is many samples long
    np.testing.assert_allclose(ran(effect, x, ts), expected, atol=1e-6 * np.abs(x).max())


@over("words", [kind.form for kind in forms_of(CATALOGUE["creep"])[1:]])
def test_creep_begins_at_rest_and_ends_with_its_whole_gain(words):
    effect = form("creep", words)()
    gains, taus = effect.elements()
    whole = 1.0 + np.sum(gains)
    np.testing.assert_allclose(ran(effect, np.full(50, 7.0)), 7.0 * whole, rtol=1e-12)
    step = effect.run([1.0] + [3.0] * 200, 0.2 * max(taus))
    assert step[-1] == pytest.approx(3.0 * whole, rel=1e-9)


def test_elements_between_two_times_are_those_of_the_simplest_ladder_at_its_ends():
    _, taus = form("creep", "between two times")(0.02, 10**-2.25, 10**3.25).elements()
    np.testing.assert_allclose(taus, TIME_CONSTANTS_S, rtol=1e-12)


@over("powers", [(0.3, -0.2), (0.3, -0.2, 0.1, 0.05)])
def test_asymmetry_is_a_polynomial_of_the_displacement_and_congruency_one_of_the_command(powers):
    words = {2: ("cubic", "odd and even"), 4: ("to the fifth degree", "to the fourth degree")}
    bent, weighted = words[len(powers)]
    x, u, span = rough(), rough(seed=4), 30.0
    polynomial = np.polynomial.Polynomial([0.0, *powers])
    expected = x * (1.0 + polynomial(x / span))
    np.testing.assert_allclose(form("asymmetry", bent)(*powers, span).run(x, TS), expected)
    linear = P10.hysteresis.a0 * u
    expected = linear + (1.0 + polynomial(u / span)) * (x - linear)
    y = form("congruency", weighted)(*powers, span).run(x, TS, u, P10.hysteresis)
    np.testing.assert_allclose(y, expected, atol=1e-9 * np.abs(x).max())


def test_asymmetry_of_the_command_does_not_see_the_displacement():
    x, u = rough(), rough(seed=4)
    added = form("asymmetry", "of the command")(0.3, -0.2, 30.0, 50.0).run(x, TS, u) - x
    expected = 50.0 * (0.3 * (u / 30.0) ** 2 - 0.2 * (u / 30.0) ** 3)
    np.testing.assert_allclose(added, expected, atol=1e-9 * np.abs(x).max())


def test_thresholds_grow_with_the_rate_as_the_law_says():
    v = np.geomspace(1e-3, 1e6, 91)
    bent = form("rate_law", "logarithm")(200.0)
    np.testing.assert_allclose(bent.run(v, TS), 200.0 * np.log(1.0 + v / 200.0), rtol=1e-9)
    np.testing.assert_array_equal(bent.run(-v, TS), -bent.run(v, TS))
    law = form("rate_law", "piecewise power")(0.3, 2.0, 0.5, 1.5, 1e4)
    slopes = np.diff(np.log(law.run(v, TS))) / np.diff(np.log(v))
    exponents = [1.5] * 55 + [0.5] * 5 + [2.0] * 5 + [0.3] * 25
    np.testing.assert_allclose(slopes, exponents, rtol=1e-9)
    np.testing.assert_array_equal(law.run([0.0, -1e4, 1e-320], TS)[:2], [0.0, -1e4])


def test_unlike_slew_limits_turn_round_where_output_and_command_meet():
    """Finely sampled, where turning between samples matters no more, the same comes out."""
    x = rough(60)
    fine = np.interp(np.arange(59 * 512 + 1) / 512, np.arange(60), x)
    up, down = 3.0 / 512, 5.0 / 512
    naive, value = [x[0]], x[0]
    for k in range(1, len(fine)):
        value += np.clip(fine[k] - value, -down, up)
        naive.append(value)
    y = form("slew_limit", "unlike up and down")(3.0 / TS, 5.0 / TS).run(x, TS)
    np.testing.assert_allclose(y, naive[::512], atol=0.05)
    assert -5.0 - 1e-9 <= np.diff(y).min() < -4.9
    assert 2.9 < np.diff(y).max() <= 3.0 + 1e-9


def test_a_current_limit_behind_a_resistance_is_the_clipped_lag_finely_integrated():
    x, fine = rough(60), 512
    ramps = np.interp(np.arange(59 * fine + 1) / fine, np.arange(60), x)
    up, down, lag, value = 3.0, 5.0, 0.7, x[0]  # V, V, samples
    naive = [value]
    for k in range(1, len(ramps)):
        now = 0.5 * (ramps[k - 1] + ramps[k])
        half = value + 0.5 * np.clip((ramps[k - 1] - value) / lag, -down, up) / fine
        value += np.clip((now - half) / lag, -down, up) / fine
        naive.append(value)
    y = form("slew_limit", "through a resistance")(up / TS, down / TS, lag * TS).run(x, TS)
    np.testing.assert_allclose(y, naive[::fine], atol=1e-4)
    assert 2.9 < np.diff(y).max() <= 3.0 + 1e-9
    wide = form("slew_limit", "through a resistance")(1e9, 1e9, lag * TS).run(x, TS)
    lagged = CATALOGUE["actuator_lag"](time_constant_s=lag * TS).run(x, TS)
    np.testing.assert_allclose(wide, lagged, rtol=1e-9, atol=1e-9)


def test_a_soft_current_limit_is_a_lag_of_slow_signals_and_never_faster_than_its_limit():
    x = rough(60)
    up, down, lag = 3.0, 5.0, 0.7
    soft = form("slew_limit", "with a soft limit")
    y = soft(up / TS, down / TS, lag * TS, 3.0).run(x, TS)
    assert np.diff(y).min() >= -5.0 - 1e-9
    assert np.diff(y).max() <= 3.0 + 1e-9
    sharp = soft(up / TS, down / TS, lag * TS, 20.0).run(x, TS)
    clipped = form("slew_limit", "through a resistance")(up / TS, down / TS, lag * TS).run(x, TS)
    np.testing.assert_allclose(sharp, clipped, atol=0.15)
    wide = soft(1e9, 1e9, lag * TS, 3.0).run(x, TS)
    lagged = CATALOGUE["actuator_lag"](time_constant_s=lag * TS).run(x, TS)
    np.testing.assert_allclose(wide, lagged, atol=1e-3)
    # a ramp at three fifths of the limit is late by τ (1 - s^p)^(-1/p)
    ramp = 0.6 * up * np.arange(200.0)
    late = (ramp - soft(up / TS, down / TS, lag * TS, 2.0).run(ramp, TS))[-1]
    assert late == pytest.approx(0.6 * up * lag / 0.8, rel=1e-6)


def test_unlike_branches_are_told_by_a_stop_of_the_command():
    """Beyond twice the reach after a turn each branch has its own parabola."""
    u = np.concatenate([np.linspace(0.0, 40.0, 81), np.linspace(40.0, -40.0, 161)])
    effect = form("asymmetry", "unlike branches")(0.1, 0.04, 5.0, 30.0)
    bent = (effect.run(u, TS, u) - u) * 30.0
    np.testing.assert_allclose(bent[12:81], 0.14 * u[12:81] ** 2, rtol=1e-9)
    np.testing.assert_allclose(bent[110:], 0.06 * u[110:] ** 2, rtol=1e-9, atol=1e-12)
    between = bent[82:101] / u[82:101] ** 2
    assert np.all(np.diff(between) < 0.0)
    assert 0.06 < between[-1] < between[0] < 0.14


def test_envelopes_that_are_alike_bend_the_command_of_the_plays_alone():
    """The plays are those of γ(u), and a_0 u is not bent."""
    core = RDPI((0.7, 0.3, 0.2), (2.0, 5.0), 0.0)
    u = 40.0 * np.sin(np.arange(900) / 30.0) * np.linspace(0.2, 1.0, 900)
    effect = form("asymmetry", "unlike envelopes")(0.2, 0.1, 0.2, 0.1, centre_V=5.0, span_V=60.0)
    s = (u - 5.0) / 60.0
    bent = u + 60.0 * (0.2 * s**2 + 0.1 * s**3)
    bare = replace(P10, hysteresis=core, effects=())
    y = Plant(replace(bare, effects=(effect,)), TS).simulate(u)
    plays = Plant(bare, TS).simulate(bent) - 0.7 * bent
    np.testing.assert_allclose(y, 0.7 * u + plays, rtol=0, atol=1e-12 * 40.0)


def test_each_branch_runs_along_its_own_envelope():
    core = RDPI((0.7, 0.5), (3.0,), 0.0)
    u = np.concatenate([np.linspace(0.0, 40.0, 81), np.linspace(40.0, -40.0, 161)])
    effect = form("asymmetry", "unlike envelopes")(0.3, 0.0, 0.1, 0.0, centre_V=0.0, span_V=60.0)
    y = Plant(replace(P10, hysteresis=core, effects=(effect,)), TS).simulate(u)
    play = (y - 0.7 * u) / 0.5
    rising, falling = slice(10, 81), slice(130, 241)
    np.testing.assert_allclose(
        play[rising], u[rising] - 3.0 + 0.3 * u[rising] ** 2 / 60.0, atol=1e-12
    )
    np.testing.assert_allclose(
        play[falling], u[falling] + 3.0 + 0.1 * u[falling] ** 2 / 60.0, atol=1e-12
    )


@over("sharpness", [1.0, 3.0, 50.0])
def test_rails_with_a_knee_are_linear_at_the_centre_and_end_at_the_rails(sharpness):
    effect = form("saturation", "rails with a knee")(20.0, 10.0, 5.0, sharpness)
    u = 5.0 + np.concatenate([-np.geomspace(1e12, 1e-3, 400), np.geomspace(1e-3, 1e12, 400)])
    y = effect.run(u, TS)
    assert np.all(np.diff(y) >= -1e-12)
    np.testing.assert_allclose(y[[0, -1]], [-5.0, 25.0], rtol=1e-9)
    assert np.diff(y)[399] / np.diff(u)[399] == pytest.approx(1.0, rel=1e-4)
    at_knees = effect.run([-5.0, 25.0], TS)
    np.testing.assert_allclose(at_knees, 5.0 + np.array([-10.0, 20.0]) * 0.5 ** (1 / sharpness))


def test_a_saturation_is_idle_where_no_command_comes_near_its_rails():
    scale = DataScale(50.0, 40.0, 40.0, 1e4, 1e-4, 10.0)
    near, far = form("saturation")(120.0, 50.0), form("saturation")(500.0, 50.0)
    assert (near.is_idle(scale), far.is_idle(scale)) == (False, True)
    bent = form("saturation", "soft unlike rails")(4e5, 2e4)
    assert bent.is_idle(scale)
    assert not form("saturation", "hard rails")().is_idle(scale)


def test_a_curve_of_the_weights_passes_its_knots_and_leaves_the_part_without_plays():
    knots = (0.1, -0.2, 0.3, 0.0, 0.4, -0.1, 0.2, 0.5)
    effect = form("congruency", "along a curve")(*knots, centre_V=10.0, span_V=20.0)
    u = np.linspace(-10.0, 30.0, 9)
    hysteresis = RDPI((2.0, 1.0), (1.0,), 0.0)
    y = effect.run(2.0 * u + 3.0, TS, u=u, hysteresis=hysteresis)
    np.testing.assert_allclose(y - 2.0 * u, 3.0 * (1.0 + np.array([0.0, *knots])), atol=1e-12)


def test_a_bridged_gap_moves_by_its_share_inside_and_with_the_input_beyond():
    width, bridge = 0.5, 0.2
    there, back = np.linspace(0.0, 3.0, 61), np.linspace(3.0, 1.0, 41)[1:]
    slopes = np.diff(
        form("backlash", "bridged by a spring")(width, bridge).run([*there, *back], TS)
    )
    slopes /= np.diff([*there, *back])
    crossed = int(2 * width / 0.05)
    np.testing.assert_allclose(slopes[: crossed // 2], bridge, rtol=1e-9)  # half the gap to go
    np.testing.assert_allclose(slopes[crossed // 2 : 60], 1.0, rtol=1e-9)
    np.testing.assert_allclose(slopes[60 : 60 + crossed], bridge, rtol=1e-9)  # all of it
    np.testing.assert_allclose(slopes[60 + crossed :], 1.0, rtol=1e-9)
