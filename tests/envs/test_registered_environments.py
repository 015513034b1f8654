"""Every registered id through the checks that the ecosystem expects of an environment."""

import json
import multiprocessing
import pickle
import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

import rdpi_gym  # noqa: F401  # registers the environments
from tests.looping import over

IDS = ["rdpi_gym/PiezoTracking-v0"]  # the tasks have tests of their own
VARIANTS = {
    "defaults": {},
    "increment": {"action": "increment", "plant": "P5", "command_cost": 1.0},
    "correction": {
        "action": "correction",
        "baseline": "pi-classical-reference-rate",
        "belief": "P10",
        "action_scale_V": 2.0,
    },
    "bench": {
        "plant": "P10-bench",
        "ts_s": 5e-5,
        "reference": ["sine", "triangle", {"signal": "multisine", "lines": 8}],
        "frequency_hz": [1.0, 200.0],
        "randomise": 0.2,
        "preview": 1,
    },
}
EACH = over("name, keywords", [(name, v) for name in IDS for v in VARIANTS.values()])


def episode(env, steps=300, seed=3):
    """Return every number that an episode with seeded random actions shows."""
    env.action_space.seed(seed)
    observation, info = env.reset(seed=seed)
    rows = [np.concatenate([observation, [0.0], list(info.values())])]
    for _ in range(steps):
        observation, reward, *_, info = env.step(env.action_space.sample())
        rows.append(np.concatenate([observation, [reward], list(info.values())]))
    return np.array(rows)


@EACH
def test_gymnasium_checker_has_no_complaint(name, keywords):
    env = gym.make(name, render_mode="rgb_array", **keywords)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


@EACH
def test_stable_baselines3_checker_has_no_complaint(name, keywords):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(gym.make(name, render_mode="rgb_array", **keywords))


@EACH
def test_same_seed_gives_the_same_episode(name, keywords):
    env = gym.make(name, **keywords)
    first = episode(env)
    np.testing.assert_array_equal(first, episode(env))
    np.testing.assert_array_equal(first, episode(gym.make(name, **keywords)))
    assert not np.array_equal(first, episode(env, seed=4))


@EACH
def test_pickled_mid_episode_continues_alike(name, keywords):
    env = gym.make(name, **keywords)
    episode(env)
    twin = pickle.loads(pickle.dumps(env))
    for _ in range(50):
        action = env.action_space.sample()
        ours, theirs = env.step(action), twin.step(action)
        np.testing.assert_array_equal(ours[0], theirs[0])
        assert ours[1:] == theirs[1:]


@EACH
def test_spec_survives_json(name, keywords):
    env = gym.make(name, **keywords)
    spec = EnvSpec.from_json(env.spec.to_json())
    assert json.loads(env.spec.to_json())["kwargs"] == json.loads(json.dumps(keywords))
    np.testing.assert_array_equal(episode(gym.make(spec)), episode(env))


@over("name", IDS)
def test_spawned_workers_equal_the_vector_in_process(name):
    assert "spawn" in multiprocessing.get_all_start_methods()
    sync = gym.make_vec(name, num_envs=2, vectorization_mode="sync", randomise=0.1)
    workers = gym.make_vec(
        name,
        num_envs=2,
        vectorization_mode="async",
        vector_kwargs={"context": "spawn"},
        randomise=0.1,
    )
    try:
        np.testing.assert_array_equal(workers.reset(seed=1)[0], sync.reset(seed=1)[0])
        action = np.array([[0.5], [-0.5]], dtype=np.float32)
        for _ in range(3):
            ours, theirs = workers.step(action), sync.step(action)
            np.testing.assert_array_equal(ours[0], theirs[0])
            np.testing.assert_array_equal(ours[1], theirs[1])
    finally:
        workers.close()


@over("name", IDS)
def test_time_limit_truncates_and_nothing_terminates(name):
    env = gym.make(name)
    env.reset(seed=0)
    action = np.zeros(1, dtype=np.float32)
    ends = [env.step(action)[2:4] for _ in range(2000)]
    assert ends == [(False, False)] * 1999 + [(False, True)]


def test_import_is_light():
    heavy = [
        "torch",
        "plotly",
        "matplotlib",
        "pandas",
        "numba",
        "scipy.signal",
        "stable_baselines3",
    ]
    code = f"import rdpi_gym, sys; print([m for m in {heavy} if m in sys.modules])"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"
