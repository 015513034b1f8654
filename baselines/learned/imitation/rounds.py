"""Training of a student in rounds: it drives, the true plants give its errors, it is fitted.

Every round draws plants of its own from the run's seed and the round's number. Network and optimiser
are all that is carried on, so a checkpoint between two rounds continues an interrupted run exactly.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch

from baselines.core_bank import AdaptiveCoreBank
from baselines.learned.checkpoint import CheckpointContent, load_checkpoint, save_checkpoint
from baselines.learned.imitation.fitting import Learner
from baselines.learned.imitation.policy import (
    UNIT_UM,
    WEIGHTED,
    StudentPolicy,
    checked_baseline,
    fresh_arrays,
    is_like,
)
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
from rdpi_gym.envs.tasks import StageTask, named_task
from rdpi_gym.envs.tasks.task import Split
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.parallel import Pool
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
    # Names, joined by commas. Their training draws are taught on, their validation draws choose the
    # policy.
    baseline: str = AdaptiveCoreBank.name
    # Controller that is corrected.
    timesteps: int = 30_000_000
    # Of all plants together; rounded to whole rounds.
    lanes: int = 96
    # Side by side in a round, each plant with every reference of its task.
    passes: int = 1
    # Through what was met in a round.
    every: int | None = None
    # Steps between evaluations, each with a checkpoint; None: a twentieth of all.
    hidden: int = 64
    # Width of the recurrent layer.
    learning_rate: float = 3e-3
    # At the begin; it falls to 3 % along a cosine.
    held_out: int = 8
    # Validation plants of each task.
    threads: int = 1
    # Of torch.
    jobs: int = 1
    # Processes that drive.

    def __post_init__(self) -> None:
        names = ("timesteps", "lanes", "passes", "every", "hidden", "held_out")
        for name in (*names, "threads", "jobs"):
            value = getattr(self, name)
            if value is not None and (type(value) is not int or value < 1):
                raise InputError(f"{name} is {value!r}; give a whole number of 1 or more")
        if type(self.seed) is not int or not 0 <= self.seed < 2**32:
            raise InputError(f"seed is {self.seed!r}; give a whole number of 0 to 2^32 - 1")
        if not (is_finite(self.learning_rate) and self.learning_rate > 0.0):
            raise InputError(f"learning_rate is {self.learning_rate!r}; give a number above 0")
        stages = self.stages
        for stage in stages:
            student_lanes(stage, "validation", range(1), self.seed)
            is_same = _effects(stage) == _effects(stages[0])
            if not (is_same and is_like(stage.layout(), stages[0].layout())):
                raise InputError(
                    f"{stage.name} and {stages[0].name} differ in sampling time, stroke, command range or "
                    "believed effects, which one student cannot have; teach one for each"
                )
        references = sum(len(stage.references) for stage in stages)
        if self.lanes % references:
            raise InputError(
                f"lanes is {self.lanes}, and every plant of {self.task} has {references} references; "
                f"give a multiple of {references}"
            )
        if checked_baseline(self.baseline) != AdaptiveCoreBank.name and (
            len(stages) > 1 or self.jobs > 1
        ):
            raise InputError(
                f"a student of several tasks, or driven by several processes, corrects {AdaptiveCoreBank.name}; "
                "give that baseline, or one task and one process"
            )

    @property
    def stages(self) -> tuple[StageTask, ...]:
        """The tasks."""
        return tuple(named_task(name.strip()) for name in self.task.split(","))

    def document(self) -> dict[str, Any]:
        """All that the result depends on, as JSON holds it."""
        stages = self.stages
        kept = asdict(self) | {"task": ",".join(stage.name for stage in stages)}
        for name in ("out", "jobs"):
            del kept[name]
        nominals = [model.to_dict() for stage in stages for model in stage.nominals]
        return {
            "format": FORMAT,
            "version": VERSION,
            "algorithm": "imitation",
            "options": kept | {"nominals": nominals},
            "versions": {name: version(name) for name in ("torch", "numpy")},
        }


def _effects(stage: StageTask) -> list[str]:
    return sorted(effect.name for effect in stage.belief().effects)


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
    weights: Sequence[Array]
    # Of each task's references: one over the RMS error that the base leaves (1 / units).
    held_out: Score  # its score on the validation draws


class Rounds:
    """A training, from the newest checkpoint on."""

    def __init__(self, options: Options, progress: Progress | None = None) -> None:
        self.options, self.progress, self._pool = options, progress, Pool(options.jobs)
        stages = options.stages
        self._plants = options.lanes // sum(len(stage.references) for stage in stages)
        self._steps = sum(
            self._plants * len(stage.references) * (stage.samples - 1) for stage in stages
        )
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
        self._report("teaching", self.done, self.count)
        while self.done < self.count:
            reward = self._round()
            self.done += 1
            if self.done % self._every == 0 or self.done == self.count:
                self._keep(reward)
            self._report("teaching", self.done, self.count)
        policy = StudentPolicy.load(out / POLICY)
        if not policy.seen:
            numbers = range(4 * self.options.held_out)  # how far its loops go
            met = self._met("training", numbers, policy)
            replace(policy, seen=met.largest).save(out / POLICY)
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
        numbers = range(self.done * self._plants, (self.done + 1) * self._plants)
        visited = self._met("training", numbers, self._policy())
        weights = np.concatenate([np.tile(each, self._plants) for each in self._base.weights])
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
        for _ in range(self.options.passes):
            self._learner.fit(visited, weights, rate * SLOWER**self.taken_back)
        return self._reward(visited.score)

    def _met(self, split: Split, numbers: Sequence[int], policy: StudentPolicy) -> Rollout:
        """Return what a policy meets on draws of every task."""
        stages, jobs = self.options.stages, self.options.jobs
        share = max(1, -(-len(numbers) * len(stages) // jobs)) if jobs > 1 else len(numbers)
        cases = [
            (stage, split, numbers[begin : begin + share], self.options.seed)
            for stage in stages
            for begin in range(0, len(numbers), share)
        ]
        return Rollout.joined(self._pool.map(partial(drive_draws, policy), cases))

    def _report(self, stage: str, done: int, total: int) -> None:
        if self.progress is not None:
            self.progress(stage, done, total)

    def _policy(self) -> StudentPolicy:
        return replace(self._base.policy, student=self._learner.student)

    def _reward(self, score: Score) -> float:
        """Mean error of a sample in amplitudes, negative, as the environment has it without a price of commands."""
        return -float(score.absolute_um.mean()) / self._base.policy.layout.scale_um

    def _measured_base(self) -> Base:
        options, first = self.options, self.options.stages[0]
        policy = StudentPolicy.untrained(
            first.belief(), first.layout(), options.hidden, options.baseline
        )
        self._report(f"measuring {options.baseline}", 0, 2)
        met = self._met("training", range(self._plants), policy)
        self._report(f"measuring {options.baseline}", 1, 2)
        held_out = self._met("validation", range(options.held_out), policy).score
        middle, spread = _scales(met)
        arrays = fresh_arrays(options.seed, middle, spread, options.hidden, WEIGHTED)
        ends = np.cumsum([self._plants * len(each.references) for each in options.stages])[:-1]
        rms = [
            np.sqrt(np.mean(each.reshape(self._plants, -1) ** 2, axis=0))
            for each in np.split(met.score.rmse_um, ends)
        ]
        return Base(policy, arrays, [UNIT_UM / each for each in rms], held_out)

    def _keep(self, reward: float | None) -> None:
        """Evaluate, and write what a reader and a later run find: policy, curve, checkpoint."""
        out, policy = self.options.out, self._policy()
        policy = replace(
            policy, student=policy.student.rounded_to_half()
        )  # as it is kept, so it is judged
        score = self._met("validation", range(self.options.held_out), policy).score
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
        names = ("seed", "timesteps", "lanes", "passes", "hidden")
        told = {name: getattr(self.options, name) for name in names}
        tasks = ",".join(stage.name for stage in self.options.stages)
        words = {"task": tasks, "baseline": self.options.baseline} | told
        return {
            "algorithm": "imitation",
            "command": " ".join(
                ["rdpi train imitation", *(f"--{name} {value}" for name, value in words.items())]
            ),
            "task": tasks,
            "draws": "training; chosen on validation draws",
            **told,
            "learning_rate": self.options.learning_rate,
            "at_timesteps": self.timesteps,
            "taken_back": self.taken_back,
            "validation_percent": row["rmse_percent"],
            "validation_compensator_percent": row["compensator_rmse_percent"],
        }


def drive_draws(
    policy: StudentPolicy, case: tuple[StageTask, Split, Sequence[int], int]
) -> Rollout:
    """Return what a policy meets on draws of one task."""
    return Rollout.joined([roll_out(lanes, policy) for lanes in student_lanes(*case)])


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
