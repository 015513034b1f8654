"""The rows of a study: made case by case into a store that an interrupted run continues."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Protocol, TypeVar

from benchmarks.sweep import Keyed, run_rows
from rdpi_gym.support.fingerprint import code_parts, fingerprint, room_files
from rdpi_gym.support.progress import progress_bar
from rdpi_gym.support.store import Row

C = TypeVar("C", bound=Keyed, contravariant=True)


class RunCase(Protocol[C]):
    """What makes the row of a case, given the fingerprint of the code that it is of."""

    def __call__(self, case: C, code: str) -> Row:
        """Return the row."""


def study_rows(
    cases: Sequence[C],
    run_case: RunCase[C],
    chosen: Namespace,
    rooms: Sequence[str],
    files: Sequence[Path],
) -> list[Row]:
    """Make the rows of cases that the folder of a study does not have, and return those of all."""
    code = fingerprint(code_parts([*room_files(*rooms), *files]))
    with progress_bar() as show:
        return run_rows(
            cases, chosen.out, partial(run_case, code=code), code, chosen.jobs, show,
            lambda sentence: print(sentence, file=sys.stderr),
        )  # fmt: skip
