"""The study: every case diagnosed, row by row into a store, on as many cores as there are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Protocol, TypeVar

from benchmarks.hidden_effects.case_row import Engine, discover_engine, run_case, study_fingerprint
from benchmarks.hidden_effects.cases import Case
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.parallel import run_cases
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.store import Row, named_rows

ROWS_FILE = "rows.jsonl"


class Keyed(Protocol):
    """A case of a study: whatever says what its row is called."""

    @property
    def key(self) -> str:
        """What names the case in a store."""


C = TypeVar("C", bound=Keyed)


def run_study(
    cases: Sequence[Case],
    out: Path,
    jobs: int = 1,
    progress: Progress | None = None,
    engine: Engine = discover_engine,
    note: Callable[[str], None] | None = None,
    ray_address: str | None = None,
) -> list[Row]:
    """Diagnose what is missing in the store and return the rows of all cases."""
    run = partial(run_case, engine=engine)
    return run_rows(cases, out, run, study_fingerprint(), jobs, progress, note, ray_address)


def run_rows(
    cases: Sequence[C],
    out: Path,
    run: Callable[[C], Row],
    code: str,
    jobs: int = 1,
    progress: Progress | None = None,
    note: Callable[[str], None] | None = None,
    ray_address: str | None = None,
) -> list[Row]:
    """Make the rows of cases that a store does not have, and return those of all."""
    store = named_rows(out / ROWS_FILE)
    remark = store.remark()
    if remark is not None and note is not None:
        note(remark)
    aside = store.set_aside(lambda row: row.get("code") != code)
    if aside is not None and note is not None:
        note(f"rows of code that has changed since were set aside in {aside}")
    missing = [case for case in cases if case.key not in store.rows]
    done = len(cases) - len(missing)
    if progress is not None:
        progress("diagnosing", done, len(cases))
    for row in run_cases(run, missing, jobs, ray_address):
        store.append([row])
        done += 1
        if progress is not None:
            progress("diagnosing", done, len(cases))
    return [store.rows[case.key] for case in cases]


def stored_rows(cases: Sequence[Keyed], out: Path) -> list[Row]:
    """Return the rows of cases that stand in a folder, whatever code they are of."""
    stored = named_rows(out / ROWS_FILE).rows
    rows = [stored[case.key] for case in cases if case.key in stored]
    if not rows:
        raise InputError(f"{out / ROWS_FILE} has no row of these cases; run them without --tables")
    return rows
