"""Options of the study, and its trainings, each in a folder of its own."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from baselines import CONTROLLERS, inverts_any_core, inverts_effects
from baselines.learned.options import TrainingOptions
from rdpi_gym.envs.layout import ActionMode
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json
from rdpi_gym.support.parallel import run_cases
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.store import Row

BASELINE = "inversion-free-low-passed"
"""Compensator that corrections correct and trainings are compared with: the best causal one on plants
with all effects, where PI with a belief that lacks them is unstable."""


@dataclass(frozen=True)
class Agent:
    """An algorithm and a reading of its actions."""

    algorithm: Literal["ppo", "sac"]  # of Stable-Baselines3
    action: ActionMode  # ``correction``: of :data:`BASELINE`; ``increment``: of the command alone

    @property
    def name(self) -> str:
        """Name in tables and folders."""
        return f"{self.algorithm}-{self.action}"


@dataclass(frozen=True)
class Taught:
    """A student that ships as ``imitation-NAME``, and its training."""

    name: str
    task: str  # names, joined by commas
    timesteps: int  # of all plants together
    lanes: int = 96  # a multiple of the references of all its tasks
    passes: int = 1  # through what a round met


@dataclass(frozen=True)
class Study:
    """Options of the study."""

    agents: tuple[Agent, ...] = (
        Agent("ppo", "correction"),
        Agent("ppo", "increment"),
        Agent("sac", "correction"),
        Agent("sac", "increment"),
    )
    # weights, exploration, plants, references and noise of the trainings; each agent with every seed
    seeds: tuple[int, ...] = tuple(range(5))
    # steps of a training; None: `n_timesteps` of the algorithm's hyper-parameters
    timesteps: int | None = None
    # plants side by side; None: `n_envs` of the hyper-parameters
    lanes: int | None = None
    # steps between evaluations and checkpoints; None: a twentieth of all
    every: int | None = None
    # controllers beside the agents; without effects in the belief those left out are others' doubles
    rivals: tuple[str, ...] = tuple(
        name for name in CONTROLLERS if not (inverts_effects(name) or inverts_any_core(name))
    )
    # held-out plants of a group, each drawn with a seed of its own
    plants: int = 10
    # references of the benchmark's suite; sines of 25 to 100 Hz, the others about 20 Hz
    references: tuple[str, ...] = ("sine", "triangle", "multisine", "raster", "nested-loops")
    # domains of the gap, see `scores.GAP`
    domains: tuple[str, ...] = ("bare", "with effects", "picma", "picma at 1 Hz")
    # resamples of the bootstrap
    resamples: int = 2000
    # students; the one of Creep is the best on Bare too
    taught: tuple[Taught, ...] = (
        Taught("stage", "Stage", 28_800_000),
        Taught("resonance", "Resonance", 9_600_000),
        Taught("creep", "Creep", 7_200_000),
        Taught("lag", "Lag", 36_000_000),
        Taught("kinds", "Preisach,BoucWen,Duhem", 45_000_000, lanes=90),
        Taught("measured", "Measured", 22_000_000, lanes=108, passes=2),
    )

    def options(self, agent: Agent, seed: int, out: Path) -> dict[str, Any]:
        """Return what is asked of a training: fields of `TrainingOptions`."""
        return {
            "out": out,
            "seed": seed,
            "timesteps": self.timesteps,
            "lanes": self.lanes,
            "every": self.every,
            "action": agent.action,
            "baseline": BASELINE,
        }


FULL = Study()
"""Options of the published tables."""

QUICK = Study(
    agents=(Agent("ppo", "correction"), Agent("sac", "increment")),
    seeds=(0,),
    timesteps=512,
    lanes=4,
    every=512,
    rivals=("none", BASELINE, "preview-inversion"),
    plants=2,
    references=("triangle",),
    domains=("bare", "picma"),
    resamples=100,
    taught=(Taught("bare", "Bare", 1),),
)
"""Every step of the study in seconds; its agents have learned nothing."""


_CONFIG, _CONFIG_FORMAT = "config.json", ("rdpi-training", 1)


@dataclass(frozen=True)
class Training:
    """One agent, trained with one seed."""

    study: Study  # what it belongs to
    agent: Agent
    seed: int  # which one
    runs: Path  # folder of all trainings

    @property
    def folder(self) -> Path:
        """Folder of this training."""
        return self.runs / f"{self.agent.name}-{self.seed}"

    @property
    def policy(self) -> Path:
        """Folder of the policy that did best in its evaluations."""
        return self.folder / "policy"

    def is_finished(self) -> bool:
        """True if nothing is left to be trained; a policy without its training counts as finished."""
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
    try:
        from baselines.learned.training import trainer

        chosen = trainer(training.agent.algorithm)
    except ImportError as error:
        raise InputError(f"training needs {error.name}; install rdpi-gym[rl]") from error
    options = training.study.options(training.agent, training.seed, training.folder)
    return chosen.train(chosen.Options(**options))
