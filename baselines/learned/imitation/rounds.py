"""Training of a student in rounds: it drives, the true plants give its errors, it is fitted.

Every round draws plants of its own from the run's seed and the round's number. Network and optimiser
are all that is carried on, so a checkpoint between two rounds continues an interrupted run exactly.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch

from baselines.damping import AdaptiveDualLoop
from baselines.learned.checkpoint import CheckpointContent, load_checkpoint, save_checkpoint
from baselines.learned.imitation.fitting import Learner
from baselines.learned.imitation.policy import UNIT_UM, WEIGHTED, StudentPolicy, fresh_arrays
from baselines.learned.imitation.teacher import Rollout, Score, roll_out, student_lanes
from baselines.learned.options import (
    CHECKPOINT,
    CURVE,
    FORMAT,
    POLICY,
    VERSION,
    Row,
    begin_folder,
    check_folder,
    curve_text,
)
from rdpi_gym.envs.tasks import Lanes, StageTask, named_task
from rdpi_gym.envs.tasks.task import Split
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.progress import Progress


@dataclass(frozen=True)
class Options:
    """Options of a training; the comment under each says what it does.

    Raises
    ------
    InputError
        A value that nothing can be taught with.
    """

    out: Path = Path("results/train-imitation")
    # Folder of the run. The same options with the same folder continue an interrupted run.
    seed: int = 0
    # Of weights, plants, references and noise: the same seed, the same run.
    task: str = "Stage"
    # Its training draws are taught on, its validation draws choose the policy.
    timesteps: int = 30_000_000
    # Of all plants together; rounded to whole rounds.
    lanes: int = 96
    # Side by side in a round, each plant with every reference of the task.
    every: int | None = None
    # Steps between evaluations, each with a checkpoint; None: a twentieth of all.
    hidden: int = 64
    # Width of the recurrent layer.
    learning_rate: float = 3e-3
    # At the begin; it falls to 3 % along a cosine.
    held_out: int = 8
    # Validation plants.
    threads: int = 1
    # Of torch.

    def __post_init__(self) -> None:
        for name in ("timesteps", "lanes", "every", "hidden", "held_out", "threads"):
            value = getattr(self, name)
            if value is not None and (type(value) is not int or value < 1):
                raise InputError(f"{name} is {value!r}; give a whole number of 1 or more")
        if type(self.seed) is not int or not 0 <= self.seed < 2**32:
            raise InputError(f"seed is {self.seed!r}; give a whole number of 0 to 2^32 - 1")
        if not (is_finite(self.learning_rate) and self.learning_rate > 0.0):
            raise InputError(f"learning_rate is {self.learning_rate!r}; give a number above 0")
        references = len(self.stage.references)
        if self.lanes % references:
            raise InputError(
                f"lanes is {self.lanes}, and every plant of {self.task} has {references} references; "
                f"give a multiple of {references}"
            )
        student_lanes(self.stage, "validation", range(1), self.seed)

    @property
    def stage(self) -> StageTask:
        """The task."""
        return named_task(self.task)

    @property
    def baseline(self) -> str:
        """Name of the controller that is corrected, and compared with."""
        return AdaptiveDualLoop.name

    def document(self) -> dict[str, Any]:
        """All that the result depends on, as JSON holds it."""
        kept = asdict(self) | {"task": self.stage.name}
        del kept["out"]
        nominals = [model.to_dict() for model in self.stage.nominals]
        return {
            "format": FORMAT,
            "version": VERSION,
            "algorithm": "imitation",
            "options": kept | {"nominals": nominals},
            "versions": {name: version(name) for name in ("torch", "numpy")},
        }


LAST_SHARE = 0.03
"""Learning rate at the end over that at the begin."""
WORSE, NEAR = 1.4, 1.15
"""Times the least error of a round: from the first on what was fitted since is taken back, up to the
second a network is kept to be taken up again."""
SLOWER = 0.7
"""Factor on the learning rate whenever a network was taken back."""
SETTLED = 100
"""Samples from which on what is seen sets the network's scales: before, nothing is estimated."""


@dataclass(frozen=True)
class Base:
    """Measurements of the controller that is corrected, made once."""

    policy: StudentPolicy  # a student that adds nothing
    arrays: Mapping[str, Any]  # the network to begin with, its scales those of what is seen
    weights: Array  # of each reference: one over the RMS error that the base leaves (1 / units)
    held_out: Score  # its score on the validation draws


