"""`score_tasks`: controllers on the registered tasks; `submit` and `score_submission` of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from baselines import Controller
from benchmarks.stages import submission
from benchmarks.stages.ranking import TaskScores
from benchmarks.stages.row_table import checked_against, put_among
from benchmarks.stages.run import field, read_seed, run_tasks
from benchmarks.tracking.controllers import Made, named, shipped_policies
from rdpi_gym.envs.tasks import TASKS
from rdpi_gym.support.checks import checked
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress

__all__ = ["TaskScores", "score_submission", "score_tasks", "submit"]

PLANTS = 20
"""Plants of a task where no number is given."""


@checked
def score_tasks(
    controllers: Sequence[str | Controller | Callable[..., Any]] | None = None,
    tasks: Sequence[str] = ("Stage",),
    plants: int = PLANTS,
    *,
    own_controllers: Sequence[str | Controller | Callable[..., Any]] = (),
    seed_file: PathLike[str] | str | None = None,
    out: PathLike[str] | str | None = None,
    jobs: int = -1,
    ray: str | None = None,
    progress: Progress | None = None,
    bound: bool = True,
    against: PathLike[str] | str | None = None,
    among: PathLike[str] | str | None = None,
) -> TaskScores:
    """Score controllers on registered tasks: failures first, then the worst tenth of the plants.

    Parameters
    ----------
    controllers
        Names, as :func:`make_controller` takes them, and callables ``(belief, layout)`` that make
        one; by default all causal ones of this package and the trained policies that ship.
    tasks
        Short names or ids of tasks; ``all``: every one.
    plants
        Number of test plants of each.
    own_controllers
        Further ones, beside those above or all.
    seed_file
        A file with the seed of the test draws, one whole number; by default the public seed.
    out
        Folder that keeps finished rows, so that an interrupted run goes on; by default none.
    jobs
        Worker processes; -1: one for each core.
    ray
        Address of a Ray cluster that scores in place of processes here.
    progress
        Called as ``progress(stage, done, total)``.
    bound
        Whether entries that know more than a controller may are scored beside the ranking.
    against
        ``task-rows.csv.gz`` of a table; the notes say how many rows are as it states them.
    among
        Folder of a table: these controllers are ranked among its others, whose rows stay as they are.

    Returns
    -------
    TaskScores
        It prints a ranking for each task.

    Raises
    ------
    InputError
        An unknown name, a seed file that holds none, an argument of another type, a callable with a
        private seed: it would run where that seed is.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> scores = rg.score_tasks(["none", "classical-static"], ["Bare"], plants=1, jobs=1)
    >>> scores.ranking("Bare")["controller"].tolist()
    ['true-plant-horizon', 'classical-static', 'none']
    """
    usual = [*field(), *shipped_policies()[0]] if controllers is None else list(controllers)
    asked = [*usual, *own_controllers]
    factories = named([each for each in asked if not isinstance(each, str)])
    made = next((name for name, each in factories.items() if isinstance(each, Made)), None)
    if made is not None:
        raise InputError(
            f"{made} was made with a belief of its own; give a callable (belief, layout) that makes it"
        )
    seed = read_seed(None if seed_file is None else Path(seed_file))
    with TemporaryDirectory() as scratch:
        outcome = run_tasks(
            [each for each in asked if isinstance(each, str)],
            _every(tasks),
            plants,
            Path(scratch if out is None else out),
            seed=seed,
            jobs=jobs,
            progress=progress,
            ray_address=ray,
            factories=factories,
            stamped=out is not None,
            bound=bound,
        )
    notes = list(outcome.notes)
    if against is not None:
        notes.append(checked_against(outcome.rows, Path(against)))
    rows = outcome.rows
    if among is not None:
        fresh = ", ".join(dict.fromkeys(f"`{row['controller']}`" for row in rows))
        notes.append(
            f"Scored now: {fresh}; rows of others are as the table that these stand among has them."
        )
        rows = put_among(rows, Path(among))
    return TaskScores(tuple(rows), seed.label, outcome.computed, tuple(notes))


@checked
def submit(
    controller: str,
    out: PathLike[str] | str,
    tasks: Sequence[str] = ("Stage",),
    plants: int = PLANTS,
    *,
    jobs: int = -1,
    progress: Progress | None = None,
) -> TaskScores:
    """Make a submission: a folder with a controller, its hash, its rows on public draws.

    Parameters
    ----------
    controller
        A name of this package, ``module:attribute`` of a single file, or ``learned:`` and the folder
        of a trained policy.
    out
        The folder.
    tasks, plants, jobs, progress
        As :func:`score_tasks`.

    Returns
    -------
    TaskScores

    Raises
    ------
    InputError
        An unknown name, or a controller whose code is no single file.
    """
    _, scores = submission.submit(controller, _every(tasks), plants, Path(out), jobs, progress)
    return scores


@checked
def score_submission(
    folder: PathLike[str] | str,
    *,
    seed_file: PathLike[str] | str | None = None,
    out: PathLike[str] | str | None = None,
    jobs: int = -1,
    progress: Progress | None = None,
    plants: int | None = None,
    bound: bool = True,
) -> TaskScores:
    """Score a submission on draws that it need not have seen; its code runs in a process of its own.

    Parameters
    ----------
    folder
        As :func:`submit` leaves it.
    seed_file, out, jobs, progress, bound
        As :func:`score_tasks`.
    plants
        Number of plants of each task; by default, and at most, as many as were submitted.

    Returns
    -------
    TaskScores

    Raises
    ------
    InputError
        The folder is no submission, of another suite, or lacks rows.
    """
    with TemporaryDirectory() as scratch:
        return submission.score_submission(
            Path(folder),
            read_seed(None if seed_file is None else Path(seed_file)),
            Path(scratch if out is None else out),
            jobs=jobs,
            progress=progress,
            bound=bound,
            plants=plants,
        )


def _every(tasks: Sequence[str]) -> list[str]:
    return list(TASKS) if list(tasks) == ["all"] else list(tasks)
