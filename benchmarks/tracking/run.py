"""The benchmark: what was asked for, computed on all cores, row by row into a store."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

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
    out: Path,
    jobs: int = -1,
    progress: Progress | None = None,
    ray_address: str | None = None,
) -> Outcome:
    """Compute what is missing or failed and return every row that was asked for."""
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; give a folder for --out")
    store = open_rows(out)
    remark = store.remark()
    notes = [] if remark is None else [remark]
    tasks = _tasks(selection)
    stamps = {k: dict(task.stamps) for task in tasks for k in row_keys(task)}
    code = code_fingerprint()
    aside = store.set_aside(
        lambda row: (
            row.get("code") != code
            or any(row.get(name) != value for name, value in stamps.get(key(row), {}).items())
        )
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


def _tasks(selection: Selection) -> list[Task]:
    tasks = []
    for controller, one, ts in _settings(selection):
        factory = selection.factories.get(controller)
        stamps = {
            "code": code_fingerprint(),
            "task": task_fingerprint(controller, one.plant, one.believed),
        }
        if factory is not None:  # no one can say whether it is still the same: always run anew
            stamps["task"] = os.urandom(8).hex()
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
