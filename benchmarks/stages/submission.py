"""A submission: a folder with a controller, its hash, its rows and the command that made them."""

from __future__ import annotations

import hashlib
import math
import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from baselines import policy_of
from benchmarks.rows import TASKS
from benchmarks.stages.isolation import own_code
from benchmarks.stages.ranking import TaskScores
from benchmarks.stages.run import SUITE_VERSION, TestSeed, run_tasks
from benchmarks.tracking.controllers import code_fingerprint, is_learned
from rdpi_gym.envs.tasks import named_task
from rdpi_gym.support.checks import is_whole
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import (
    check_plain,
    read_bytes,
    read_json,
    replaced_folder,
    write_atomic,
    write_json,
)
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.store import Row
from rdpi_gym.support.words import quoted, short

FORMAT, VERSION = "rdpi-submission", 1
FILE = "submission.json"
# Of a row: what says how well a controller did, and what depends on the machine.
_FIGURES = ("rmse_percent", "worst_percent", "command_variation_V_s")
_ROUNDING = 1e-6
_LARGEST_CODE = 2**28  # bytes of a file, as those of a policy's weights


@dataclass(frozen=True)
class Submission:
    """Content of a submission's folder."""

    folder: Path
    controller: str  # as it was named where it was submitted
    code: str  # name of the copy in the folder; empty for a controller of this package
    hash: str  # of that copy, or of this package's code
    # what it was scored on, with the public seed
    tasks: tuple[str, ...]
    plants: int
    command: str  # that made it

    @property
    def runs_as(self) -> str:
        """Name under which :func:`baselines.make_controller` finds what the folder holds."""
        if not self.code:
            return self.controller
        if is_learned(self.controller):
            return f"{self.controller.partition(':')[0]}:{self.folder / self.code}"
        return f"{Path(self.code).stem}:{self.controller.partition(':')[2]}"

    @property
    def path(self) -> Path | None:
        """Place of its own code; None for a controller of this package."""
        return self.folder / self.code if self.code else None


def submit(
    controller: str,
    tasks: list[str],
    plants: int,
    folder: Path,
    jobs: int = 1,
    progress: Progress | None = None,
) -> tuple[Submission, TaskScores]:
    """Score a controller on public draws and put all that a leaderboard needs into a folder."""
    names = tuple(dict.fromkeys(named_task(task).name for task in tasks))
    _check_links(controller)
    outcome = run_tasks(
        [controller], names, plants, folder, jobs=jobs, progress=progress, bound=False
    )
    code = _copied(controller, folder)
    words = ["rdpi", "submit", controller, "--task", ",".join(names), "--draws", str(plants)]
    command = shlex.join([*words, "--out", str(folder)])
    entry = Submission(
        folder, controller, code, _hash(folder, code, controller), names, plants, command
    )
    write_json(
        folder / FILE,
        {
            "format": FORMAT,
            "version": VERSION,
            "suite": SUITE_VERSION,
            "controller": controller,
            "code": code,
            "hash": entry.hash,
            "tasks": list(names),
            "plants": plants,
            "draws": TestSeed().label,
            "command": command,
        },
    )
    return entry, TaskScores(tuple(outcome.rows), TestSeed().label, outcome.computed, outcome.notes)


def read_submission(folder: Path) -> Submission:
    """Read a submission, and see that it is whole."""
    document = read_json(folder / FILE, FORMAT, VERSION)
    where = str(folder / FILE)
    suite = document.get("suite")
    if suite != SUITE_VERSION:
        raise InputError(
            f"{where} is of task suite {quoted(suite)}, and this release scores suite {SUITE_VERSION}; submit it again"
        )
    text = {name: document.get(name) for name in ("controller", "code", "hash", "command")}
    tasks, plants = document.get("tasks"), document.get("plants", 0)
    if not all(isinstance(value, str) for value in text.values()) or not (
        isinstance(tasks, list) and tasks and is_whole(plants, 1)
    ):
        raise InputError(f"{where} is not what rdpi submit writes; submit it again")
    entry = Submission(
        folder,
        **{name: str(value) for name, value in text.items()},
        tasks=tuple(named_task(str(task)).name for task in tasks),
        plants=int(plants),
    )
    if Path(entry.code).name != entry.code or (entry.code and not (folder / entry.code).exists()):
        raise InputError(f"{where} names the code {quoted(entry.code)}, which is not in its folder")
    if entry.code and _hash(folder, entry.code, entry.controller) != entry.hash:
        raise InputError(
            f"{folder / entry.code} is not what was submitted: its hash differs; submit it again"
        )
    rows, wanted = TASKS.open(folder).rows, len(entry.tasks) * entry.plants
    # of any number that the file says, no more are looked for than rows are there
    label = TestSeed().label
    missing = next(
        (
            (task, plant)
            for task in entry.tasks
            for plant in range(entry.plants)
            if (entry.controller, task, label, plant) not in rows
        ),
        None,
    )
    if missing is not None:
        there = set(entry.tasks)
        found = sum(
            (name, draws) == (entry.controller, label) and task in there and plant < entry.plants
            for name, task, draws, plant in rows
        )
        raise InputError(
            f"{folder} lacks {wanted - found} of {wanted} rows, the first that of task {missing[0]}, plant {missing[1]}; run its command again: {short(entry.command)}"
        )
    return entry


