"""The paper's figures and numbers as one page of HTML."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import plotly.graph_objects as go

from rdpi_gym.report.page import Section, write_page
from rdpi_gym.report.paper.results import PaperResults
from rdpi_gym.report.style import styled


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
            _sweep(results),
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


def _sweep(results: PaperResults) -> Any:
    figure = go.Figure()
    for reading in dict.fromkeys(run.reading.name for run in results.sweep):
        runs = results.swept(reading)
        figure.add_scatter(
            x=[run.sine.ts_s for run in runs],
            y=[run.percent for run in runs],
            name=reading,
            mode="lines",
            hovertemplate="%{x:.3g} s: %{y:.3g} %<extra>" + reading + "</extra>",
        )
    figure.update_xaxes(title_text="Sampling time (s)", type="log")
    figure.update_yaxes(title_text="Largest error (% of the amplitude)", type="log")
    return styled(figure, 480)
