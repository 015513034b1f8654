"""Cases of a study run into a store of rows, which an interrupted run continues."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol, TypeVar

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.parallel import run_cases
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.store import Row, named_rows

ROWS_FILE = "rows.jsonl"


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
    """Compute the rows of cases that a store does not have, and return the rows of all cases."""
    store = named_rows(out / ROWS_FILE)
    remark = store.remark()
    if remark is not None:
        note(remark)
    aside = store.set_aside(lambda row: row.get("code") != code)
    if aside is not None:
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
    """Return the stored rows of cases, whatever code computed them."""
    stored = named_rows(out / ROWS_FILE).rows
    rows = [stored[case.key] for case in cases if case.key in stored]
    if not rows:
        raise InputError(f"{out / ROWS_FILE} has no row of these cases; run them without --tables")
    return rows
