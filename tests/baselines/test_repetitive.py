"""Repetitive control: a period is found, and from period to period the error falls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baselines.repetitive import Repetitive
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.envs.truth import limit_band, randomise_plant
from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import load_effect
from rdpi_gym.signals import Sine
from rdpi_gym.support.errors import InputError
from tests.baselines.playing import play

TS = 1e-4
BELIEF = limit_band(P10, 800.0)
LAYOUT = ObservationLayout.for_plant(BELIEF, TS)
TRUTH = randomise_plant(BELIEF, 0.2, np.random.default_rng(5))


def test_from_period_to_period_the_error_falls_and_without_one_nothing_is_learned():
    time = TS * np.arange(1300)
    sine = Sine(amplitude_um=30.0, frequency_hz=60.0, smooth_start_s=0.02)(time)
    chirp = 30.0 * np.sin(2 * np.pi * (20.0 + 300.0 * time) * time)
    r = np.stack([sine, chirp], axis=1)
    controller = Repetitive(BELIEF, LAYOUT, {})
    _, errors, state, _ = play(controller, TRUTH, r)
    assert controller.periods.tolist() == [167, 0]
    first, last = (
        np.sqrt(np.mean(errors[part] ** 2, axis=0)) for part in (slice(260, 420), slice(-167, None))
    )
    assert last[0] < 0.2 * first[0]
    assert not controller.rows.of(state, "correction")[:, 1].any()


def test_the_certificate_is_computed_and_a_filter_that_lets_a_mode_through_has_none():
    ringing = load_effect("resonance")(f0_hz=739.0, damping=0.03)
    stage = replace(BELIEF, effects=(ringing,))
    assert "a period leaves at most" in Repetitive(stage, LAYOUT, {}).certificate()
    assert Repetitive(stage, LAYOUT, {"band_hz": 800.0}).certificate() is None


def test_without_a_plan_it_says_so():
    with pytest.raises(InputError, match="call plan"):
        Repetitive(BELIEF, replace(LAYOUT), {}).predict(np.zeros(LAYOUT.size, dtype=np.float32))
