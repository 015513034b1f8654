"""extended-inverse: what each effect costs is won back; blocks, samples, lanes and preview."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baselines import make_controller
from baselines.inverses import INVERSES
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.plant import P10, Plant
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.signals import Sine
from rdpi_gym.support.errors import InputError
from tests.baselines.playing import play, rms
from tests.looping import over

TS = 5e-5
BARE = P10.with_hysteresis(P10.hysteresis.band_limited(800.0))
STATIC = P10.with_hysteresis(P10.hysteresis.static())


def plant_with(model, **effects):
    return replace(model, effects=tuple(CATALOGUE[name](**v) for name, v in effects.items()))


def whole_layout(belief, preview=1, ts_s=TS):
    layout = ObservationLayout.for_plant(belief, ts_s, preview=preview)
    need = make_controller("extended-inverse", belief, layout).needed_preview
    return replace(layout, preview=max(need, preview))


def sine(frequency_hz, amplitude_um=40.0, offset_um=0.0, periods=4):
    """Reference that starts smoothly in 20 ms, and the samples of two periods before its end.

    It goes on for 30 samples: where a reference ends it is held, which is a corner.
    """
    signal = Sine(
        amplitude_um=amplitude_um,
        frequency_hz=frequency_hz,
        offset_um=offset_um,
        smooth_start_s=0.02,
    )
    period = round(1.0 / frequency_hz / TS)
    r = signal(TS * np.arange(round(0.02 / TS) + periods * period + 30))
    return r[:, None], slice(-2 * period - 30, -30)


def track(name, belief, truth, layout, r):
    """Errors of a run through predict, float64[K-1, B]."""
    return play(make_controller(name, belief, layout), truth, r).errors_um


MIXED = plant_with(
    BARE,
    delay={"delay_s": 2.2e-4},
    resonance={"f0_hz": 900.0, "damping": 0.05},
    creep={},
    actuator_lag={},
    thermal_drift={"rate_um_s": 0.5},
    saturation={},
)


def test_without_effects_it_is_the_classical_inverse():
    r, _ = sine(100.0)
    for name in ("extended-inverse", "pi-extended-inverse"):
        for offset_um in (0.0, 3.0):
            belief = replace(BARE, offset_um=offset_um)
            layout = ObservationLayout.for_plant(belief, TS)
            plain = name.replace("extended-inverse", "classical-reference-rate")
            found, expected = (track(n, belief, belief, layout, r) for n in (name, plain))
            np.testing.assert_array_equal(found, expected, name)


def test_effects_without_a_stable_inverse_are_passed_over_and_named():
    r, _ = sine(100.0)
    for name in ("slew_limit", "mains_hum"):
        belief = plant_with(BARE, **{name: {}})
        layout = ObservationLayout.for_plant(belief, TS)
        controller = make_controller("extended-inverse", belief, layout)
        plain = make_controller("classical-reference-rate", BARE, layout)
        np.testing.assert_array_equal(controller.command_block(r), plain.command_block(r), name)
        assert f"{name} of belief P10 passed over" in controller.warning()
        fed_back = make_controller("pi-extended-inverse", belief, layout)
        assert fed_back.warning() == controller.warning()


def test_initial_memory_is_set_and_nothing_is_missing():
    belief = plant_with(BARE, initial_memory={"extremum_V": 30.0})
    layout = ObservationLayout.for_plant(belief, TS)
    controller = make_controller("extended-inverse", belief, layout)
    assert controller.warning() is None
    # to a first maximum that does not wipe the memory out
    r = 15.0 * np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, 400))[:, None]
    plant = Plant(belief, TS)
    plant.reset(u0_V=0.0)
    r += plant.simulate(np.zeros(1))[0]
    known, unknown = (track("extended-inverse", b, belief, layout, r) for b in (belief, BARE))
    assert rms(known) < 0.1 * rms(unknown)


EXACT = {
    "creep": {},
    "asymmetry": {"coefficient": -0.05},
    "gain_drift": {"rate_per_s": 1e-2},
    "thermal_drift": {"rate_um_s": 1.0, "time_constant_s": 2.0},
    "saturation": {"limit_V": 80.0},
    "congruency": {"coefficient": 0.3},
}
BY_DERIVATIVES = {
    "sensor_lag": {"time_constant_s": 3e-4},
    "actuator_lag": {"time_constant_s": 3e-4},
    "resonance": {"f0_hz": 700.0, "damping": 0.02},
    "delay": {"delay_s": 2.2e-4},
}


def test_on_a_static_plant_effects_are_undone_exactly_or_lags_fall_by_three_orders():
    assert {*EXACT, *BY_DERIVATIVES} <= {*INVERSES, "congruency"}
    r, _ = sine(20.0, amplitude_um=20.0, offset_um=15.0)
    for name, values in EXACT.items():  # without a pole to cancel
        belief = plant_with(STATIC, **{name: values})
        layout = whole_layout(belief)
        controller = make_controller("extended-inverse", belief, layout)
        u = controller.command_block(r[1:], controller.start(r[0]))
        plant = Plant(belief, TS)
        plant.reset(u0_V=0.0)
        y = plant.simulate(np.concatenate([np.zeros((1, 1)), u]))
        assert np.abs(y - r).max() < 1e-9 * 40.0, name
        assert controller.warning() is None, name
    r, late = sine(50.0)
    for name, values in BY_DERIVATIVES.items():
        truth = plant_with(STATIC, **{name: values})
        layout = whole_layout(truth)
        bare, known = (
            rms(track("extended-inverse", b, truth, layout, r)[late]) for b in (STATIC, truth)
        )
        assert known < 1e-3 * bare, name


# Effect, its parameters, frequency (Hz), offset (µm), and the factor by which the error falls.
# On P10 what is left is what the classical inverse leaves without any effect, 0.03 µm at 20 Hz and
# 0.2 µm at 100 Hz, so a small or slow effect falls less at higher frequencies.
FALLS = [
    ("sensor_lag", {}, 100.0, 0.0, 9.0),
    ("actuator_lag", {}, 100.0, 0.0, 17.0),
    ("resonance", {"f0_hz": 500.0, "damping": 0.02}, 50.0, 0.0, 3.3),
    ("creep", {}, 20.0, 0.0, 6.5),
    ("creep", {}, 20.0, 15.0, 13.0),
    ("asymmetry", {}, 20.0, 0.0, 22.0),
    ("asymmetry", {}, 100.0, 0.0, 3.5),
    ("delay", {"delay_s": 2.2e-4}, 100.0, 0.0, 20.0),
    ("saturation", {}, 20.0, 0.0, 27.0),
    ("saturation", {}, 100.0, 0.0, 4.0),
    ("backlash", {"half_width_um": 0.5}, 20.0, 0.0, 16.0),
    ("backlash", {"half_width_um": 0.5}, 100.0, 0.0, 3.0),
    ("rate_law", {}, 20.0, 0.0, 5.5),
    ("rate_law", {}, 100.0, 0.0, 4.5),
    ("congruency", {}, 20.0, 0.0, 25.0),
    ("congruency", {}, 100.0, 0.0, 4.0),
    ("gain_drift", {"rate_per_s": 1e-2}, 20.0, 0.0, 1.8),
    ("thermal_drift", {"rate_um_s": 1.0}, 20.0, 0.0, 3.8),
]


@pytest.mark.slow
def test_the_error_falls_when_the_belief_knows_the_effect():
    for name, values, hz, offset_um, factor in FALLS:
        truth = plant_with(BARE, **{name: values})
        layout = whole_layout(truth)
        r, late = sine(hz, amplitude_um=20.0 if offset_um else 40.0, offset_um=offset_um)
        bare, known = (
            rms(track("extended-inverse", b, truth, layout, r)[late]) for b in (BARE, truth)
        )
        assert bare / known > factor, (name, hz)
        floor = rms(track("classical-reference-rate", BARE, BARE, layout, r)[late])
        # a resonance amplifies, and another rate law changes, what the classical inverse leaves
        assert known < (1.5 if name in ("resonance", "rate_law") else 1.05) * floor, (name, hz)


def test_several_effects_at_once():
    layout = whole_layout(MIXED)
    r, late = sine(50.0)
    bare, known = (rms(track("extended-inverse", b, MIXED, layout, r)[late]) for b in (BARE, MIXED))
    assert bare / known > 30.0


@over("preview", [1, 4, 40])
def test_samples_and_blocks_agree_and_splitting_changes_nothing(preview):
    layout = ObservationLayout.for_plant(MIXED, TS, preview=preview)
    r = np.concatenate([sine(hz, periods=hz / 25.0)[0][:1200] for hz in (50.0, 100.0)], axis=1)
    r = np.float64(np.float32(r / 40.0)) * 40.0  # as observations show it
    controller = make_controller("extended-inverse", MIXED, layout)
    state = controller.start(r[0])
    block = controller.command_block(r[1:], state)
    parts, other = [], controller.start(r[0])
    for begin, end in ((1, 2), (2, 61), (61, 1200)):
        ahead = r[end:] if end < 1200 else None
        parts.append(controller.command_block(r[begin:end], other, ahead))
    np.testing.assert_array_equal(np.concatenate(parts), block)
    np.testing.assert_array_equal(other, state)

    np.testing.assert_allclose(play(controller, MIXED, r).commands_V, block, atol=1e-7 * 160.0)


def test_an_episode_that_begins_anew_leaves_the_other_lane_alone():
    layout = whole_layout(MIXED)
    r = np.concatenate([sine(50.0)[0], sine(50.0, amplitude_um=25.0)[0]], axis=1)
    rows = np.stack([(r[k : k + layout.preview + 1] / 40.0).T for k in range(60)])
    shown = np.concatenate([rows, np.zeros((60, 2, 2))], axis=2).astype(np.float32)
    shown[30:, 0] = shown[:30, 0]
    controller = make_controller("extended-inverse", MIXED, layout)
    actions, plain, state, other = [], [], None, None
    for k, observation in enumerate(shown):
        action, state = controller.predict(observation, state, np.array([k in (0, 30), k == 0]))
        actions.append(action)
        action, other = controller.predict(observation[1:], other)
        plain.append(action)
    np.testing.assert_array_equal(np.array(actions)[30:, 0], np.array(actions)[:30, 0])
    np.testing.assert_allclose(np.array(actions)[:, 1], np.array(plain)[:, 0], atol=1e-12)


def test_a_short_preview_is_named_and_degrades_gracefully():
    effects = {"delay": {"delay_s": 3e-4}, "sensor_lag": {}, "resonance": {"f0_hz": 900.0}}
    truth = plant_with(STATIC, **effects)
    r, late = sine(50.0)
    whole = whole_layout(truth)
    errors = {}
    for preview in (1, 2, 4, 7, whole.preview):
        layout = replace(whole, preview=preview)
        controller = make_controller("extended-inverse", truth, layout)
        assert controller.needed_preview == whole.preview
        warning = controller.warning()
        if preview < whole.preview:
            assert f"preview {preview}, {whole.preview} needed" in warning
        else:
            assert warning is None
        errors[preview] = rms(track("extended-inverse", truth, truth, layout, r)[late])
    bare = rms(track("extended-inverse", STATIC, truth, whole, r)[late])
    assert errors[1] < 0.1 * bare
    assert errors[whole.preview] < 1e-4 * bare
    assert sorted(errors.values(), reverse=True) == list(errors.values())


def test_limits_hold_and_the_command_is_finite_where_the_reference_is_out_of_reach():
    narrow = replace(MIXED, command_range_V=(-20.0, 25.0))
    layout = whole_layout(narrow)
    r, _ = sine(50.0)
    u = make_controller("extended-inverse", narrow, layout).command_block(5.0 * np.sign(r) + r)
    assert np.all(np.isfinite(u))
    assert u.min() == -20.0
    assert u.max() == 25.0
    increments = replace(layout, action="increment", action_scale_V=1.5)
    u = make_controller("extended-inverse", narrow, increments).command_block(r)
    assert np.abs(np.diff(u, axis=0)).max() <= 1.5 + 1e-12


def test_bad_blocks_are_refused():
    layout = whole_layout(MIXED)
    controller = make_controller("extended-inverse", MIXED, layout)
    bad = np.zeros((5, 1))
    bad[3] = np.nan
    with pytest.raises(InputError, match="sample 3 of lane 0"):
        controller.command_block(bad)
    with pytest.raises(InputError, match="sample 3 of lane 0"):
        controller.command_block(np.zeros((5, 1)), None, bad)
