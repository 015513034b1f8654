"""A training in its folder: what was asked for, the environment, the agent, where results lie."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import stable_baselines3
import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from baselines.learned.environments import training_environment
from baselines.learned.options import TrainingOptions
from baselines.learned.settings import SHIPPED, Settings, read_settings
from rdpi_gym.envs.wrappers.stable_baselines import StableBaselinesVecEnv
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json

FORMAT, VERSION = "rdpi-training", 1
CONFIG, CURVE, POLICY, CHECKPOINT = "config.json", "training.csv", "policy", "checkpoint"

Algorithm = TypeVar("Algorithm", bound=BaseAlgorithm)


@dataclass(frozen=True)
class Run:
    """A training in its folder.

    Parameters
    ----------
    options
        What was asked for.
    settings
        Its hyper-parameters.
    algorithm
        Name, as on the command line.
    timesteps, every
        Steps in all, and of a stretch.
    """

    options: TrainingOptions
    settings: Settings
    algorithm: str
    timesteps: int
    every: int

    @classmethod
    def open(cls, options: TrainingOptions, name: str, algorithm: type[BaseAlgorithm]) -> Run:
        """Read the hyper-parameters, and see that the folder is new or was of the same options.

        Raises
        ------
        InputError
            Bad hyper-parameters, or the folder holds something else; nothing is written yet.
        """
        path = options.hyperparameters or SHIPPED / f"{name}.yml"
        settings = read_settings(path, algorithm)
        timesteps = options.timesteps or settings.timesteps
        run = cls(options, settings, name, timesteps, options.every or -(-timesteps // 20))
        config = options.out / CONFIG
        if config.exists():
            _check_same(read_json(config, FORMAT, VERSION), run.document(), options.out)
        elif any((options.out / name).exists() for name in (CURVE, POLICY, CHECKPOINT)):
            raise InputError(
                f"{options.out} holds results without {CONFIG}; give another folder for --out"
            )
        elif options.out.exists() and not options.out.is_dir():
            raise InputError(f"{options.out} is a file; give a folder for --out")
        return run

    def environment(self) -> StableBaselinesVecEnv:
        """Make what the agent is trained in."""
        return training_environment(self.options, self.settings)

    def model(self, algorithm: type[Algorithm], env: StableBaselinesVecEnv) -> Algorithm:
        """Make the agent, its networks drawn from the seed.

        Raises
        ------
        InputError
            The algorithm refuses the hyper-parameters.
        """
        torch.set_num_threads(self.options.threads)
        logs = str(self.options.out / "tensorboard") if self.options.tensorboard else None
        arguments = {"policy": "MlpPolicy", **self.settings.arguments()}
        try:
            made: Algorithm = algorithm(
                env=env, seed=self.options.seed, device="cpu", tensorboard_log=logs, **arguments
            )
        except (AssertionError, TypeError, ValueError, MemoryError, RuntimeError) as error:
            reason = " ".join(str(error).split())[:200]
            raise InputError(
                f"{algorithm.__name__} refuses its hyper-parameters: {reason}"
            ) from error
        return made

    def document(self) -> dict[str, Any]:
        """All that the result depends on: what ``config.json`` says."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "algorithm": self.algorithm,
            "timesteps": self.timesteps,
            "every": self.every,
            "lanes": self.options.lanes or self.settings.lanes,
            "options": self.options.document(),
            "hyperparameters": asdict(self.settings),
            "versions": {
                "stable_baselines3": stable_baselines3.__version__,
                "torch": torch.__version__,
                "numpy": np.__version__,
            },
        }


def _check_same(found: dict[str, Any], asked: dict[str, Any], out: Path) -> None:
    """Refuse to go on in a folder of other options, and name the first that differs."""
    before, now = _flat(found), _flat(json.loads(json.dumps(asked)))
    for name in [*now, *before]:
        if before.get(name) != now.get(name):
            raise InputError(
                f"{out} holds a training with {name} {before.get(name)!r}, asked for is "
                f"{now.get(name)!r}; give another folder for --out, or the options of that one"
            )


def _flat(document: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in document.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            flat[prefix + name] = value
    return flat
