"""Inverses of further forms of effects: each is undone by its own, or named and passed over."""

from dataclasses import replace

import numpy as np
import pytest

from baselines import make_controller
from baselines.inverses import INVERSES, Setting, chain, inverse_of, inverses_of
from baselines.pi import gains_within_margin, simc_gains
from baselines.preview import LinearUndo
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import P10, Plant
from rdpi_gym.plant.effects import CATALOGUE, forms_of
from tests.looping import over

TS = 1e-4
FORMS = [form for kind in CATALOGUE.values() for form in forms_of(kind)[1:]]
UNDONE = [form for form in FORMS if inverse_of(form) is not None]
BY_FORM = {(form.name, form.form): form for form in FORMS}


def full_name(kind):
    return kind.full_name()


def undo(effect, y, ts_s=TS, ahead=500, rest=0.0):
    """Inputs for the samples of y that are not held back, and how many are."""
    inverse = inverse_of(effect)(effect, Setting(ts_s, P10.hysteresis, 40.0, rest), ahead)
    state, _ = inverse.start(y[:1])
    return inverse.run(np.ascontiguousarray(y[1:, None]), state)[inverse.ahead :, 0], inverse.ahead


DERIVATIVES = [
    ("sensor_lag", "second order", {"time_constant_s": 2e-3, "second_ratio": 0.6}),
    ("actuator_lag", "second order", {"time_constant_s": 3e-4, "second_ratio": 1.0}),
    ("sensor_lag", "third order", {"time_constant_s": 1e-3}),
    ("actuator_lag", "third order", {"time_constant_s": 1e-3, "third_share": 0.0}),
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
    effect = BY_FORM[name, words](**values)
    k = np.arange(3000.0)
    y = 0.7 * k - 1e-4 * k**2
    x, ahead = undo(effect, y)
    again = effect.run(np.concatenate([y[:1], x]), TS)
    late = slice(2500, len(again))  # what the start has left has died away
    assert np.abs(again[late] - y[: len(again)][late]).max() <= 1e-6 * np.abs(y).max()
    assert len(again) == len(y) - ahead


EXACT = [
    (
        "saturation",
        "rails with a knee",
        {"limit_V": 60.0, "centre_V": -10.0, "sharpness": 2.5},
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


@over("name, words, values", EXACT)
def test_exact_for_any_input(name, words, values):
    effect = BY_FORM[name, words](**values)
    x = np.clip(20.0 + np.cumsum(np.random.default_rng(1).normal(0, 3, 80)), -45, 45)
    found, _ = undo(effect, effect.run(x, 0.05), ts_s=0.05, rest=x[0])
    np.testing.assert_allclose(found, x[1:], atol=1e-9)


@over("kind", UNDONE)
def test_blocks_may_be_split(kind):
    inverse = inverse_of(kind)(kind(), Setting(TS, P10.hysteresis, 40.0, 0.0), ahead=3)
    y = np.cumsum(np.random.default_rng(0).normal(0, 1, (50, 2)), axis=0)
    whole, state = inverse.start(y[0])[0], inverse.start(y[0])[0]
    expected = inverse.run(y, whole)
    parts = [inverse.run(np.ascontiguousarray(p), state) for p in np.split(y, [1, 2, 30])]
    np.testing.assert_array_equal(np.concatenate(parts), expected)
    np.testing.assert_array_equal(state, whole)


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
