"""Trainings by the name of their algorithm, each continued from its newest checkpoint."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from torch import nn

from baselines import make_controller
from baselines.learned.checkpoint import Learner, load_checkpoint, save_checkpoint
from baselines.learned.controller import LearnedController
from baselines.learned.environments import Evaluation, HeldOut
from baselines.learned.options import (
    CHECKPOINT,
    CURVE,
    POLICY,
    Row,
    Run,
    TrainingOptions,
    begin_folder,
    curve_text,
)
from baselines.learned.policy import Policy
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.progress import Progress

LATEST, LATEST_S = "latest", 10.0
"""Folder of the policy as it is while a training runs, and the time (s) after which it is written again."""
_TOLD = ("timesteps", "rmse_um", "command_variation_V_s")
_COMPARED = ("rmse_um", "rmse_percent", "command_variation_V_s")


class Course:
    """Course of a training: evaluation, best policy and checkpoint between two stretches."""

    def __init__(self, run: Run, learner: Learner, progress: Progress | None) -> None:
        self.run, self.learner, self.progress = run, learner, progress
        self.rows: list[Row] = []
        self._stretch, self._seeded = -1, False
        self._rewards: list[float] = []
        self._before_s, self._began = 0.0, time.perf_counter()
        self._kept_at = self._began
        self._held_out = HeldOut(run.options)
        name = run.options.baseline
        self._compensator = self._held_out.evaluate(partial(make_controller, name))

    def resume(self, kept: dict[str, Any]) -> None:
        """Go on from what a checkpoint kept."""
        self.rows, self._stretch = kept["rows"], kept["stretch"]
        self._before_s = kept["seconds"]

    def before_rollout(self) -> dict[str, float]:
        """End the stretch where it is full; seed the next, or the first after an interruption."""
        if self.progress is not None:
            self.progress("training", self.learner.timesteps, self.run.timesteps)
        stretch = self.learner.timesteps // self.run.every
        found: dict[str, float] = {}
        if stretch > self._stretch:
            self._stretch = stretch
            found = self._keep()
            self._seed()
        elif not self._seeded:
            self._seed()
        if time.perf_counter() - self._kept_at > LATEST_S:
            self._keep_latest()
        self._seeded = True
        return found

    def rewarded(self, reward: float) -> None:
        """Take the mean reward of a step of all lanes."""
        self._rewards.append(reward)

    def end(self) -> dict[str, float]:
        """Evaluate for the last time, and keep what is done as finished."""
        found = self._keep(finished=True)
        if self.progress is not None:
            self.progress("training", self.run.timesteps, self.run.timesteps)
        return found

    def _seed(self) -> None:
        entropy = [self.run.options.seed, self._stretch]
        self.learner.begin(int(np.random.SeedSequence(entropy).generate_state(1)[0]))

    def _keep(self, finished: bool = False) -> dict[str, float]:
        """Evaluate, and write what a reader and a later run find: policy, curve, checkpoint."""
        policy = self._policy()
        recorder = self._held_out.recorder()
        found = self._held_out.evaluate(partial(LearnedController, policy), recorder)
        best = max((row["reward"] or 0.0 for row in self.rows), default=-np.inf)
        seconds = self._before_s + time.perf_counter() - self._began
        row = self._row(found, seconds)
        self.rows.append(row)
        self._rewards = []
        out = self.run.options.out
        if found.reward > best:
            seen = recorder.largest
            replace(policy, training=self._story(row), seen=seen).save(out / POLICY)
        write_atomic(out / CURVE, curve_text(self.rows))
        progress = {"rows": self.rows, "stretch": self._stretch, "seconds": seconds}
        save_checkpoint(out / CHECKPOINT, self.learner, progress, finished)
        self._kept_at = time.perf_counter()
        if finished:
            shutil.rmtree(out / LATEST, ignore_errors=True)
        return asdict(found)

    def _keep_latest(self) -> None:
        """Write the policy as it is now, not evaluated: what goes on still goes on from a whole stretch."""
        story = self._story({"timesteps": self.learner.timesteps})
        replace(self._policy(), training=story).save(self.run.options.out / LATEST)
        self._kept_at = time.perf_counter()

    def _policy(self) -> Policy:
        settings, layout, options = self.run.settings, self.learner.layout, self.run.options
        return Policy(
            layout=layout,
            history=settings.history,
            frequency_hz=settings.frequency_hz,
            error=settings.error,
            actor=nn.Sequential(*self.learner.actor()),
            baseline=options.baseline if layout.action == "correction" else None,
        )

    def _row(self, found: Evaluation, seconds: float) -> Row:
        row: Row = {
            "timesteps": self.learner.timesteps,
            "seconds": round(seconds, 3),
            "training_reward": float(np.mean(self._rewards)) if self._rewards else None,
            **asdict(found),
        }
        compensator = asdict(self._compensator)
        return row | {f"compensator_{name}": compensator[name] for name in _COMPARED}

    def _story(self, row: Row) -> dict[str, Any]:
        """Return the record of the training in a policy."""
        return {
            "algorithm": self.run.algorithm,
            "seed": self.run.options.seed,
            "plants": [model.name for model in self.run.options.models],
            **{name: row[name] for name in _TOLD if name in row},
        }


def learn(run: Run, learner: Learner, progress: Progress | None = None) -> Path:
    """Train, from the newest checkpoint on; the best policy so far lies in ``policy``."""
    course = Course(run, learner, progress)
    begin_folder(run.options.out, run.document())
    kept = load_checkpoint(run.options.out / CHECKPOINT, learner)
    if kept is not None:
        course.resume(kept)
    left = run.timesteps - learner.timesteps
    if left > 0:
        learner.learn(left, course)
    return run.options.out / POLICY


class Trainer(NamedTuple):
    """Options of an algorithm, and the function that trains with them."""

    Options: type[Any]
    train: Callable[..., Path]


@dataclass(frozen=True)
class NativeOptions(TrainingOptions):
    """Options of a training with the native PPO.

    Without `every` a stretch has a twentieth of all steps, and two episodes of every lane at least.
    """

    device: str | None = None
    # "cpu", which is the default: plants and networks run on a CPU.

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.device not in (None, "cpu"):
            raise InputError(
                f"native-ppo has no device {self.device!r}; leave --device out: it runs on a CPU, "
                "and --threads takes one for each core"
            )
        object.__setattr__(self, "device", None)


def trainer(algorithm: str) -> Trainer:
    """Return how an algorithm trains; only what it needs is imported."""
    if algorithm == "imitation":
        from baselines.learned.imitation import rounds

        return Trainer(rounds.Options, rounds.train)
    if algorithm == "native-ppo":
        from baselines.learned.native_learner import NativeLearner
        from baselines.learned.native_ppo import NativePPO

        def train_native(options: NativeOptions, progress: Progress | None = None) -> Path:
            run = Run.open(options, algorithm, NativePPO, samples=2 * options.episode)
            return learn(run, NativeLearner(run), progress)

        return Trainer(NativeOptions, train_native)
    from baselines.learned.stable_baselines import ALGORITHMS, StableBaselinesLearner

    def train(options: TrainingOptions, progress: Progress | None = None) -> Path:
        run = Run.open(options, algorithm, ALGORITHMS[algorithm])
        return learn(run, StableBaselinesLearner(run), progress)

    return Trainer(TrainingOptions, train)
