"""Run of the tracking benchmark on all cores, row by row into a store."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

import numpy as np

from baselines import (
    FULL_PREVIEW,
    Controller,
    ControllerFactory,
    FullPreviewInversion,
    make_controller,
)
from benchmarks.rows import TRACKING, Outcome, TrackingKey, complete
from benchmarks.tracking.case import Case
from benchmarks.tracking.controllers import Made, code_fingerprint, task_fingerprint
from benchmarks.tracking.episode import (
    ERROR,
    Recording,
    one_line,
    score_lane,
    timed_recording,
    words,
)
from benchmarks.tracking.selection import Selection
from benchmarks.tracking.stages import Stage, largest_rate_V_s, truth
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.store import Row

TRACE_SAMPLES = 200
TRUE_PLANT = "true plant"
"""Entry of tables in place of a belief for the bound."""
# Lanes whose lengths differ by more are run apart: a short one would idle to the end of a long one.
_LENGTH_RATIO = 4.0
Told: TypeAlias = Callable[[str, Sequence[Row]], None]
"""Called with a controller whose last row is computed, and its rows."""


@dataclass(frozen=True)
class Lane:
    """One row to be: a case and a seed."""

    case: Case  # the reference
    seed: int  # draws the truth, the sensor's noise and a random reference
    keep_trace: bool = False  # whether the row carries what its page draws


@dataclass(frozen=True)
class Task:
    """Work of one process at a time; its rows are written when it is done."""

    controller: str  # a name of ``baselines.CONTROLLERS``, or ``module:attribute``
    stage: Stage  # the plant
    ts_s: float  # sampling time (s)
    lanes: tuple[Lane, ...]  # the rows to be computed
    stamps: Mapping[str, str]  # fingerprints that go into every row
    # what makes the controller, where its name does not say
    factory: ControllerFactory | None = None

    @property
    def samples(self) -> int:
        """Samples of the longest lane."""
        return max(lane.case.window(self.ts_s)[1] for lane in self.lanes)


def row_keys(task: Task) -> list[TrackingKey]:
    """Return the keys of a task's rows, in the order of its lanes."""
    return [TRACKING.key(_row(task, lane)) for lane in task.lanes]


def run_task(task: Task) -> list[Row]:
    """Score every lane of a task; a controller that fails leaves rows that say so."""
    try:
        return _run(task)
    except Exception as error:  # a user's controller may raise anything; the others go on
        reason = one_line(f"{type(error).__name__}: {error}")
        return [_row(task, lane) | {"status": f"{ERROR}: {reason}"} for lane in task.lanes]


def _run(task: Task) -> list[Row]:
    plant, lanes = task.stage.plant, task.lanes
    truths = [truth(plant, lane.seed) for lane in lanes]
    usual = ObservationLayout.for_plant(plant, task.ts_s)
    layout = task.stage.layout(task.ts_s, _controller(task, usual, truths))
    layout = task.factory.layout if isinstance(task.factory, Made) else layout
    references = task.stage.references([(x.case, x.seed) for x in lanes], task.ts_s)
    rngs = [
        np.random.default_rng([lane.seed, zlib.crc32(lane.case.name.encode())]) for lane in lanes
    ]
    recording, warning, timed = timed_recording(
        partial(_controller, task, layout), truths, layout, references, rngs
    )
    rows = []
    for b, lane in enumerate(lanes):
        row = _row(task, lane) | {"microseconds_per_sample": timed}
        rows.append(row | _scores(task, lane, references, recording, b, warning))
    return rows


def _controller(task: Task, layout: ObservationLayout, truths: Sequence[PlantModel]) -> Controller:
    """Make what is scored: the bound alone is given the true plants, all others their belief."""
    if task.controller == FULL_PREVIEW:
        return FullPreviewInversion(truths, layout)
    return make_controller(task.factory or task.controller, task.stage.belief, layout)


def _scores(
    task: Task, lane: Lane, references: Array, recording: Recording, b: int, warning: str | None
) -> Row:
    first, end = lane.case.window(task.ts_s)
    bad = ~np.isfinite(recording.action[:end, b])
    if bad.any():
        return {
            "status": f"{ERROR}: the controller's action at sample {int(np.argmax(bad))} is not finite"
        }
    limit = largest_rate_V_s(task.stage.plant)
    scored, text = score_lane(
        lane.case, task.ts_s, references, recording, b, warning=warning, identified_V_s=limit
    )
    row: Row = {**asdict(scored), "status": text}
    if lane.keep_trace:
        parts = (references, recording.displacement_um, recording.command_V)
        r, y, u = (part[first:end, b] for part in parts)
        row["trace"] = _trace(r, y, u, task.ts_s, lane.case)
    return row


