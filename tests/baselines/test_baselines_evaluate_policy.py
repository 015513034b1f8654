"""Stable-Baselines3's evaluate_policy runs every baseline unchanged."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest

import rdpi_gym  # noqa: F401  # registers the environment
from baselines import CONTROLLERS, make_controller
from rdpi_gym.signals import Sine
from rdpi_gym.support.errors import InputError
from tests.looping import over

gym = pytest.importorskip("gymnasium")
evaluation = pytest.importorskip("stable_baselines3.common.evaluation")
vec_env = pytest.importorskip("stable_baselines3.common.vec_env")

STEPS = 80
SIGNAL = Sine(amplitude_um=40.0, frequency_hz=100.0, smooth_start_s=0.002)


def make_env():
    return gym.make(
        "rdpi_gym/PiezoTracking-v0", reference=SIGNAL, ts_s=2e-4, max_episode_steps=STEPS
    )


@pytest.fixture(scope="module")
def static_gain_reward():
    return mean_reward("none")[0]


def mean_reward(name):
    single = make_env().unwrapped
    controller = make_controller(name, single.belief, single.layout)
    if hasattr(controller, "plan"):
        controller.plan(SIGNAL(2e-4 * np.arange(STEPS + 1))[:, None])
    env = vec_env.DummyVecEnv([make_env, make_env])
    rewards, lengths = evaluation.evaluate_policy(
        controller, env, n_eval_episodes=5, return_episode_rewards=True, warn=False
    )
    assert lengths == [STEPS] * 5
    return np.mean(rewards), np.ptp(rewards)


@over(
    "name", [n for n in CONTROLLERS if n != "none" and (n != "h-infinity" or find_spec("slycot"))]
)
def test_every_baseline(name, static_gain_reward):
    mean, spread = mean_reward(name)
    # The episodes are the same, so one whose memory was not reset would stand out.
    assert spread < 1e-9
    assert mean > static_gain_reward or name == "pi"


def test_a_baseline_answers_the_default_id_of_a_task_with_its_history():
    env = gym.make("rdpi_gym/PiezoStage-v0", max_episode_steps=STEPS)
    inner = env.unwrapped
    controller = make_controller("hybrid", inner.belief, inner.layout)
    rewards, lengths = evaluation.evaluate_policy(
        controller, env, n_eval_episodes=2, return_episode_rewards=True, warn=False
    )
    assert lengths == [STEPS] * 2
    assert np.isfinite(rewards).all()
    observation, _ = env.reset(seed=0)
    alone, _ = controller.predict(observation[: inner.layout.size])
    stacked, _ = controller.predict(observation)
    assert alone == stacked
    with pytest.raises(InputError, match="this layout shows 11 numbers"):
        controller.predict(observation[:14])  # of another preview
