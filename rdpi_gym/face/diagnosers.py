"""`score_diagnosers`: diagnosers on plants with known hidden effects."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar

import pandas as pd

from benchmarks.diagnosis import run
from benchmarks.stages.run import read_seed
from rdpi_gym.support.checks import checked
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.store import Row

__all__ = ["DiagnoserScores", "score_diagnosers"]


@dataclass(frozen=True)
class DiagnoserScores:
    """Scores of diagnosers, a row for each of them on each plant.

    Parameters
    ----------
    rows
        Log loss (nat), Brier score, false names, found of the hidden effects, explained share,
        processor time (s) and failure.
    command
        The command that makes the same.
    computed
        How many rows were computed in this run.
    notes
        Remarks for the reader, one line each.
    """

    rows: tuple[Row, ...]
    command: str
    computed: int
    notes: tuple[str, ...] = ()

    legend: ClassVar[str] = run.LEGEND

    @property
    def seen(self) -> str:
        """Name of the draws: public or private seed."""
        return str(self.rows[0]["draws"])

    @property
    def answer(self) -> str:
        """The first by log loss, one sentence."""
        table = self.ranking()
        if table.empty:
            return "No plant can be asked about."
        return f"{table['diagnoser'][0]} has the smallest log loss of {len(table)}."

    def ranking(self) -> pd.DataFrame:
        """Return the table of diagnosers, the smallest log loss first."""
        return run.ranking(self.rows)

    def refusal(self, diagnoser: str) -> str | None:
        """Return why a diagnoser has no score on any plant, None where it has one."""
        reasons = [str(row["failure"]) for row in self.rows if row["diagnoser"] == diagnoser]
        return reasons[0] if all(reasons) else None

    def write(self, out: PathLike[str] | str) -> Path:
        """Write the tables as a page in a folder, and return its path."""
        return run.write_page(self.rows, Path(out), self.command)

    def __repr__(self) -> str:
        return f"{self.answer}\n{self.ranking().to_string(index=False)}"


@checked
def score_diagnosers(
    diagnosers: Sequence[str] = (),
    plants: int = run.PLANTS,
    *,
    seed_file: PathLike[str] | str | None = None,
    out: PathLike[str] | str | None = None,
    jobs: int = -1,
    ray: str | None = None,
    progress: Progress | None = None,
) -> DiagnoserScores:
    """Score diagnosers on plants with known hidden effects, beside those that ship.

    Parameters
    ----------
    diagnosers
        ``module:attribute`` of each of yours.
    plants
        Number of drawn plants.
    seed_file
        A file with the seed of the draws, one whole number; by default the public seed.
    out
        Folder that keeps finished rows, so that an interrupted run goes on; by default none.
    jobs
        Worker processes; -1: one for each core.
    ray
        Address of a Ray cluster that works in place of processes here.
    progress
        Called as ``progress(stage, done, total)``.

    Returns
    -------
    DiagnoserScores
        It prints the ranking.

    Raises
    ------
    InputError
        An unknown name, a number of plants out of range, a seed file that holds none.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> rg.score_diagnosers(plants=0)
    Traceback (most recent call last):
    ...
    rdpi_gym.support.errors.InputError: --draws is 0; give 1 to 1775 plants
    """
    seed = read_seed(None if seed_file is None else Path(seed_file))
    with TemporaryDirectory() as scratch:
        outcome = run.run_diagnosers(
            diagnosers, plants, Path(scratch if out is None else out), seed=seed,
            jobs=jobs, progress=progress, ray_address=ray,
        )  # fmt: skip
    words = [
        "rdpi",
        "bench",
        "diagnosis",
        *(w for name in diagnosers for w in ("--diagnoser", name)),
    ]
    if plants != run.PLANTS:
        words += ["--draws", str(plants)]
    return DiagnoserScores(tuple(outcome.rows), shlex.join(words), outcome.computed, outcome.notes)