def _trace(r: Array, y: Array, u: Array, ts_s: float, case: Case) -> dict[str, Any]:
    """Keep the first scored period, every so many samples."""
    count = min(len(r), round(case.period_s / ts_s) + 1)
    stride = -(-count // TRACE_SAMPLES)
    kept = slice(0, count, stride)
    return {
        "step_s": stride * ts_s,
        "reference_um": [float(f"{x:.6g}") for x in r[kept]],
        "displacement_um": [float(f"{x:.6g}") for x in y[kept]],
        "error_um": [float(f"{x:.4g}") for x in (r - y)[kept]],
        "command_V": [float(f"{x:.6g}") for x in u[kept]],
    }


def _row(task: Task, lane: Lane) -> Row:
    return {
        "controller": task.controller,
        "plant": task.stage.plant.name,
        "belief": TRUE_PLANT if task.controller == FULL_PREVIEW else task.stage.belief.name,
        "reference": lane.case.reference,
        "frequency_hz": lane.case.frequency_hz,
        "ts_s": task.ts_s,
        "seed": lane.seed,
        **task.stamps,
    }


def benchmark(
    selection: Selection,
    out: Path | None,
    jobs: int = -1,
    progress: Progress | None = None,
    ray_address: str | None = None,
    told: Told | None = None,
) -> Outcome:
    """Compute what is missing or failed and return every row that was asked for.

    Controllers are run one after the other, the bound last, and `told` hears of each. Without a folder no row is kept, and none carries a fingerprint.
    """
    if out is None:
        with TemporaryDirectory() as scratch:
            return _compute(selection, Path(scratch), False, jobs, progress, ray_address, told)
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; give a folder for --out")
    return _compute(selection, out, True, jobs, progress, ray_address, told)


def _compute(
    selection: Selection,
    out: Path,
    stamped: bool,
    jobs: int,
    progress: Progress | None,
    ray_address: str | None,
    told: Told | None,
) -> Outcome:
    """Run the tasks whose rows a folder does not have."""
    tasks = _tasks(selection, stamped)
    stamps = {key: task.stamps for task in tasks for key in row_keys(task)}
    store, notes = TRACKING.open(out), list[str]()

    def is_stale(row: Row) -> bool:
        expected = stamps.get(TRACKING.key(row), {})
        return any(row.get(name) != value for name, value in expected.items())

    waiting: dict[str, list[TrackingKey]] = {}
    for key in stamps:
        waiting.setdefault(key[0], []).append(key)
    order = sorted(waiting, key=lambda name: name == FULL_PREVIEW)

    def tell(fresh: Sequence[Row]) -> None:
        name = str(fresh[0]["controller"])
        if told is None or name == FULL_PREVIEW or not store.rows.keys() >= set(waiting[name]):
            return
        told(name, [store.rows[key] for key in waiting[name]])

    groups = [replace(task, lanes=lanes) for task in tasks for lanes in _alike(task)]
    groups.sort(key=lambda task: (order.index(task.controller), -task.samples))
    computed = complete(
        store, groups, run_task, row_keys, is_stale,
        name=TRACKING.key, note=notes.append,
        stale="Rows of changed code, plants or controllers were set aside in {.name}.",
        # a row that failed for want of a file or a package may succeed now
        is_finished=lambda row: words([row["status"]]) != {ERROR},
        jobs=jobs, progress=progress, ray_address=ray_address, heard=tell,
    )  # fmt: skip
    return Outcome([store.rows[key] for key in stamps], computed, tuple(notes))


def _tasks(selection: Selection, stamped: bool) -> list[Task]:
    """Return a task for each controller, plant and sampling time, in the order of the rows.

    The bound is always run: gaps and efforts are measured against it.
    """
    tasks = []
    controllers = dict.fromkeys((*selection.controllers, FULL_PREVIEW))
    for controller, one in product(controllers, selection.stages):
        factory = selection.factories.get(controller)
        for ts in one.every_ts_s:
            if not selection.runs_at(controller, one, ts):
                continue
            stamps = {}
            if stamped:
                # a controller made by a factory may be another each time: always run anew
                made = os.urandom(8).hex() if factory is not None else None
                stamps = {
                    "code": code_fingerprint(controller),
                    "task": made or task_fingerprint(controller, one.plant, one.believed),
                }
            lanes = [
                Lane(case, seed, ts == one.shown_ts_s and seed == selection.seeds[0])
                for case in one.cases(selection.references, ts)
                for seed in selection.seeds
            ]
            tasks.append(Task(controller, one, ts, tuple(lanes), stamps, factory))
    return tasks


def _alike(task: Task) -> Iterator[tuple[Lane, ...]]:
    """Yield groups of lanes of similar lengths, since a short one idles to the end of a long one."""

    def length(lane: Lane) -> int:
        return lane.case.window(task.ts_s)[1]

    group: list[Lane] = []
    for lane in sorted(task.lanes, key=length):
        if group and length(lane) > _LENGTH_RATIO * length(group[0]):
            yield tuple(group)
            group = []
        group.append(lane)
    if group:
        yield tuple(group)