class Rounds:
    """A training, from the newest checkpoint on."""

    def __init__(self, options: Options, progress: Progress | None = None) -> None:
        self.options, self.task, self.progress = options, options.stage, progress
        self._plants = options.lanes // len(self.task.references)
        self._steps = options.lanes * (self.task.samples - 1)
        self.count = max(1, round(options.timesteps / self._steps))
        self._every = max(1, round((options.every or options.timesteps / 20) / self._steps))
        self._base = self._measured_base()
        self._learner = Learner(self._base.arrays, WEIGHTED)
        self.rows: list[Row] = []
        self._good, self._least = self._held(), math.inf
        self.taken_back, self._is_back = 0, False
        self.done: int = 0
        self._before_s, self._began = 0.0, time.perf_counter()

    def run(self) -> Path:
        """Teach what is left to teach; return the folder of the best policy."""
        out = self.options.out
        kept = load_checkpoint(out / CHECKPOINT, self)
        if kept is None:
            self._keep(None)
        else:
            self.rows, self._before_s = kept["rows"], kept["seconds"]
        while self.done < self.count:
            reward = self._round()
            self.done += 1
            if self.done % self._every == 0 or self.done == self.count:
                self._keep(reward)
            if self.progress is not None:
                self.progress("teaching", self.done, self.count)
        policy = StudentPolicy.load(out / POLICY)
        if not policy.seen:
            replace(policy, seen=measured_envelope(policy, self.options)).save(out / POLICY)
        return out / POLICY

    @property
    def kind(self) -> str:
        """Name in a checkpoint."""
        return "Imitation"

    @property
    def timesteps(self) -> int:
        """Steps of all lanes together so far."""
        return int(self.done * self._steps)

    @property
    def updates(self) -> int:
        """Rounds so far."""
        return self.done

    def tensors(self) -> Mapping[str, Any]:
        """See :meth:`baselines.learned.checkpoint.Checkpointable.tensors`."""
        tally = torch.tensor([self._least, self.taken_back, self._is_back], dtype=torch.float64)
        return {"now": self._held(), "good": self._good, "tally": {"tally": tally}}

    def arrays(self) -> Mapping[str, Any]:
        """Nothing: what was visited is not kept."""
        return {}

    def restore(self, kept: CheckpointContent) -> None:
        """See :meth:`baselines.learned.checkpoint.Checkpointable.restore`."""
        self._take_up(kept.tensors["now"])
        self._good = kept.tensors["good"]
        least, taken_back, is_back = kept.tensors["tally"]["tally"].tolist()
        self._least, self.taken_back, self._is_back = least, int(taken_back), bool(is_back)
        self.done = kept.updates

    def _held(self) -> dict[str, Any]:
        """Return copies of the network and of what its optimiser remembers."""
        learner = self._learner
        arrays = {name: each.detach().clone() for name, each in learner.tensors.items()}
        moments = {name: each.clone() for name, each in learner.moments().items()}
        return {"arrays": arrays, "moments": moments}

    def _take_up(self, held: Mapping[str, Any]) -> None:
        arrays = {name: each.numpy() for name, each in held["arrays"].items()}
        self._learner = Learner(arrays, WEIGHTED)
        self._learner.remember(held["moments"])

    def _round(self) -> float:
        """Let the student drive on fresh plants, and fit it; return its reward as it drove.

        Where it drove much worse than ever before, the loop that the last fits left is about to
        become unstable: a network of before is taken up again, and fitted more slowly from then on.
        """
        visited = roll_out(self._lanes("training", self.done), self._policy())
        weights = np.tile(self._base.weights, self._plants)
        error = float(np.mean(visited.score.rmse_um * weights)) / UNIT_UM
        if error > WORSE * self._least and not self._is_back:
            self._take_up(self._good)
            self._is_back, self.taken_back = True, self.taken_back + 1
            return self._reward(visited.score)
        # One that was taken up again counts as it drove, or a lucky draw would stop the training.
        self._least = error if self._is_back else min(error, self._least)
        self._is_back = False
        if error <= NEAR * self._least:
            self._good = self._held()
        along = 0.5 * (1.0 + math.cos(math.pi * self.done / self.count))
        rate = self.options.learning_rate * (LAST_SHARE + (1.0 - LAST_SHARE) * along)
        self._learner.fit(visited, weights, rate * SLOWER**self.taken_back)
        return self._reward(visited.score)

    def _lanes(self, split: Split, number: int) -> Lanes:
        count = self._plants if split == "training" else self.options.held_out
        numbers = range(number * count, (number + 1) * count)
        return student_lanes(self.task, split, numbers, self.options.seed)

    def _policy(self) -> StudentPolicy:
        return replace(self._base.policy, student=self._learner.student)

    def _reward(self, score: Score) -> float:
        """Mean error of a sample in amplitudes, negative, as the environment has it without a price of commands."""
        return -float(score.absolute_um.mean()) / self._base.policy.layout.scale_um

    def _measured_base(self) -> Base:
        lanes = self._lanes("training", 0)
        policy = StudentPolicy.untrained(lanes.belief, lanes.layout(), self.options.hidden)
        met = roll_out(lanes, policy)
        held_out = roll_out(self._lanes("validation", 0), policy).score
        middle, spread = _scales(met)
        arrays = fresh_arrays(self.options.seed, middle, spread, self.options.hidden, WEIGHTED)
        rms = np.sqrt(np.mean(met.score.rmse_um.reshape(self._plants, -1) ** 2, axis=0))
        return Base(policy, arrays, UNIT_UM / rms, held_out)

    def _keep(self, reward: float | None) -> None:
        """Evaluate, and write what a reader and a later run find: policy, curve, checkpoint."""
        out, policy = self.options.out, self._policy()
        policy = replace(
            policy, student=policy.student.rounded_to_half()
        )  # as it is kept, so it is judged
        score = roll_out(self._lanes("validation", 0), policy).score
        best = min((row["rmse_percent"] or math.inf for row in self.rows), default=math.inf)
        seconds = self._before_s + time.perf_counter() - self._began
        row: Row = {
            "timesteps": self.timesteps,
            "seconds": round(seconds, 3),
            "training_reward": reward,
            "reward": self._reward(score),
            **_figures(score, ""),
            **_figures(self._base.held_out, "compensator_"),
        }
        self.rows.append(row)
        if float(score.percent.mean()) < best:
            replace(policy, training=self._story(row)).save(out / POLICY)
        write_atomic(out / CURVE, curve_text(self.rows))
        progress = {"rows": self.rows, "seconds": seconds}
        save_checkpoint(out / CHECKPOINT, self, progress, finished=self.done == self.count)

    def _story(self, row: Row) -> dict[str, Any]:
        """Return the record of the training in a policy."""
        names = ("seed", "timesteps", "lanes", "hidden", "learning_rate")
        return {
            "algorithm": "imitation",
            "command": (
                f"rdpi train imitation --task {self.task.name} --seed {self.options.seed} "
                f"--timesteps {self.options.timesteps} --lanes {self.options.lanes}"
            ),
            "task": self.task.name,
            "draws": "training; chosen on validation draws",
            **{name: getattr(self.options, name) for name in names},
            "at_timesteps": self.timesteps,
            "taken_back": self.taken_back,
            "validation_percent": row["rmse_percent"],
            "validation_compensator_percent": row["compensator_rmse_percent"],
        }