def score_submission(
    folder: Path,
    seed: TestSeed,
    out: Path,
    jobs: int = 1,
    progress: Progress | None = None,
    bound: bool = True,
    plants: int | None = None,
) -> TaskScores:
    """Score a submission on draws of a seed, by default all that it was scored on, beside the bound.

    The code in the folder is run, in a process of its own.
    """
    entry = read_submission(folder)
    count = entry.plants if plants is None else min(plants, entry.plants)
    outcome = run_tasks(
        [],
        entry.tasks,
        count,
        out,
        seed=seed,
        jobs=jobs,
        progress=progress,
        bound=bound,
        submitted={entry.runs_as: entry.path},
    )
    notes = [*outcome.notes]
    if seed.is_public:
        stated = TASKS.open(folder).rows
        differ = sum(
            not _is_same(row, stated[entry.controller, row["task"], row["draws"], row["plant"]])
            for row in outcome.rows
            if row["controller"] == entry.runs_as
        )
        whole = len(entry.tasks) * count
        notes.append(
            f"The submitted rows are reproduced, all {whole}."
            if not differ
            else f"{differ} of {whole} submitted rows are not reproduced here: other code, or another machine."
        )
    renamed = [
        row | {"controller": entry.controller} if row["controller"] == entry.runs_as else row
        for row in outcome.rows
    ]
    return TaskScores(tuple(renamed), seed.label, outcome.computed, tuple(notes))


def _is_same(row: Row, stated: Row) -> bool:
    """Whether two rows say the same, rounding of another machine aside."""
    figures = [
        [one.get(name, math.nan) for name in _FIGURES] + list(one.get("each_percent", ()))
        for one in (row, stated)
    ]
    return row["failure"] == stated["failure"] and (
        len(figures[0]) == len(figures[1])
        and np.allclose(figures[0], figures[1], rtol=_ROUNDING, atol=0.0, equal_nan=True)
    )


def _check_links(controller: str) -> None:
    """Refuse a policy's folder that holds a link: what it leads to would be handed in."""
    path = Path(policy_of(controller) or "")
    if is_learned(controller) and path.is_dir():
        check_plain([path, *(each for each in path.rglob("*") if each.is_dir())])


def _copied(controller: str, folder: Path) -> str:
    """Copy a controller's own code into a folder and return its name there; empty: this package's."""
    if is_learned(controller):
        path = Path(policy_of(controller) or "")
        if not path.is_dir():
            return ""  # a shipped one
        with replaced_folder(folder / "policy") as fresh:
            shutil.copytree(path, fresh, dirs_exist_ok=True)
        return "policy"
    if ":" not in controller:
        return ""
    origin = own_code(controller)
    if origin is None:
        raise InputError(
            f"{controller!r} is not of a single file; write a submission as one module, for example my_controller.py"
        )
    content = origin.read_bytes()
    name = f"submitted_{hashlib.sha256(content).hexdigest()[:12]}.py"
    write_atomic(folder / name, content)
    return name


def _hash(folder: Path, code: str, controller: str) -> str:
    if not code:
        return code_fingerprint(controller)
    path = folder / code
    files = sorted(each for each in path.rglob("*") if each.is_file()) if path.is_dir() else [path]
    digest = hashlib.sha256()
    for each in files:
        content = read_bytes(each, _LARGEST_CODE)
        digest.update(each.relative_to(folder).as_posix().encode() + b"\0" + content)
    return digest.hexdigest()
