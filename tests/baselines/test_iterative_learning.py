"""Iterative learning: what ten passes reach, and what becomes of a pass that was worse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baselines.iterative_learning import IterativeLearning
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.envs.truth import limit_band
from rdpi_gym.plant import P10, Plant
from rdpi_gym.plant.effects import load_effect
from rdpi_gym.signals import Triangle
from rdpi_gym.support.errors import InputError

TS = 1e-4
BELIEF = limit_band(P10, 800.0)
LAYOUT = ObservationLayout.for_plant(BELIEF, TS)
TRIANGLE = Triangle(amplitude_um=40.0, frequency_hz=20.0, smooth_start_s=0.05)(
    TS * np.arange(1500)
)[:, None]


def stage(lag_s, delay_s, f0_hz):
    effects = (
        load_effect("actuator_lag")(time_constant_s=lag_s),
        load_effect("delay")(delay_s=delay_s),
        load_effect("resonance")(f0_hz=f0_hz, damping=0.03),
    )
    return replace(BELIEF, effects=effects)


TRUTH, TOLD = stage(2e-4, 1e-4, 600.0), stage(1.5e-4, 1.2e-4, 739.0)


def percents(learner, passes, noise_um=0.01):
    rng, errors = np.random.default_rng(0), []
    for _ in range(passes):
        u = learner.plan(TRIANGLE)
        y = Plant(TRUTH, TS).simulate(u)
        learner.learn(TRIANGLE, y + noise_um * rng.standard_normal(y.shape), u)
        errors.append(100.0 * float(np.sqrt(np.mean((TRIANGLE - y)[500:] ** 2))) / 80.0)
    return errors


def test_the_tenth_pass_on_a_stage_other_than_believed_is_below_a_twentieth_of_a_percent():
    errors = percents(IterativeLearning(TOLD, LAYOUT, {}), 10)
    assert errors[0] > 0.2
    assert errors[-1] < 0.05


def test_without_a_word_of_lag_delay_and_mode_ten_passes_leave_a_sixth():
    errors = percents(IterativeLearning(BELIEF, LAYOUT, {}), 10)
    assert errors[-1] < errors[0] / 6.0


def test_another_reference_begins_anew():
    learner = IterativeLearning(BELIEF, LAYOUT, {})
    first = learner.plan(TRIANGLE)
    percents(learner, 2)
    assert not np.array_equal(learner.plan(TRIANGLE), first)
    learner.plan(0.5 * TRIANGLE)
    np.testing.assert_array_equal(learner.plan(TRIANGLE), first)


def test_readings_of_no_planned_reference_are_refused():
    learner = IterativeLearning(BELIEF, LAYOUT, {})
    with pytest.raises(InputError, match="plan it first"):
        learner.learn(TRIANGLE, TRIANGLE, TRIANGLE)
    learner.plan(TRIANGLE)
    with pytest.raises(InputError, match="give as many"):
        learner.learn(TRIANGLE, TRIANGLE[:-1], TRIANGLE)
