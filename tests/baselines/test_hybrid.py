"""The hybrid: feedback while the reference rests, the adaptive feedforward while it moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baselines.adaptive_feedforward import AdaptiveFeedforward
from baselines.hybrid import Hybrid
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.envs.truth import limit_band
from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import load_effect
from tests.baselines.playing import play

TS = 1e-4
BELIEF = limit_band(P10, 800.0)
LAYOUT = replace(ObservationLayout.for_plant(BELIEF, TS), preview=8)
CREEPING = replace(BELIEF, effects=(load_effect("creep")(gain_per_decade=0.1),))


@pytest.fixture(scope="module")
def played():
    """A cubed sine that comes to rest, on a plant that creeps: commands and errors of both."""
    time = TS * np.arange(1000)
    r = np.where(time < 0.03, 10.0 * np.sin(2 * np.pi * 25.0 * time) ** 3, -10.0)[:, None]
    every = {}
    for kind in (Hybrid, AdaptiveFeedforward):
        commands, errors, _, _ = play(kind(BELIEF, LAYOUT, {}), CREEPING, r)
        every[kind] = np.hstack([commands, errors])
    return every


def test_in_motion_it_is_the_adaptive_feedforward(played):
    np.testing.assert_array_equal(played[Hybrid][:190, 0], played[AdaptiveFeedforward][:190, 0])


def test_at_rest_creep_is_fed_back_and_there_is_no_bump(played):
    """10 % a decade of 10 µm is 7 µm/s after 60 ms; the loop's time constant, 11 ms, leaves 0.08 µm."""
    commands, errors = played[Hybrid].T
    assert np.abs(errors[-300:]).max() < 0.1
    rests = np.abs(np.diff(commands[310:]))
    assert rests.max() < 0.05


def test_the_certificate_tells_rest_from_motion_and_the_warning_of_a_feedback_too_fast():
    calm = Hybrid(BELIEF, LAYOUT, {})
    assert calm.certificate().startswith("at rest passive: stable for any hysteresis")
    assert calm.warning() is None
    late = replace(BELIEF, effects=(load_effect("delay")(delay_s=3e-3),))
    assert (
        "the feedback at rest is unstable"
        in Hybrid(late, LAYOUT, {"crossover_hz": 100.0}).warning()
    )
