"""The payoff of knowing an effect, drawn: error of each compensator by belief."""

from __future__ import annotations

import numpy as np
import pandas as pd

from rdpi_gym.report.chart import Axis, Chart, Mark, Note, Panel, Series, side_by_side
from rdpi_gym.report.chart_matplotlib import chart_png
from rdpi_gym.report.page import Section
from rdpi_gym.report.style import INK, MUTED, PALETTE
from rdpi_gym.support.words import number

_BELIEFS = {
    "bare": (PALETTE[6], "circle"),
    "fitted": (PALETTE[1], "square"),
    "discovered": (PALETTE[2], "diamond"),
    "true": (INK, "line-ns-open"),
}
"""Colour and symbol of each belief."""


def payoff_section(summary: pd.DataFrame, table: pd.DataFrame, method: str) -> Section:
    """Make the section of a page that shows the payoff."""
    falls = summary["fall_from_fitted"].dropna()
    answer = (
        f"Discovering the effect divides the tracking error by {number(falls.min(), 2)} to "
        f"{number(falls.max(), 2)}, in the median by {number(falls.median(), 2)}. "
        if len(falls)
        else ""
    )
    text = (
        f"{answer}The plants have an effect that the bare model lacks. Each line goes from the error "
        "with an RDPI model fitted to records of the plant to the error with the model in which the "
        "effect was discovered from the same records.\n\n"
    )
    return Section("What it pays to know the effect", text + method, payoff_chart(summary), table)


def payoff_chart(summary: pd.DataFrame) -> Chart:
    """Draw the error by belief, one panel a compensator; a line joins the fitted to the discovered."""
    plants = [name.replace(" with ", "\nwith ", 1) for name in dict.fromkeys(summary["plant"])]
    panels: list[Panel] = []
    for controller in dict.fromkeys(summary["controller"]):
        rows = summary[summary["controller"] == controller]
        marks: list[Mark] = []
        for name, row in zip(plants, rows.to_dict("records"), strict=True):
            if row["diverged"]:
                note = f"{row['diverged']}: diverged"
                marks.append(Note(None, name, note, PALETTE[1], "right", 15.0))
                continue
            ends = [row["fitted"], row["discovered"]]
            marks.append(Series(ends, [name, name], colour=MUTED, width=1.0, hover=""))
            fall = f"÷ {row['fall_from_fitted']:.3g}"
            marks.append(Note(float(np.sqrt(ends[0] * ends[1])), name, fall, MUTED, "center", 9.0))
        marks += [
            Series(
                rows[belief], plants, belief, colour, None, marker=symbol, size=11.0, edge=2.0, group=belief,
                listed=not panels, hover=f"%{{y}}, {belief}: %{{x:.3g}} %",
            )
            for belief, (colour, symbol) in _BELIEFS.items() if belief in rows.columns
        ]  # fmt: skip
        x, y = (
            Axis("RMSE (% of peak to peak)", log=True, ticks="decades"),
            Axis(categories=plants, reversed=True),
        )
        panels.append(Panel(marks, x, y, controller))
    return side_by_side(panels, 190 + 44 * len(plants), gap=0.03, shared="y")


def payoff_picture(summary: pd.DataFrame) -> bytes:
    """Draw the same as a PNG file."""
    chart = payoff_chart(summary)
    plants = len(chart.panels[0].y.categories or ())
    return chart_png(chart, (3.0 + 2.9 * len(chart.panels), 1.7 + 0.5 * plants))
