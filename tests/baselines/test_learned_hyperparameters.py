"""Hyper-parameters as rl-baselines3-zoo reads them: its rules, applied to the files that ship."""

from importlib import import_module

import gymnasium as gym
import pytest
import yaml

pytest.importorskip("stable_baselines3")

import stable_baselines3 as sb3

import rdpi_gym  # noqa: F401  # registers the environments
from baselines.learned.settings import ENVIRONMENT_ID, SHIPPED, read_settings
from rdpi_gym.envs.wrappers.history import History
from rdpi_gym.envs.wrappers.scaling import Scaling

ALGORITHMS = {"ppo": sb3.PPO, "sac": sb3.SAC, "td3": sb3.TD3}


def zoo_wrapper(entries):
    """Do what its `get_wrapper_class` does: import each class by its dotted name and apply it."""
    env = gym.make(ENVIRONMENT_ID)
    for entry in entries:
        ((name, options),) = entry.items()
        module, _, attribute = name.rpartition(".")
        env = getattr(import_module(module), attribute)(env, **options)
    return env


@pytest.mark.parametrize("name", ALGORITHMS)
def test_the_shipped_file_is_read_alike_by_the_zoo(name):
    path = SHIPPED / f"{name}.yml"
    raw = yaml.safe_load(path.read_text())[ENVIRONMENT_ID]
    settings = read_settings(path, ALGORITHMS[name])
    env = zoo_wrapper(raw["env_wrapper"])
    law = Scaling(
        History(env.unwrapped.layout, settings.history), settings.frequency_hz, settings.error
    )
    assert env.observation_space.shape == (law.history.size,)
    assert (env.scaling.frequency_hz, env.scaling.error) == (law.frequency_hz, law.error)
    assert (settings.lanes, settings.timesteps) == (raw["n_envs"], raw["n_timesteps"])
    # What the zoo leaves over after its own keys goes to the algorithm as it is.
    own = {"n_envs", "n_timesteps", "env_wrapper", "noise_type", "noise_std"}
    for key in set(raw) - own - {"learning_rate", "clip_range"}:
        assert settings.arguments()[key] == raw[key]


@pytest.mark.slow
@pytest.mark.parametrize("name", ALGORITHMS)
def test_the_algorithm_takes_the_shipped_arguments(name):
    settings = read_settings(SHIPPED / f"{name}.yml", ALGORITHMS[name])
    arguments = settings.arguments() | ({"buffer_size": 100} if name != "ppo" else {})
    model = ALGORITHMS[name](env=gym.make(ENVIRONMENT_ID), device="cpu", **arguments)
    assert model.gamma < 0.99


def test_a_schedule_falls_linearly_to_zero(tmp_path):
    path = tmp_path / "a.yml"
    path.write_text("default: {n_envs: 1, n_timesteps: 10, learning_rate: lin_3e-4}")
    schedule = read_settings(path, sb3.PPO).arguments()["learning_rate"]
    assert [schedule(left) for left in (1.0, 0.5, 0.0)] == pytest.approx([3e-4, 1.5e-4, 0.0])


def test_the_environments_own_entry_goes_before_the_default(tmp_path):
    path = tmp_path / "a.yml"
    entries = {
        "default": {"n_envs": 1, "n_timesteps": 1},
        ENVIRONMENT_ID: {"n_envs": 2, "n_timesteps": 1e3},
    }
    path.write_text(yaml.safe_dump(entries))
    settings = read_settings(path, sb3.PPO)
    assert (settings.lanes, settings.timesteps) == (2, 1000)
