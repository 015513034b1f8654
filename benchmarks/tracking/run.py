"""The benchmark: what was asked for, computed on all cores, row by row into a store."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from baselines import FULL_PREVIEW
from benchmarks.tracking.fingerprint import code_fingerprint, task_fingerprint
from benchmarks.tracking.rows import Key, key, open_rows
from benchmarks.tracking.scoring import ERROR, words
from benchmarks.tracking.selection import Selection
from benchmarks.tracking.stages import Stage
from benchmarks.tracking.tasks import Lane, Task, make_tasks, row_keys, run_task
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.parallel import run_cases
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.store import Row


@dataclass(frozen=True)
class Outcome:
    """What a run leaves.

    Parameters
    ----------
    rows
        The rows that were asked for, and the bound's beside them.
    notes
        What a reader of the results should know, one sentence each.
    computed
        Number of rows that were not finished before.
    """

    rows: list[Row]
    notes: tuple[str, ...]
    computed: int


def benchmark(
    selection: Selection,
    out: Path | None,
    jobs: int = -1,
    progress: Progress | None = None,
    ray_address: str | None = None,
) -> Outcome:
    """Compute what is missing or failed and return every row that was asked for.

    Without a folder no row is kept, and none carries a fingerprint.
    """
    if out is None:
        with TemporaryDirectory() as scratch:
            tasks = _tasks(selection, stamped=False)
            return _run(selection, tasks, Path(scratch), jobs, progress, ray_address)
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; give a folder for --out")
    return _run(selection, _tasks(selection, stamped=True), out, jobs, progress, ray_address)


def _run(
    selection: Selection,
    tasks: Sequence[Task],
    out: Path,
    jobs: int,
    progress: Progress | None,
    ray_address: str | None,
) -> Outcome:
    """Run what a folder does not have of tasks."""
    store = open_rows(out)
    remark = store.remark()
    notes = [] if remark is None else [remark]
    stamps = {k: dict(task.stamps) for task in tasks for k in row_keys(task)}
    aside = store.set_aside(
        lambda row: any(row.get(name) != value for name, value in stamps.get(key(row), {}).items())
    )
    if aside is not None:
        notes.append(f"Rows of changed code, plants or controllers were set aside in {aside.name}.")
    # what failed for want of a file or a package may succeed now
    finished = {k for k, row in store.rows.items() if words([row["status"]]) != {ERROR}}
    missing = [task for task in tasks if not finished.issuperset(row_keys(task))]
    missing.sort(key=lambda task: -task.samples)
    computed = 0
    for done, rows in enumerate(run_cases(run_task, missing, jobs, ray_address), start=1):
        fresh = [row for row in rows if key(row) not in finished]
        store.append(fresh)
        computed += len(fresh)
        if progress is not None:
            progress("scoring", done, len(missing))
    return Outcome([store.rows[k] for k in _in_order(selection)], tuple(notes), computed)


def _tasks(selection: Selection, stamped: bool) -> list[Task]:
    """Return all tasks, stamped with what tells whether their rows are still valid, or with nothing."""
    tasks = []
    for controller, one, ts in _settings(selection):
        factory = selection.factories.get(controller)
        stamps = {}
        if stamped:
            # what makes a controller may be another each time: always run anew
            task = os.urandom(8).hex() if factory is not None else None
            stamps = {
                "code": code_fingerprint(controller),
                "task": task or task_fingerprint(controller, one.plant, one.believed),
            }
        lanes = [
            Lane(case, seed, ts == one.shown_ts_s and seed == selection.seeds[0])
            for case in one.cases(selection.references, ts)
            for seed in selection.seeds
        ]
        tasks += make_tasks(controller, one, ts, lanes, stamps, factory)
    return tasks


def _in_order(selection: Selection) -> Iterator[Key]:
    for controller, one, ts in _settings(selection):
        for case in one.cases(selection.references, ts):
            for seed in selection.seeds:
                name = one.plant.name
                yield controller, name, case.reference, case.frequency_hz, ts, seed


def _settings(selection: Selection) -> Iterator[tuple[str, Stage, float]]:
    # the bound is always run: gaps and efforts are measured against it
    for controller in dict.fromkeys((*selection.controllers, FULL_PREVIEW)):
        for one in selection.stages:
            for ts in one.every_ts_s:
                if selection.runs_at(controller, one, ts):
                    yield controller, one, ts
