"""A training in its folder: what was asked for, the environment, the agent, where results lie."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from baselines.learned.options import TrainingOptions
from baselines.learned.settings import SHIPPED, Settings, read_settings
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json

FORMAT, VERSION = "rdpi-training", 1
CONFIG, CURVE, POLICY, CHECKPOINT = "config.json", "training.csv", "policy", "checkpoint"


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
    libraries
        Distributions whose versions the result depends on.
    """

    options: TrainingOptions
    settings: Settings
    algorithm: str
    timesteps: int
    every: int
    libraries: tuple[str, ...]

    @classmethod
    def open(cls, options: TrainingOptions, name: str, algorithm: Callable[..., Any]) -> Run:
        """Read the hyper-parameters, and see that the folder is new or was of the same options.

        Parameters
        ----------
        options
            What is asked for.
        name
            Of the algorithm, as on the command line.
        algorithm
            What takes the hyper-parameters by name.

        Raises
        ------
        InputError
            Bad hyper-parameters, or the folder holds something else; nothing is written yet.
        """
        path = options.hyperparameters or SHIPPED / f"{name}.yml"
        settings = read_settings(path, algorithm)
        timesteps = options.timesteps or settings.timesteps
        package = algorithm.__module__.partition(".")[0]
        libraries = ("torch", "numpy") if package == "baselines" else (package, "torch", "numpy")
        every = options.every or -(-timesteps // 20)
        run = cls(options, settings, name, timesteps, every, libraries)
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
            "versions": {name: version(name) for name in self.libraries},
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
