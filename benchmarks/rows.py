"""Rows of benchmarks and studies: formats of stores, and runs of missing units that an interrupted run continues."""

from __future__ import annotations

import sys
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeAlias, TypeVar

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.parallel import run_cases
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.store import Row, RowStore, check_row, named_rows

if TYPE_CHECKING:  # workers of a submission find the user's folder before pandas is needed
    import pandas as pd

K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True)
class RowFormat(Generic[K]):
    """Rows of one benchmark."""

    # file of the store, and what its first line states
    file: str
    name: str
    key: Callable[[Mapping[str, Any]], K]  # name of a row
    # fields that are text, numbers of 0 or above where given, and text where given
    texts: tuple[str, ...]
    numbers: tuple[str, ...]
    remarks: tuple[str, ...] = ()

    def open(self, folder: Path) -> RowStore[K]:
        """Return the store of the rows in a folder."""
        return RowStore(folder / self.file, self.name, self._checked_key)

    def _checked_key(self, row: Mapping[str, Any]) -> K:
        """Return the name of a row whose fields are those that a run writes."""
        check_row(row, self.texts, self.numbers, self.remarks)
        return self.key(row)


TrackingKey: TypeAlias = tuple[str, str, str, float, float, int]
"""Controller, plant, reference, frequency (Hz), Ts (s), seed."""
TaskKey: TypeAlias = tuple[str, str, str, int]
"""Controller, task, draws, number of the plant."""


def _tracking_key(row: Mapping[str, Any]) -> TrackingKey:
    return (
        str(row["controller"]),
        str(row["plant"]),
        str(row["reference"]),
        float(row["frequency_hz"]),
        float(row["ts_s"]),
        int(row["seed"]),
    )


def _task_key(row: Mapping[str, Any]) -> TaskKey:
    if type(row["plant"]) is not int:
        raise TypeError(f"plant is {row['plant']!r}")
    return str(row["controller"]), str(row["task"]), str(row["draws"]), row["plant"]


TRACKING = RowFormat(
    "rows.jsonl",
    "rdpi-bench-rows",
    _tracking_key,
    ("controller", "plant", "reference", "status"),
    (
        "frequency_hz", "ts_s", "seed", "rmse_um", "rmse_percent", "max_um", "max_percent",
        "command_variation_V_s", "max_command_step_V", "saturated_percent",
        "microseconds_per_sample",
    ),
)  # fmt: skip
"""One controller on one reference, plant, sampling time and seed."""
TASKS = RowFormat(
    "task-rows.jsonl",
    "rdpi-task-rows",
    _task_key,
    ("controller", "task", "draws", "stamp", "failure"),
    (
        "rmse_percent", "worst_percent", "rmse_um", "rmse_noise", "command_variation_V_s",
        "microseconds_per_sample", "tuning_samples",
    ),
    ("warning", "certificate", "sees"),
)  # fmt: skip
"""One controller on one drawn plant of a task."""


ROWS_FILE = "rows.jsonl"
U = TypeVar("U")


def complete(
    store: RowStore[K],
    units: Sequence[U],
    run: Callable[[U], list[Row]],
    keys: Callable[[U], Sequence[K]],
    is_stale: Callable[[Row], bool],
    *,
    name: Callable[[Row], K],
    note: Callable[[str], None],
    stale: str,
    stage: str = "scoring",
    is_finished: Callable[[Row], bool] = lambda row: True,
    jobs: int = 1,
    progress: Progress | None = None,
    ray_address: str | None = None,
    heard: Callable[[Sequence[Row]], None] = lambda rows: None,
) -> int:
    """Run the units whose rows a store does not have, and return the number of rows computed.

    Rows that are new are `heard` of once they are stored.

    Stored rows that `is_stale` are set aside, with the note `stale` (``{}`` for the file); those that
    `is_finished` are not computed again. A unit is what one worker does at a time.
    """
    remark = store.remark()
    if remark is not None:
        note(remark)
    aside = store.set_aside(is_stale)
    if aside is not None:
        note(stale.format(aside))
    finished = {k for k, row in store.rows.items() if is_finished(row)}
    missing = [unit for unit in units if not finished.issuperset(keys(unit))]
    done, computed = len(units) - len(missing), 0
    if progress is not None:
        progress(stage, done, len(units))
    for rows in run_cases(run, missing, jobs, ray_address):
        fresh = [row for row in rows if name(row) not in finished]
        store.append(fresh)
        done, computed = done + 1, computed + len(fresh)
        if fresh:
            heard(fresh)
        if progress is not None:
            progress(stage, done, len(units))
    return computed


@dataclass(frozen=True)
class Outcome:
    """Result of a run."""

    rows: list[Row]  # those that were asked for, a bound's among them
    computed: int  # number of rows that were not finished before
    notes: tuple[str, ...]  # for a reader of the results, one sentence each


class Keyed(Protocol):
    """A case of a study."""

    @property
    def key(self) -> str:
        """Name of the case in a store."""


C = TypeVar("C", bound=Keyed)


def print_note(sentence: str) -> None:
    """Print a note on stored rows beside the output."""
    print(sentence, file=sys.stderr)


def run_rows(
    cases: Sequence[C],
    out: Path,
    run: Callable[[C], Row],
    code: str,
    jobs: int = 1,
    progress: Progress | None = None,
    note: Callable[[str], None] = print_note,
    ray_address: str | None = None,
) -> list[Row]:
    """Compute the rows of cases that a folder does not have, and return the rows of all cases."""
    store = named_rows(out / ROWS_FILE)
    complete(
        store, cases, partial(_one_row, run=run), lambda case: [case.key],
        lambda row: row.get("code") != code, name=lambda row: row["key"], note=note,
        stale="rows of code that has changed since were set aside in {}", stage="diagnosing",
        jobs=jobs, progress=progress, ray_address=ray_address,
    )  # fmt: skip
    return [store.rows[case.key] for case in cases]


def _one_row(case: C, run: Callable[[C], Row]) -> list[Row]:
    return [run(case)]


def stored_rows(cases: Sequence[Keyed], out: Path) -> list[Row]:
    """Return the stored rows of cases, whatever code computed them."""
    stored = named_rows(out / ROWS_FILE).rows
    rows = [stored[case.key] for case in cases if case.key in stored]
    if not rows:
        raise InputError(f"{out / ROWS_FILE} has no row of these cases; run them without --tables")
    return rows


def write_csv(path: Path, table: pd.DataFrame) -> Path:
    """Write a table with six significant digits."""
    text = table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
    return write_atomic(path, text)


def paragraphs(parts: Sequence[str]) -> str:
    """Join the parts of a Markdown page that are not empty."""
    return "\n\n".join(part.strip() for part in parts if part.strip()) + "\n"
