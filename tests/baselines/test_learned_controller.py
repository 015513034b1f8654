"""A trained policy does in the benchmark what it did in its environment."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch")

import torch

import rdpi_gym  # noqa: F401  # registers the environments
from baselines.learned.controller import LearnedController
from benchmarks.tracking.episode import record
from rdpi_gym.envs import ObservationLayout, PiezoTrackingEnv, TrackingTask
from rdpi_gym.envs.wrappers.history import HistoryObservation
from rdpi_gym.envs.wrappers.scaling import ScaledObservation
from rdpi_gym.plant import named_plant
from rdpi_gym.support.errors import InputError
from tests.baselines.playing import make_policy

P10 = named_plant("P10")
BASELINES = {"command": None, "increment": None, "correction": "pi-classical-low-passed"}


def tame(action, history=3, **fields):
    """A policy in whose loop the last digits are not amplified."""
    policy = make_policy(action, (16,), history, **{"baseline": BASELINES[action]} | fields)
    with torch.no_grad():
        policy.actor[2].weight *= 0.1
    return policy


def environment(action, **keywords):
    return PiezoTrackingEnv(
        plant="P10", preview=2, action=action, baseline=BASELINES[action], noise_um=0.01,
        frequency_hz=60.0, **keywords,
    )  # fmt: skip


@pytest.mark.parametrize("history", [0, 3])
@pytest.mark.parametrize("action", BASELINES)
def test_it_commands_what_the_policy_commanded_in_its_environment(action, history):
    policy = tame(action, history)
    env = ScaledObservation(HistoryObservation(environment(action), history))
    shown, info = env.reset(seed=5)
    expected = []
    for _ in range(150):
        with torch.no_grad():
            answer = policy.actor(torch.from_numpy(shown[None]))[0].numpy()
        shown, *_, info = env.step(answer)
        expected.append(info["command_V"])
    plain = environment("command") if action != "increment" else environment("increment")
    controller = LearnedController(policy, plain.belief, plain.layout)
    observation, _ = plain.reset(seed=5)
    state, found = None, []
    for k in range(150):
        answer, state = controller.predict(observation, state, np.array([k == 0]))
        observation, *_, info = plain.step(answer)
        found.append(info["command_V"])
    # A float32 action rounds a command to 1e-5 V, which the PI and the policy feed back.
    np.testing.assert_allclose(found, expected, atol=1e-4)
    assert np.ptp(expected) > 1.0


def test_lanes_are_the_episodes_one_by_one_and_begin_where_they_are_told():
    policy = tame("correction")
    layout = ObservationLayout.for_plant(P10, ts_s=1e-4, preview=2)
    shown = np.random.default_rng(0).uniform(-0.5, 0.5, (12, 3, layout.size)).astype(np.float32)
    starts = np.zeros((12, 3), dtype=bool)
    starts[0] = starts[7, 1] = starts[4, 2] = True
    controller = LearnedController(policy, P10, layout)
    state, together = None, []
    for k in range(12):
        action, state = controller.predict(shown[k], state, starts[k])
        together.append(action[:, 0])
    for lane in range(3):
        state = None
        for k in range(12):
            if starts[k, lane]:
                state = None
            action, state = controller.predict(shown[k, lane], state)
            assert action[0] == pytest.approx(together[k][lane], abs=1e-6)


def test_a_longer_preview_changes_nothing():
    policy = tame("command")
    references = 20.0 * np.sin(0.03 * np.arange(80.0))[:, None]
    found = []
    for preview in (2, 7):
        layout = ObservationLayout.for_plant(P10, 1e-4, preview=preview)
        controller = LearnedController(policy, P10, layout)
        assert controller.needed_preview == 2
        rngs = [np.random.default_rng(0)]
        found.append(record(controller, [P10], layout, references, rngs).command_V)
    np.testing.assert_array_equal(*found)


def test_what_a_policy_cannot_run_with_is_refused():
    def made(policy, ts_s=1e-4, preview=2):
        return LearnedController(
            policy, P10, ObservationLayout.for_plant(P10, ts_s, preview=preview)
        )

    with pytest.raises(InputError, match="another observation layout than one of preview 1"):
        made(tame("command"), preview=1).predict(np.zeros((1, 4), dtype=np.float32))
    with pytest.raises(InputError, match=r"Ts = 0\.0001 s belongs to another observation layout"):
        made(tame("command"), ts_s=5e-5)
    with pytest.raises(InputError, match="preview-inversion"):
        made(tame("correction", baseline="preview-inversion"))


def test_on_a_plant_of_another_size_it_acts_in_proportion_and_says_so():
    policy = tame("correction", baseline="none")
    small = replace(P10, name="small", reference_um=(0.0, 4.0), command_range_V=(-8.0, 8.0))
    corrections = []
    for plant in (P10, small):
        layout = ObservationLayout.for_plant(plant, 1e-4, preview=2)
        controller = LearnedController(policy, plant, layout)
        assert (controller.warning() is None) == (plant is P10)
        shown = np.full((1, 5), 0.2, dtype=np.float32)
        corrected = controller.predict(shown)[0][0, 0]
        corrections.append(corrected - controller.baseline.predict(shown)[0][0, 0])
    assert corrections[0] == pytest.approx(corrections[1], abs=1e-6)
    assert abs(corrections[0]) > 1e-3


def test_commands_stay_in_the_range():
    policy = tame("increment", scale_V=1000.0)
    layout = ObservationLayout.for_plant(P10, 1e-4, preview=2)
    controller = LearnedController(policy, P10, layout)
    task = TrackingTask([P10] * 4, layout)
    observation = task.reset(np.tile(np.linspace(-40, 40, 4), (50, 1)))
    state = None
    for _ in range(40):
        action, state = controller.predict(observation, state)
        assert (np.abs(action) <= 1.0).all()
        observation = task.step(layout.place_to_V(action[:, 0].astype(float)))
