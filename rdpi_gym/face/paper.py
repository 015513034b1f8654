"""`reproduce`: the paper's figures and numbers beside ours, as a result that shows itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import pandas as pd

from benchmarks import paper
from benchmarks.paper.claims import COMPENSATORS, SWEEP_LABEL, TABLE_TS_S, section_iii
from rdpi_gym.face.display import DisplayMixin
from rdpi_gym.support.checks import checked
from rdpi_gym.support.progress import Progress

if TYPE_CHECKING:
    from rdpi_gym.report.chart import Chart


@dataclass(frozen=True, eq=False, repr=False)
class PaperResults(DisplayMixin, paper.PaperResults):
    """The paper's figures and numbers, recomputed; as :func:`rdpi_gym.reproduce` returns them.

    Everything that :class:`benchmarks.paper.PaperResults` is, and it shows itself.
    """

    saved_as: ClassVar[str] = "paper"
    figure_inches: ClassVar[tuple[float, float]] = (9.0, 4.6)

    def _lines(self) -> Sequence[str]:
        smallest = min(TABLE_TS_S)
        return [
            f"Eq. 6 as printed: largest error {self._at(smallest, 'literal'):.3g} µm at 50 Hz and "
            f"Ts = {smallest:g} s; with given thresholds {self._at(smallest, 'given'):.2g} µm "
            "(amplitude 10 µm).",
            *(
                f"{reading.name}: {self.series_verdict(SWEEP_LABEL, reading.name)}"
                for reading in COMPENSATORS
            ),
        ]

    def _at(self, ts_s: float, reading: str) -> float:
        return self.find(SWEEP_LABEL, reading, section_iii(50.0, ts_s)).max_error

    def to_dataframe(self) -> pd.DataFrame:
        """Return the rows of ``paper.csv``: every panel and number of the paper, and a verdict."""
        return paper.paper_rows(self)

    def overview(self) -> pd.DataFrame:
        """Return the rows of the error against the sampling time."""
        table = self.to_dataframe()
        return table[table["case"] == SWEEP_LABEL].dropna(axis="columns", how="all")

    def _chart(self) -> Chart:
        from benchmarks.paper.figures import sweep_chart

        return sweep_chart(self)

    def page(self, path: Path | str) -> Path:
        """Write a page: error against the sampling time, and every row beside the paper's number.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        from benchmarks.paper.figures import write_paper_page

        return write_paper_page(path, self, self._lines(), self.to_dataframe())

    def write(self, folder: Path | str) -> Path:
        """Write ``paper.md`` with its figures, ``paper.csv``, ``sweep.csv``, ``implementation.csv``.

        Returns
        -------
        Path
            ``paper.md``.

        Raises
        ------
        InputError
            The folder cannot be written.
        """
        from benchmarks.paper.figures import write_paper_figures
        from rdpi_gym.support.files import write_atomic

        out = Path(folder)
        write_paper_figures(out, self)
        write_atomic(out / "paper.csv", paper.to_csv(paper.paper_rows(self)))
        write_atomic(out / "sweep.csv", paper.to_csv(paper.sweep_rows(self)))
        write_atomic(out / "implementation.csv", paper.to_csv(paper.implementation_rows(self)))
        return write_atomic(out / "paper.md", paper.paper_markdown(self))


@checked
def reproduce(
    *,
    seed: int = 0,
    realisations: int = 16,
    progress: Progress | None = None,
) -> PaperResults:
    """Recompute the paper's figures and numbers, ours beside the paper's; takes about a minute.

    Parameters
    ----------
    seed
        Of the perturbations between realisations and of the sensor's noise.
    realisations
        Realisations of each compensator whose own rate may make it chatter, 2 or more.
    progress
        Called as ``progress(stage, done, total)``.

    Returns
    -------
    PaperResults
        It prints the verdict on the paper's claim; ``.write(folder)`` writes page and tables.

    Raises
    ------
    InputError
        A negative seed, fewer than two realisations, an argument of another type.
    """
    return PaperResults.of(paper.reproduce_paper(seed, realisations, progress=progress))
