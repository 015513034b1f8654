"""Commands planned over the whole reference: yardsticks, one of them a bound."""

from __future__ import annotations

from dataclasses import replace
from itertools import filterfalse

import numpy as np
import pytest

from baselines import (
    CONTROLLERS,
    FEEDFORWARDS,
    FULL_PREVIEW,
    FullPreviewInversion,
    inverts_any_core,
    known_controller,
    make_controller,
)
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.envs.truth import randomise_plant
from rdpi_gym.plant import P5, P10, Plant
from rdpi_gym.signals import make_signal
from rdpi_gym.support.errors import InputError
from tests.baselines.playing import play
from tests.looping import over


def band_limited(model, hz=800.0):
    return model.with_hysteresis(model.hysteresis.band_limited(hz))


def rms(model, ts_s, u, r):
    plant = Plant(model, ts_s, lanes=r.shape[1])
    low, high = model.command_range_V
    plant.reset(u0_V=min(max(0.0, low), high))
    return np.sqrt(np.mean((r - plant.simulate(u))[1:] ** 2, axis=0))


def test_periodic_yardsticks_and_minimum_phase():
    """On the literal plants, the last of six periods; without error where the phase is minimal."""
    for model in (P5, P10):
        amplitude, ts_s = model.reference_um[1], 2e-5
        for frequency_hz, percent in ((50, 0.01), (100, 0.03), (200, 0.09)):
            period = round(1 / frequency_hz / ts_s)
            r = amplitude * np.sin(2 * np.pi * np.arange(6 * period) / period)[:, None]
            layout = ObservationLayout.for_plant(model, ts_s)
            u = make_controller("preview-inversion", model, layout).plan(r)
            error = (r - Plant(model, ts_s).simulate(u))[-period:]
            assert 100 * np.sqrt(np.mean(error**2)) / amplitude < percent, frequency_hz
            smooth = amplitude * 2 * np.pi * frequency_hz * ts_s / model.hysteresis.a0
            assert np.abs(np.diff(u, axis=0)).max() < 2 * smooth  # it does not dither
        plant, ts_s = band_limited(model), 5e-5
        signal = make_signal("sine", amplitude_um=10.0, frequency_hz=100.0, smooth_start_s=0.01)
        r = signal(ts_s * np.arange(800))[:, None]
        planned = make_controller(
            "preview-inversion", plant, ObservationLayout.for_plant(plant, ts_s)
        )
        assert rms(plant, ts_s, planned.plan(r), r)[0] < 2e-5 * 10.0


def benchmark_references(amplitude_um, ts_s, samples):
    signals = [
        make_signal("sine", amplitude_um=amplitude_um, frequency_hz=hz) for hz in (1.0, 10.0, 50.0)
    ] + [
        make_signal("sine", amplitude_um=amplitude_um, frequency_hz=200.0, smooth_start_s=0.02),
        make_signal("triangle", amplitude_um=amplitude_um, frequency_hz=20.0),
        make_signal("raster", amplitude_um=amplitude_um, frequency_hz=20.0, smooth_start_s=0.02),
        make_signal("steps", amplitude_um=amplitude_um, hold_s=0.02),
        make_signal("multisine", amplitude_um=amplitude_um, frequency_hz=10.0, smooth_start_s=0.02),
        make_signal("nested-loops", amplitude_um=amplitude_um, frequency_hz=10.0),
        make_signal("noise", amplitude_um=amplitude_um, high_hz=80.0, smooth_start_s=0.02),
    ]
    return np.stack([signal(ts_s * np.arange(samples)) for signal in signals], axis=1)


def tracked(controller, truths, r):
    """Return the RMS error (µm) of every lane."""
    return np.sqrt(np.mean(play(controller, truths, r).errors_um ** 2, axis=0))


@pytest.mark.slow
@over("model, ts_s", [(P5, 1e-3), (P10, 5e-5)])
@over("spread", [0.0, 0.05])
def test_full_preview_is_a_bound_whatever_the_true_plant(model, ts_s, spread):
    plant = band_limited(model)
    layout = ObservationLayout.for_plant(plant, ts_s)
    r = benchmark_references(model.reference_um[1], ts_s, min(1600, round(0.4 / ts_s)))
    truths = [randomise_plant(plant, spread, np.random.default_rng(s)) for s in range(r.shape[1])]
    scores = {
        name: tracked(make_controller(name, plant, layout), truths, r)
        for name in CONTROLLERS
        # where the plant rises with its newest command, a search in each sample is exact as well;
        # one of those that step in NumPy stands for all
        if not inverts_any_core(name)
        and (name == "dual-loop" or not hasattr(CONTROLLERS[name], "knobs"))
    }
    bound = tracked(FullPreviewInversion(truths, layout), truths, r)
    own = scores.pop("preview-inversion")
    if spread == 0.0:  # the belief is the truth: they are the same
        np.testing.assert_array_equal(own, bound)
    best = np.min(list(scores.values()), axis=0)
    assert np.all(bound < best)
    assert np.median(best / bound) > 10.0
    if spread:
        assert np.all(bound < own)
        assert np.median(own / bound) > 100.0
        assert np.mean(own > best) > 0.3  # what inverts the belief is no bound


