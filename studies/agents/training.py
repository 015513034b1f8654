"""The trainings of the study, each in a folder of its own."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path

from baselines.learned.options import TrainingOptions
from baselines.learned.training import trainer
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json
from rdpi_gym.support.parallel import run_cases
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.store import Row
from studies.agents.study import Agent, Study

_CONFIG, _CONFIG_FORMAT = "config.json", ("rdpi-training", 1)


@dataclass(frozen=True)
class Training:
    """One agent, trained with one seed.

    Parameters
    ----------
    study
        What it belongs to.
    agent, seed
        Which one.
    runs
        Folder of all trainings.
    """

    study: Study
    agent: Agent
    seed: int
    runs: Path

    @property
    def folder(self) -> Path:
        """Folder of this training."""
        return self.runs / f"{self.agent.name}-{self.seed}"

    @property
    def policy(self) -> Path:
        """Folder of the policy that did best in its evaluations."""
        return self.folder / "policy"

    def is_finished(self) -> bool:
        """Whether nothing is left to be trained; a policy without its training counts as finished."""
        if not (self.policy / "policy.json").is_file():
            return False
        if not (self.folder / _CONFIG).exists():
            return True
        config = read_json(self.folder / _CONFIG, *_CONFIG_FORMAT)
        options = TrainingOptions(**self.study.options(self.agent, self.seed, self.folder))
        if config.get("options") != json.loads(json.dumps(options.document())):
            raise InputError(
                f"{self.folder} holds a training of other options; give another folder for --runs"
            )
        rows = self._curve()
        return bool(rows) and int(rows[-1]["timesteps"]) >= int(config["timesteps"])

    def row(self) -> Row:
        """Return what it cost: steps, seconds (None where only the policy is kept) and bytes."""
        rows = self._curve()
        last = rows[-1] if rows else None
        return {
            "agent": self.agent.name,
            "seed": self.seed,
            "timesteps": None if last is None else int(last["timesteps"]),
            "seconds": None if last is None else float(last["seconds"]),
            "policy_bytes": sum(file.stat().st_size for file in self.policy.iterdir()),
        }

    def _curve(self) -> list[dict[str, str]]:
        path = self.folder / "training.csv"
        if not path.exists():
            return []
        with path.open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))


def all_trainings(study: Study, runs: Path) -> list[Training]:
    """Return every training of the study, seed by seed."""
    return [Training(study, agent, seed, runs) for seed in study.seeds for agent in study.agents]


def train_all(
    study: Study,
    runs: Path,
    jobs: int = 1,
    progress: Progress | None = None,
    ray_address: str | None = None,
) -> int:
    """Train what is not finished, each training from its newest checkpoint on."""
    left = [each for each in all_trainings(study, runs.absolute()) if not each.is_finished()]
    for done, _ in enumerate(run_cases(train_one, left, jobs, ray_address), start=1):
        if progress is not None:
            progress("training", done, len(left))
    return len(left)


def train_one(training: Training) -> Path:
    """Train one agent, or go on; the same call again does what is left, so it may be repeated."""
    chosen = trainer(training.agent.algorithm)
    options = training.study.options(training.agent, training.seed, training.folder)
    return chosen.train(chosen.Options(**options))
