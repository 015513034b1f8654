"""The paper's claim in one picture: the error of each reading against the sampling time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rdpi_gym.report.paper.canvas import STYLES
from rdpi_gym.report.paper.results import PaperResults

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_paper(figure: Figure, results: PaperResults) -> Any:
    """Draw the largest error of every reading over the sampling time into an empty figure."""
    axes = figure.subplots()
    for reading in dict.fromkeys(run.reading.name for run in results.sweep):
        runs = results.swept(reading)
        axes.loglog(
            [run.sine.ts_s for run in runs],
            [run.percent for run in runs],
            label=reading,
            **STYLES.get(reading, {}),
        )
    axes.set_xlabel("Sampling time (s)")
    axes.set_ylabel("Largest error (% of the amplitude)")
    figure.legend(loc="outside right center")
    return axes
