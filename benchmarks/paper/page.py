"""The paper's claim in one chart, and its figures and numbers as one page of HTML."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from benchmarks.paper.run import PaperResults
from rdpi_gym.report.chart import Axis, Chart, Panel, Series
from rdpi_gym.report.page import Section, write_page
from rdpi_gym.report.style import PALETTE, REFERENCE

_COLOURS = {
    "none": REFERENCE, "literal": PALETTE[1], "given": PALETTE[0], "low-passed in both": PALETTE[5],
    "low-passed": PALETTE[2], "reference-rate/A": PALETTE[3], "closed-form reference-rate/A": PALETTE[4],
}  # fmt: skip


def write_paper_page(
    path: Path | str, results: PaperResults, lines: Sequence[str], rows: pd.DataFrame
) -> Path:
    """Write what was recomputed as a self-contained page."""
    sections = [
        Section(
            "Error against the sampling time",
            "Largest error over the last of three periods at 50 Hz, in percent of the amplitude, for "
            "each reading of Eq. 6 and of the classical inverse. A reading whose error falls with the "
            "sampling time is one for which the paper's claim holds.",
            sweep_chart(results),
        ),
        Section(
            "Every panel and number of the paper",
            "Errors over the last of three periods, beside the paper's number where it prints one.",
            table=rows,
        ),
    ]
    first, *rest = lines
    summary = "\n\n".join([first, "\n".join(f"- {line}" for line in rest)])
    return write_page(path, "The paper's figures and numbers", summary, sections)


def sweep_chart(results: PaperResults) -> Chart:
    """Draw the largest error of every reading over the sampling time."""
    lines = []
    for reading in dict.fromkeys(run.reading.name for run in results.sweep):
        runs = results.swept(reading)
        lines.append(
            Series(
                [run.sine.ts_s for run in runs], [run.percent for run in runs], reading,
                _COLOURS.get(reading, PALETTE[6]), hover="%{x:.3g} s: %{y:.3g} %", tagged=True,
            )
        )  # fmt: skip
    axes = Axis("Sampling time (s)", log=True), Axis("Largest error (% of the amplitude)", log=True)
    return Chart([Panel(lines, *axes)], 480)
