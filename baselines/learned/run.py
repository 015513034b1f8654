"""A training in its folder: what was asked for, the environment, the agent, where results lie."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Any

from baselines.learned.folder import FORMAT, VERSION, check_folder
from baselines.learned.options import TrainingOptions
from baselines.learned.settings import Settings, read_settings


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
    def open(
        cls,
        options: TrainingOptions,
        name: str,
        algorithm: Callable[..., Any],
        samples: int = 0,
    ) -> Run:
        """Read the hyper-parameters, and see that the folder is new or was of the same options."""
        settings = read_settings(options.file(name), algorithm)
        timesteps = options.timesteps or settings.timesteps
        package = algorithm.__module__.partition(".")[0]
        libraries = ("torch", "numpy") if package == "baselines" else (package, "torch", "numpy")
        least = samples * (options.lanes or settings.lanes)
        every = options.every or max(-(-timesteps // 20), least)
        run = cls(options, settings, name, timesteps, every, libraries)
        check_folder(options.out, run.document())
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
