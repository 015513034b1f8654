"""PI: margins of the loop over both regimes, anti-windup, and what feedback is for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baselines import FEEDFORWARDS, make_controller
from baselines.pi import simc_gains
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.plant import P5, P10, RDPI, Sensor
from tests.baselines.playing import play

models = st.builds(
    lambda a0, s, delta2, hz: RDPI((a0, s), (1.0,), delta2, hz),
    st.floats(0.1, 3.0),
    st.floats(0.0, 3.0),
    st.floats(0.0, 1e-3),
    st.one_of(st.none(), st.floats(20.0, 5000.0)),
)


def loops(model, ts_s):
    """Frequency responses of the open loop, all plays sliding and all sticking."""
    kp, ki = simc_gains(model, ts_s)
    z = np.exp(1j * np.geomspace(1e-6, np.pi, 6000))
    p = model.rate_pole(ts_s)
    lag = model.S * model.delta2_s / ts_s
    sliding = model.A - lag * (1 - p) * (1 - 1 / z) / (1 - p / z)
    controller = (kp + ki * ts_s / (1 - 1 / z)) / z
    return controller * sliding, controller * model.a0


@settings(deadline=None, max_examples=200)
@given(model=models, ts_s=st.floats(1e-6, 1e-2))
def test_phase_margin_and_gain_margin(model, ts_s):
    for loop in loops(model, ts_s):
        crossings = np.flatnonzero((np.abs(loop[:-1]) > 1) & (np.abs(loop[1:]) <= 1))
        assert len(crossings) == 1
        margin = 180.0 + np.degrees(np.unwrap(np.angle(loop))[crossings[0]])
        assert margin > 59.5
        assert np.max(1 / np.abs(1 + loop)) < 2.05  # Ms of 2: gain margin 2 at least


def test_the_published_rule_for_a_pure_delay():
    """SIMC with the closed-loop time constant θ: integral gain 1/(2 k θ), phase margin 61°."""
    kp, ki = simc_gains(P10.hysteresis.static(), 1e-4)
    assert ki == pytest.approx(1 / (2 * P10.hysteresis.A * 1e-4))
    assert 0 < kp < ki * 1e-4 / 3


def run(name, belief, truth, layout, r, rngs=None):
    commands, errors, _, _ = play(make_controller(name, belief, layout), truth, r[:, None], rngs)
    return errors[:, 0], commands[:, 0]


def test_feedback_settles_where_the_belief_is_wrong():
    belief = P10.with_hysteresis(
        replace(P10.hysteresis, weights=tuple(1.2 * a for a in P10.hysteresis.weights))
    )
    layout = ObservationLayout.for_plant(P10, 1e-3)
    r = np.concatenate([np.zeros(5), np.full(120, 20.0)])
    for name in ("pi", *(f"pi-{each}" for each in FEEDFORWARDS)):
        errors, _ = run(name, belief, P10, layout, r)
        assert np.abs(errors[-5:]).max() < 1e-3, name
        if name != "pi":
            open_loop, _ = run(name.removeprefix("pi-"), belief, P10, layout, r)
            assert np.abs(open_loop[-5:]).max() > 1.0, name


def test_anti_windup_leaves_the_limit_at_once():
    ts_s = 1e-3
    narrow = replace(P5, command_range_V=(-8.0, 8.0))
    layout = ObservationLayout.for_plant(narrow, ts_s)
    for name in ("pi", "pi-classical-static"):
        leaves = []
        for samples in (50, 500):  # out of reach for a while, then back
            r = np.concatenate([np.zeros(5), np.full(samples, 30.0), np.full(60, 2.0)])
            errors, commands = run(name, narrow, narrow, layout, r)
            assert commands[samples] == pytest.approx(8.0)
            leaves.append(errors[samples + 4 :])
        np.testing.assert_allclose(leaves[0], leaves[1], atol=1e-6)
        assert np.abs(leaves[0][-5:]).max() < 1e-2


def test_noise_does_not_bias_the_loop():
    noisy = replace(P10, sensor=Sensor(noise_um=0.05))
    layout = ObservationLayout.for_plant(P10, 1e-3)
    r = np.full(2000, 10.0)
    errors, _ = run("pi", P10, noisy, layout, r, [np.random.default_rng(0)])
    assert abs(errors[200:].mean()) < 0.005
    assert errors[200:].std() < 0.05