def measured_envelope(policy: StudentPolicy, options: Options) -> Mapping[str, float]:
    """Return how far the loops of a student go on training draws, four times as many as are held out."""
    numbers = range(4 * options.held_out)
    return roll_out(student_lanes(options.stage, "training", numbers, options.seed), policy).largest


def _figures(score: Score, prefix: str) -> Row:
    return {
        f"{prefix}rmse_um": float(score.rmse_um.mean()),
        f"{prefix}rmse_percent": float(score.percent.mean()),
        f"{prefix}command_variation_V_s": float(score.command_variation_V_s.mean()),
    }


def _scales(met: Rollout) -> tuple[Any, Any]:
    """Return middle and spread of what is seen; what is weighted keeps its zero."""
    seen = met.seen[SETTLED:].astype(np.float64)
    middle = seen.mean(axis=(0, 2))
    middle[:WEIGHTED] = 0.0
    spread = seen.std(axis=(0, 2)) + 1e-6
    return middle.astype(np.float32), spread.astype(np.float32)


def train(options: Options, progress: Progress | None = None) -> Path:
    """Teach a student, or continue an interrupted training: ``rdpi train imitation``."""
    check_folder(options.out, options.document())
    torch.set_num_threads(options.threads)
    begin_folder(options.out, options.document())
    return Rounds(options, progress).run()
