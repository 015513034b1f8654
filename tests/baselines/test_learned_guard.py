"""The monitor beside a policy: what it takes off, what it leaves alone, and what drives then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch")

from baselines import make_controller
from baselines.base import Baseline
from baselines.learned.controller import FALLBACK, Guarded, find_learned
from baselines.monitors import QUANTITIES
from baselines.registry import known_controller
from rdpi_gym.cli import main
from rdpi_gym.envs import ObservationLayout, TrackingTask
from rdpi_gym.envs.truth import limit_band
from rdpi_gym.plant import P10
from rdpi_gym.signals import Sine
from rdpi_gym.support.errors import InputError

TS, LAST = 1e-4, 300
BELIEF = limit_band(P10, 800.0)
LAYOUT = ObservationLayout.for_plant(BELIEF, ts_s=TS, preview=8)
REFERENCE = Sine(amplitude_um=30.0, frequency_hz=20.0, smooth_start_s=0.05)(TS * np.arange(1501))[
    :, None
]


class Policy(Baseline):
    """What PI on the belief does, and from sample 500 on what a test says."""

    def __init__(self, spoilt):
        super().__init__(BELIEF, LAYOUT)
        self.inner, self.spoilt = known_controller("pi-preview")(BELIEF, LAYOUT), spoilt

    def start(self, reference_um):
        return np.vstack([self.inner.start(reference_um), np.zeros((1, len(reference_um)))])

    def next_command(self, observation, reference_um, state):
        command = self.inner.next_command(observation, reference_um, state[:-1])
        state[-1] += 1.0
        return self.spoilt(command, state[-1]) if state[-1, 0] > 500 else command


def driven(controller):
    task = TrackingTask(BELIEF, LAYOUT)
    observation, state, errors, handed = task.reset(REFERENCE), None, [], []
    for _ in range(len(REFERENCE) - 1):
        action, state = controller.predict(observation, state)
        observation = task.step(LAYOUT.place_to_V(action[:, 0]))
        errors.append(float(task.error_um[0]))
        handed.append(bool(controller.handed_over(state)[0]))
    return np.abs(errors), np.array(handed)


def alone():
    return known_controller(FALLBACK)(BELIEF, LAYOUT)


def test_a_policy_that_fails_is_taken_off_and_the_fallback_tracks():
    for name, spoilt in (
        ("rings", lambda command, k: command + 20.0 * np.sin(2.0 * np.pi * 700.0 * TS * k)),
        ("stays at its limit", lambda command, k: np.full_like(command, 80.0)),
        ("is no number", lambda command, k: np.full_like(command, np.nan)),
    ):
        errors, handed = driven(Guarded(Policy(spoilt), alone()))
        assert not handed[:500].any(), name
        assert handed[600:].all(), name
        assert errors[-LAST:].max() < 0.02 * 60.0, name  # two percent of the stroke


SEEN = {"reference_step": 0.02, "error": 0.02, "measured_step": 0.02, "command_step": 0.02}


def test_a_loop_that_goes_further_than_its_training_is_handed_over():
    def holds(command, k):  # neither rings nor ends at a limit
        return np.full_like(command, 5.0)

    errors, handed = driven(Guarded(Policy(holds), alone()))
    assert not handed.any()
    assert errors[-LAST:].max() > 0.1 * 60.0
    errors, handed = driven(Guarded(Policy(holds), alone(), SEEN))
    assert not handed[:500].any()
    assert handed[700:].all()
    assert errors[-LAST:].max() < 0.02 * 60.0


def test_what_a_training_saw_is_kept_with_its_policy(tmp_path):
    for name in ("imitation-stage", "ppo-increment"):
        policy = find_learned(name)
        assert sorted(policy.seen) == sorted(QUANTITIES)
        assert find_learned(str(policy.save(tmp_path / name))).seen == policy.seen
    path = tmp_path / name / "policy.json"
    path.write_text(path.read_text().replace('"error": 0.1', '"error": -0.1'))
    with pytest.raises(InputError, match=r"policy\.json: seen is .*; give numbers above 0 for"):
        find_learned(str(tmp_path / name))


def test_a_policy_that_tracks_is_left_alone():
    errors, handed = driven(Guarded(Policy(lambda command, k: command), alone(), SEEN))
    assert not handed.any()
    assert errors[-LAST:].max() < 0.02 * 60.0


def test_an_episode_that_begins_is_the_policys_again():
    guarded = Guarded(Policy(lambda command, k: command), alone())
    state = guarded.start(np.zeros(2))
    guarded.rows.of(state, "share")[:] = 1.0
    _, state = guarded.predict(np.zeros((2, LAYOUT.size)), state, episode_start=[True, False])
    assert guarded.handed_over(state).tolist() == [False, True]


class Shown(Baseline):
    """Fallback that keeps what it is shown."""

    def start(self, reference_um):
        return np.zeros((0, len(reference_um)))

    def next_command(self, observation, reference_um, state):
        self.shown = observation.copy()
        return np.zeros(len(observation))


def test_a_fallback_that_rests_is_shown_the_reference_in_place_of_the_reading_in_any_order_of_fields():
    for fields in (LAYOUT.fields, ("measured", "command", "reference")):
        layout = replace(LAYOUT, fields=fields)
        fallback, inner = Shown(BELIEF, layout), Shown(BELIEF, layout)
        guarded = Guarded(inner, fallback)
        observation = np.linspace(0.0, 1e-3, layout.size, dtype=np.float32)[None]
        guarded.predict(observation)
        expected = observation.copy()
        own = layout.columns
        expected[:, own["measured"]] = observation[:, own["reference"]][:, :1]
        np.testing.assert_array_equal(fallback.shown, expected, err_msg=str(fields))


def test_a_shipped_policy_is_guarded_by_its_name_and_at_another_sampling_time_too(
    tmp_path, monkeypatch, capsys
):
    slow = ObservationLayout.for_plant(BELIEF, ts_s=1e-3, preview=8)
    guarded = make_controller("guarded:ppo-increment", BELIEF, slow)
    assert guarded.handed_over(guarded.start(np.zeros(3))).all()
    monkeypatch.chdir(tmp_path)
    words = ["bench", "--task", "Bare", "--draws", "1", "--controllers", "guarded:ppo-incremnt"]
    assert main(words) == 2
    assert "give a folder with policy.json, or a shipped policy" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
