"""The runner of every study: options, rows that an interrupted run continues, files, page."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol, TypeVar

import pandas as pd

from benchmarks.rows import Keyed, run_rows
from rdpi_gym.support.command import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.fingerprint import code_parts, fingerprint, room_files
from rdpi_gym.support.progress import progress_bar
from rdpi_gym.support.store import Row

RESULTS = Path(__file__).parent / "results"
Files = Mapping[str, "str | bytes | pd.DataFrame"]
"""Content of files by name; a page (``.md``) is printed as well."""


@dataclass(frozen=True)
class Study:
    """A study as a command.

    Parameters
    ----------
    name, doc
        Of its module.
    files
        Called with the options; returns what is written to ``--out``.
    out, seed, jobs
        Defaults of the options; None: without.
    numbers
        Further options that are whole numbers: name, default, meaning.
    more
        Adds options of other kinds.
    csv
        Format of floats in its tables; None: all digits.
    """

    name: str
    doc: str | None
    files: Callable[[Namespace], Files]
    out: Path | None = RESULTS
    seed: int | None = None
    jobs: int | None = None
    numbers: Sequence[tuple[str, int | None, str]] = ()
    more: Callable[[Options], object] = lambda options: None
    csv: str | None = None

    def __call__(self, arguments: Sequence[str] | None = None) -> int:
        """Read the options, run the study, write its files, and print its page."""
        options = Options(self.name, self.doc, out=self.out, seed=self.seed, jobs=self.jobs)
        for number in self.numbers:
            options.add_number(*number)
        self.more(options)
        return options.run(arguments, self._run)

    def _run(self, chosen: Namespace) -> None:
        for name, content in self.files(chosen).items():
            if isinstance(content, pd.DataFrame):
                content = content.to_csv(index=False, float_format=self.csv, lineterminator="\n")
            path = write_atomic(chosen.out / name, content)
            if path.suffix == ".md":
                print(content, f"written to {path}", sep="\n")


def names_of(kind: str, asked: Sequence[str], known: Iterable[str]) -> list[str]:
    """Return the names that are asked for, or all; refuse an unknown one."""
    every = list(known)
    for name in asked:
        if name not in every:
            raise InputError(f"no {kind} is named {name!r}; known are {', '.join(every)}")
    return list(asked) or every


C = TypeVar("C", bound=Keyed, contravariant=True)


class RunCase(Protocol[C]):
    """Makes the row of a case, given the fingerprint of the code that it depends on."""

    def __call__(self, case: C, code: str) -> Row:
        """Return the row."""


def study_rows(
    cases: Sequence[C],
    run_case: RunCase[C],
    chosen: Namespace,
    rooms: Sequence[str],
    files: Sequence[Path],
) -> list[Row]:
    """Compute the rows of cases that the folder of a study does not have; return those of all."""
    code = fingerprint(code_parts([*room_files(*rooms), *files]))
    with progress_bar() as show:
        run = partial(run_case, code=code)
        return run_rows(cases, chosen.out, run, code, chosen.jobs, show)