def test_full_preview_is_made_by_no_name_and_asks_for_a_plant_a_lane():
    layout = ObservationLayout.for_plant(P5, 1e-3)
    with pytest.raises(InputError, match="preview-inversion"):
        make_controller(FULL_PREVIEW, P5, layout)
    with pytest.raises(InputError, match="is no controller of this package"):
        known_controller(FULL_PREVIEW)
    with pytest.raises(InputError, match="2 true plants for 3 lanes"):
        FullPreviewInversion([P5, P5], layout).plan(np.zeros((10, 3)))


@over("ts_s", [2e-5, 2e-4, 5e-3])
def test_never_worse_than_a_stable_feedforward_on_its_belief(ts_s):
    """Steps and a reference out of reach included; literal, band-limited and static belief."""
    for model in (P5, band_limited(P10), P10.with_hysteresis(P10.hysteresis.static())):
        narrow = replace(model, command_range_V=tuple(0.4 * v for v in model.command_range_V))
        for belief in (model, narrow):
            layout = ObservationLayout.for_plant(belief, ts_s)
            r = benchmark_references(model.reference_um[1], ts_s, 400)
            u = make_controller("preview-inversion", belief, layout).plan(r)
            assert np.all(np.isfinite(u))
            assert u.min() >= belief.command_range_V[0]
            assert u.max() <= belief.command_range_V[1]
            found = rms(belief, ts_s, u, r)
            for name in filterfalse(inverts_any_core, FEEDFORWARDS):
                causal = make_controller(name, belief, layout)
                if causal.warning() is None:
                    block = causal.command_block(r[1:], causal.start(r[0]))
                    commands = np.concatenate([np.zeros((1, r.shape[1])), block])
                    assert np.all(found <= rms(belief, ts_s, commands, r) * (1 + 1e-12))


def test_it_inverts_effects_and_offset_of_its_belief_and_rests_at_the_range_s_edge():
    belief = replace(band_limited(P10), offset_um=-2.0, command_range_V=(10.0, 90.0))
    layout = replace(ObservationLayout.for_plant(belief, 1e-4), centre_um=45.0, scale_um=20.0)
    plant = Plant(belief, 1e-4)
    plant.reset(u0_V=10.0)
    rest = plant.simulate(np.array([10.0]))[0]
    t = 1e-4 * np.arange(1500)
    ramp = np.minimum(t / 0.05, 1.0)[:, None]
    r = rest + ramp * (45.0 - rest + 20.0 * np.sin(2 * np.pi * 40 * t)[:, None])
    u = make_controller("preview-inversion", belief, layout).plan(r)
    assert u[0] == 10.0
    assert rms(belief, 1e-4, u, r)[0] < 1e-3


def test_it_plays_the_plan_lane_by_lane_and_holds_its_end():
    layout = ObservationLayout.for_plant(P5, 1e-3)
    planned = make_controller("preview-inversion", P5, layout)
    r = 5.0 * np.sin(np.arange(20)[:, None] * np.array([0.2, 0.4]))
    u = planned.plan(r)
    observation = np.zeros((2, layout.size), dtype=np.float32)
    state, played = None, []
    for _ in range(25):
        action, state = planned.predict(observation, state)
        played.append(layout.place_to_V(np.float64(action[:, 0])))
    expected = np.concatenate([u[1:], np.repeat(u[-1:], 6, axis=0)])
    np.testing.assert_allclose(played, expected, atol=1e-5)
    planned.plan(r[:, :1])
    np.testing.assert_allclose(
        layout.place_to_V(np.float64(planned.predict(observation)[0][:, 0])), u[1, 0], atol=1e-5
    )


def test_without_a_plan_it_says_so_in_one_line():
    layout = ObservationLayout.for_plant(P5, 1e-3)
    planned = make_controller("preview-inversion", P5, layout)
    with pytest.raises(InputError, match=r"call plan\(reference_um\)"):
        planned.predict(np.zeros(layout.size, dtype=np.float32))
    planned.plan(np.zeros((10, 3)))
    with pytest.raises(InputError, match="3 lanes for 2 episodes"):
        planned.predict(np.zeros((2, layout.size), dtype=np.float32))
    holed = np.zeros((10, 1))
    holed[0] = np.nan
    for bad in (np.zeros(10), np.zeros((1, 3)), np.zeros((0, 2)), holed):
        with pytest.raises(InputError):
            planned.plan(bad)
