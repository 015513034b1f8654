"""Inverses of effects, in every form: exact where they claim it, harmless where nothing can be exact."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from baselines import make_controller
from baselines.inverses import INVERSES, Setting, chain, inverse_of, inverses_of
from baselines.inverses.linear import preview_weights
from baselines.pi import gains_within_margin, simc_gains
from baselines.preview import LinearUndo
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import P10, Plant, pack
from rdpi_gym.plant.cores.play import given_rate_block
from rdpi_gym.plant.effects import CATALOGUE, forms_of
from tests.looping import over

TS = 1e-4
BY_FORM = {(form.name, form.form): form for kind in CATALOGUE.values() for form in forms_of(kind)}
FORMS = [form for form in BY_FORM.values() if form.form]
INVERTED = [form for form in BY_FORM.values() if inverse_of(form) is not None]
UNDONE = [form for form in INVERTED if form.form]


def undo(effect, y, ts_s=TS, ahead=500, rest=0.0):
    """Inputs for the samples of y that are not held back, and how many are."""
    inverse = inverse_of(effect)(effect, Setting(ts_s, P10.hysteresis, 40.0, rest), ahead)
    state, _ = inverse.start(y[:1])
    return inverse.run(np.ascontiguousarray(y[1:, None]), state)[inverse.ahead :, 0], inverse.ahead


def assert_undone_along_a_parabola(effect, y):
    x, ahead = undo(effect, y)
    again = effect.run(np.concatenate([y[:1], x]), TS)
    late = slice(2500, len(again))  # what the start has left has died away
    assert np.abs(again[late] - y[: len(again)][late]).max() <= 1e-6 * np.abs(y).max() + 1e-9
    assert len(again) == len(y) - ahead


linear = st.one_of(
    st.tuples(st.just("sensor_lag"), st.fixed_dictionaries({"time_constant_s": st.floats(0, 1e-2)})),
    st.tuples(
        st.just("resonance"),
        st.fixed_dictionaries({"f0_hz": st.floats(20, 4e3), "damping": st.floats(0.005, 0.7)}),
    ),
    st.tuples(st.just("delay"), st.fixed_dictionaries({"delay_s": st.floats(0, 3e-3)})),
)  # fmt: skip


@settings(deadline=None, max_examples=60)
@given(case=linear, slope=st.floats(-2, 2), curve=st.floats(-0.02, 0.02))
def test_along_a_parabola_derivatives_undo_a_linear_effect_exactly(case, slope, curve):
    name, values = case
    assume(values.get("damping", 1.0) * values.get("f0_hz", 1e3) > 10.0)
    k = np.arange(3000.0)
    assert_undone_along_a_parabola(CATALOGUE[name](**values), slope * k + curve * k**2 / 100.0)


DERIVATIVES = [
    ("sensor_lag", "second order", {"time_constant_s": 2e-3, "second_ratio": 0.6}),
    ("actuator_lag", "second order", {"time_constant_s": 3e-4, "second_ratio": 1.0}),
    ("sensor_lag", "fourth order", {"time_constant_s": 1e-3}),
    ("actuator_lag", "fourth order", {"time_constant_s": 1e-3, "third_share": 0.0}),
    ("resonance", "with a zero", {"f0_hz": 300.0, "damping": 0.05, "static_share": 0.2}),
    (
        "resonance",
        "two modes",
        {"f0_hz": 300.0, "damping": 0.05, "second_hz": 900.0, "second_damping": 0.05},
    ),
    ("delay", "whole samples", {"samples": 2.4}),
]


@over("name, words, values", DERIVATIVES)
def test_along_a_parabola_a_linear_form_is_undone_exactly(name, words, values):
    k = np.arange(3000.0)
    assert_undone_along_a_parabola(BY_FORM[name, words](**values), 0.7 * k - 1e-4 * k**2)


EXACT = [
    (
        "saturation",
        "rails with a knee",
        {"up_V": 60.0, "down_V": 50.0, "centre_V": -10.0, "sharpness": 2.5},
    ),
    ("saturation", "hard upper rail", {"high_V": 90.0}),
    ("saturation", "hard lower rail", {"low_V": -90.0}),
    ("asymmetry", "cubic", {"coefficient_2": 0.06, "coefficient_3": -0.1}),
    ("asymmetry", "to the fifth degree", {"coefficient_2": -0.06, "coefficient_5": 0.1}),
    ("saturation", "soft unlike rails", {"limit_V": 60.0, "centre_V": -10.0}),
    ("creep", "one time constant", {"gain": 0.1}),
    ("creep", "between two times", {"gain_per_decade": 0.1}),
    ("creep", "two time constants", {"gain_1": 0.2, "gain_2": 0.1}),
    ("creep", "three time constants", {"gain_3": 0.2}),
    ("creep", "spectrum", {"gain_at_1s": 0.1}),
    ("gain_drift", "to a limit", {"rate_per_s": 0.05, "time_constant_s": 3.0}),
    ("thermal_drift", "two time constants", {"rate_um_s": 0.5, "second_rate_um_s": -0.3}),
    ("thermal_drift", "piecewise linear", {"duration_s": 3.0}),
    ("gain_drift", "piecewise linear", {"duration_s": 3.0}),
    ("thermal_drift", "smooth curve", {"duration_s": 3.0}),
    ("gain_drift", "smooth curve", {"duration_s": 3.0}),
    ("saturation", "hard rails", {"low_V": -100.0, "high_V": 90.0}),
]


@over("name", ["creep", "asymmetry", "gain_drift", "thermal_drift"])
@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), rest=st.floats(-30, 30))
def test_exact_for_any_input(name, seed, rest):
    rng = np.random.default_rng(seed)
    x = rest + np.concatenate([[0.0], np.cumsum(rng.normal(0, 3, 80))])
    x = np.clip(x, -45, 45)
    effect = CATALOGUE[name]()
    found, _ = undo(effect, effect.run(x, 0.05), ts_s=0.05, rest=rest)
    np.testing.assert_allclose(found, x[1:], atol=1e-9)


@over("name, words, values", EXACT)
def test_a_form_is_exact_for_any_input(name, words, values):
    effect = BY_FORM[name, words](**values)
    x = np.clip(20.0 + np.cumsum(np.random.default_rng(1).normal(0, 3, 80)), -45, 45)
    found, _ = undo(effect, effect.run(x, 0.05), ts_s=0.05, rest=x[0])
    np.testing.assert_allclose(found, x[1:], atol=1e-9)


@over("kind", INVERTED)
def test_blocks_may_be_split(kind):
    inverse = inverse_of(kind)(kind(), Setting(TS, P10.hysteresis, 40.0, 0.0), ahead=3)
    y = np.cumsum(np.random.default_rng(0).normal(0, 1, (50, 2)), axis=0)
    whole, state = inverse.start(y[0])[0], inverse.start(y[0])[0]
    expected = inverse.run(y, whole)
    parts = [inverse.run(np.ascontiguousarray(p), state) for p in np.split(y, [1, 2, 30])]
    np.testing.assert_array_equal(np.concatenate(parts), expected)
    np.testing.assert_array_equal(state, whole)


@settings(deadline=None)
@given(u=st.lists(st.floats(-150, 150), min_size=1, max_size=20))
def test_saturation_is_exact_up_to_its_rails(u):
    effect = CATALOGUE["saturation"](limit_V=80.0)
    y = effect.run(u, TS)
    found, _ = undo(effect, np.concatenate([[0.0], y]))
    np.testing.assert_allclose(found, u, atol=1e-5)


def test_out_of_reach_stays_finite():
    y = np.array([0.0, -1e4, 1e4, -1e4])
    for name in ("saturation", "asymmetry"):
        found, _ = undo(CATALOGUE[name](), y)
        assert np.all(np.isfinite(found))


def test_the_play_of_the_jump_is_the_reference():
    t = np.linspace(0.0, 1.0, 2000)
    y = 10 * np.sin(2 * np.pi * 3 * t) * t + 2 * np.sin(2 * np.pi * 11 * t)
    effect = CATALOGUE["backlash"](half_width_um=0.4)
    x, _ = undo(effect, y)
    again = effect.run(np.concatenate([y[:1], x]), TS)
    assert np.abs(again - y).max() < 1.1e-4 * 40.0


@settings(deadline=None)
@given(
    y=st.lists(st.floats(-50, 50), min_size=1, max_size=30),
    width=st.floats(0.0, 5.0), bridge=st.floats(0.02, 1.0),
)  # fmt: skip
def test_a_bridged_gap_is_inverted_exactly(y, width, bridge):
    effect = BY_FORM["backlash", "bridged by a spring"](width, bridge)
    wanted = np.array([y[0], *y])
    x, _ = undo(effect, wanted)
    np.testing.assert_allclose(
        effect.run(np.concatenate([wanted[:1], x]), TS)[1:], wanted[1:], atol=1e-9
    )


@settings(deadline=None, max_examples=40)
@given(c=st.floats(-0.5, 2.0), seed=st.integers(0, 2**32 - 1))
def test_congruency_is_inverted_with_the_plays(c, seed):
    rng = np.random.default_rng(seed)
    u = np.cumsum(rng.normal(0, 2.0, 300))
    u = np.ascontiguousarray(40.0 * np.sin(u / 40.0)[:, None])
    v = np.gradient(u, 1e-3, axis=0)
    p, growth = pack([P10.hysteresis], 1e-3, [0.0]), c / 40.0**2
    state, found = np.zeros((P10.hysteresis.n + 2, 1)), np.empty_like(u)
    plain = np.empty_like(u)
    given_rate_block(u, v, p, state.copy(), plain)
    y = plain + growth * u**2 * (plain - p[0] * u)
    powers = np.array([1.0, 0.0, growth])
    low, high = chain.rising_range(P10.hysteresis, powers, (-80.0, 80.0))
    chain.congruent_inverse_block(y, v, powers, p, state, low, high, found)
    again = np.empty_like(u)
    given_rate_block(found, v, p, np.zeros_like(state), again)
    again += growth * found**2 * (again - p[0] * found)
    np.testing.assert_allclose(again, y, atol=1e-9)


@settings(deadline=None)
@given(series=st.lists(st.floats(-5, 5), min_size=1, max_size=4), half=st.integers(2, 20))
def test_weights_have_the_moments_and_the_smallest_sum_of_squares(series, half):
    offsets = np.arange(-half, half + 1)
    weights = preview_weights(np.array(series), offsets)
    rows = [offsets**q / max(1, np.prod(range(1, q + 1))) for q in range(len(series))]
    np.testing.assert_allclose([w @ weights for w in rows], series, atol=1e-9)
    # least-norm solutions lie in the span of the conditions
    rest = weights - np.polyval(np.polyfit(offsets, weights, len(series) - 1), offsets)
    assert np.abs(rest).max() < 1e-9


@over("kind", FORMS)
def test_a_form_is_never_undone_by_the_inverse_of_another(kind):
    """It has an inverse that states it, or is followed with the rate, or is named as passed over."""
    belief = replace(P10, effects=(kind(),))
    found = inverses_of(belief, TS, 40.0, 0.0, shown_ahead=50)
    stages = [*found.output, *found.command]
    assert all(kind.form in stage.forms and stage.effect == kind.name for stage in stages)
    assert (found.congruency is not None) == (kind.block in chain.UNDONE)
    dealt_with = bool(stages or found.rate or found.congruency) or kind.slot == "memory"
    assert dealt_with == (not found.passed_over)
    controller = make_controller(
        "extended-inverse", belief, ObservationLayout.for_plant(belief, TS)
    )
    r = 20.0 * np.sin(np.arange(60) / 10.0)[:, None]
    assert np.all(np.isfinite(controller.command_block(r)))
    if found.passed_over:
        (said,) = found.passed_over
        assert said.startswith(kind.full_name())
        assert ("has an inverse" in said) == (kind.name in INVERSES)
        assert said in controller.warning()
        assert "\n" not in controller.warning()


@over("words", ["about the middle of the range", "odd and even", "to the fourth degree"])
@over("sign", [-1.0, 1.0])
def test_congruency_of_any_power_is_undone_with_the_plays(words, sign):
    kind = BY_FORM["congruency", words]
    shares = {p.name: sign * 0.1 for p in kind.parameters if p.name.startswith("coefficient")}
    place = {"middle_V": 12.0} if "middle_V" in kind().values else {}
    plant = replace(P10, effects=(kind(**shares, **place, span_V=40.0),))
    plant = plant.with_hysteresis(plant.hysteresis.static())
    controller = make_controller("extended-inverse", plant, ObservationLayout.for_plant(plant, TS))
    r = 25.0 * np.sin(2 * np.pi * 40.0 * TS * np.arange(2000))[:, None]
    y = Plant(plant, TS).simulate(controller.command_block(r))
    np.testing.assert_allclose(y[1:], r[1:], atol=1e-9)


def test_out_of_reach_stays_at_the_turn():
    effect = BY_FORM["asymmetry", "cubic"](coefficient_2=0.0, coefficient_3=-1.0, span_um=20.0)
    found, _ = undo(effect, np.array([0.0, 1e6, -1e6, 0.0]))
    turn = 20.0 / np.sqrt(3.0)  # 1 - 3 (x / Y)² = 0
    np.testing.assert_allclose(found, [turn, -turn, 0.0], rtol=1e-9)


STRONG = {
    "gain_drift": {"rate_per_s": 0.05, "duration_s": 0.3},
    "thermal_drift": {"rate_um_s": 1.0, "duration_s": 0.3},
    "delay": {"samples": 2.0},
    "saturation": {"low_V": -21.0, "high_V": 19.0},
    "resonance": {"f0_hz": 400.0, "damping": 0.2, "second_hz": 1000.0, "second_damping": 0.2},
}


@over("kind", UNDONE)
def test_a_form_that_is_known_is_followed_better_than_one_that_is_not(kind):
    own = STRONG.get(kind.name, {})
    effect = kind().with_values({k: v for k, v in own.items() if k in kind().values})
    bare = P10.with_hysteresis(P10.hysteresis.static())
    plant = replace(bare, effects=(effect,))
    layout = ObservationLayout.for_plant(plant, TS, preview=60)
    r = 20.0 * np.sin(2 * np.pi * 60.0 * TS * np.arange(3000))[:, None]
    known, unknown = (
        np.std((Plant(plant, TS).simulate(controller.command_block(r)) - r)[100:-60])
        for controller in (make_controller("extended-inverse", b, layout) for b in (plant, bare))
    )
    if kind.form.startswith("hard "):  # beyond them nothing can be done, and within nothing need be
        assert known == pytest.approx(unknown, rel=1e-9)
    else:
        assert known < 0.1 * unknown


def test_a_loop_with_two_modes_is_lowered_to_the_margin_of_both():
    ringing = CATALOGUE["resonance"](f0_hz=900.0, damping=0.02)
    both = BY_FORM["resonance", "two modes"](900.0, 0.02, 400.0, 0.01, 0.3)
    bare = simc_gains(P10.hysteresis, TS)
    one, two = (
        gains_within_margin(bare, replace(P10, effects=(effect,)), TS) for effect in (ringing, both)
    )
    assert two.integral_V_um_s < one.integral_V_um_s < bare.integral_V_um_s


def test_a_delay_in_samples_lowers_gains_and_is_undone_like_the_same_delay_in_seconds():
    seconds = replace(P10, effects=(CATALOGUE["delay"](delay_s=2 * TS),))
    samples = replace(P10, effects=(BY_FORM["delay", "whole samples"](samples=2.0),))
    bare = simc_gains(P10.hysteresis, TS)
    assert gains_within_margin(bare, samples, TS) == gains_within_margin(bare, seconds, TS)
    error = np.cumsum(np.random.default_rng(0).normal(0, 1, (40, 1)), axis=0)
    np.testing.assert_allclose(
        LinearUndo(samples, TS)(error), LinearUndo(seconds, TS)(error), atol=1e-12
    )
