"""Actions that correct a baseline: its command plus theirs, from its belief and not from the truth."""

import os
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import rdpi_gym
from baselines import make_controller
from rdpi_gym.envs import PiezoTrackingEnv
from rdpi_gym.support.errors import InputError
from tests.looping import over

ZERO = np.zeros(1, dtype=np.float32)
BASELINES = ["none", "classical-low-passed", "pi-inversion-free-low-passed", "preview-inversion"]


def commands(env, actions, seed=0, **options):
    """Return the commands (V) of an episode."""
    env.reset(seed=seed, options=options)
    return np.array([env.step(action)[4]["command_V"] for action in actions])


@over("name", BASELINES)
def test_no_correction_is_the_baseline_itself(name):
    corrected = PiezoTrackingEnv(plant="P5", action="correction", baseline=name, noise_um=0.02)
    env = PiezoTrackingEnv(plant="P5", noise_um=0.02)
    found = commands(corrected, [ZERO] * 300)
    controller = make_controller(name, env.belief, env.layout)
    observation, info = env.reset(seed=0)
    if hasattr(controller, "plan"):
        t = env.layout.ts_s * np.arange(500)
        controller.plan(env.signal(t)[:, None])
    state, expected = None, []
    for k in range(300):
        action, state = controller.predict(observation, state, np.array([k == 0]))
        observation, *_, info = env.step(action)
        expected.append(info["command_V"])
    # What is planned ahead is planned over a longer reference there: its iterations end elsewhere.
    np.testing.assert_allclose(found, expected, atol=1e-3 if name == "preview-inversion" else 1e-6)


def test_a_correction_is_added_in_units_of_its_scale():
    env = PiezoTrackingEnv(
        plant="P5", action="correction", baseline="classical-reference-rate", action_scale_V=0.5
    )
    actions = np.random.default_rng(0).uniform(-1, 1, (200, 1)).astype(np.float32)
    alone, corrected = commands(env, [ZERO] * 200), commands(env, actions)
    np.testing.assert_allclose(corrected - alone, 0.5 * actions[:, 0], atol=1e-6)


def test_the_three_ways_to_act_reach_the_same_displacements():
    wanted = 20.0 * np.sin(0.05 * np.arange(1, 301))
    command = PiezoTrackingEnv(plant="P10", frequency_hz=20.0)
    increment = PiezoTrackingEnv(plant="P10", frequency_hz=20.0, action="increment")
    correction = PiezoTrackingEnv(  # a feedforward: its command depends on the reference only
        plant="P10", frequency_hz=20.0, action="correction", baseline="classical-static",
        action_scale_V=80.0,
    )  # fmt: skip
    baseline = commands(correction, [ZERO] * 300)
    places = {
        command: wanted / 80.0,
        increment: np.diff(wanted, prepend=0.0) / increment.layout.action_scale_V,
        correction: (wanted - baseline) / 80.0,
    }
    shown = []
    for env, actions in places.items():
        env.reset(seed=0)
        infos = [env.step(np.array([x], dtype=np.float32))[4] for x in actions]
        np.testing.assert_allclose([info["command_V"] for info in infos], wanted, atol=2e-5)
        assert infos[-1]["saturated"] == 0.0
        shown.append([info["displacement_um"] for info in infos])
    np.testing.assert_allclose(shown[1], shown[0], atol=1e-3)
    np.testing.assert_allclose(shown[2], shown[0], atol=1e-3)


def test_the_baseline_sees_its_belief_and_not_the_truth():
    env = PiezoTrackingEnv(plant="P5", action="correction", baseline="classical-reference-rate")
    nominal = commands(env, [ZERO] * 200)
    elsewhere = commands(env, [ZERO] * 200, weights=np.array(env.nominal.hysteresis.weights) * 1.2)
    np.testing.assert_array_equal(elsewhere, nominal)
    believing = PiezoTrackingEnv(
        plant="P5", action="correction", baseline="classical-reference-rate", belief="P5-static"
    )
    assert np.abs(commands(believing, [ZERO] * 200) - nominal).max() > 0.1


def test_a_stateful_baseline_begins_each_episode_anew():
    env = PiezoTrackingEnv(plant="P5", action="correction", baseline="pi", frequency_hz=50.0)
    first = commands(env, [ZERO] * 150)
    np.testing.assert_array_equal(commands(env, [ZERO] * 150), first)


def test_a_correction_does_not_reach_what_the_user_was_shown():
    env = PiezoTrackingEnv(plant="P5", action="correction", baseline="pi", frequency_hz=50.0)
    undisturbed = commands(env, [ZERO] * 50)
    observation, _ = env.reset(seed=0)
    found = []
    for _ in range(50):
        observation *= 0.0
        observation, *_, info = env.step(ZERO)
        found.append(info["command_V"])
    np.testing.assert_array_equal(found, undisturbed)


def test_an_unknown_baseline_is_refused():
    with pytest.raises(InputError, match="classical"):
        PiezoTrackingEnv(action="correction", baseline="clasical-static")


@over("mode", ["command", "increment"])
def test_evaluate_policy_runs_a_baseline_unchanged(mode):
    evaluation = pytest.importorskip("stable_baselines3.common.evaluation")
    monitor = pytest.importorskip("stable_baselines3.common.monitor")
    env = gym.make("rdpi_gym/PiezoTracking-v0", action=mode, max_episode_steps=200)
    plain = env.unwrapped
    rewards = {
        name: evaluation.evaluate_policy(
            make_controller(name, plain.belief, plain.layout), monitor.Monitor(env), 2, warn=False
        )[0]
        for name in ("none", "classical-low-passed")
    }
    assert rewards["none"] < rewards["classical-low-passed"] < 0.0


ASK = """
import sys, gymnasium, rdpi_gym
assert "baselines" not in sys.modules
env = gymnasium.make("rdpi_gym/PiezoTracking-v0", action="correction", baseline="pi")
env.reset(seed=0)
assert "baselines" in sys.modules
"""


@pytest.mark.slow
def test_a_name_is_found_without_an_import_of_the_controllers_and_without_installation(tmp_path):
    root = str(Path(rdpi_gym.__file__).parents[1])
    subprocess.run(
        [sys.executable, "-c", ASK], cwd=tmp_path, check=True, env=os.environ | {"PYTHONPATH": root}
    )
