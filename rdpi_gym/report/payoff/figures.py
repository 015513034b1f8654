"""The payoff of knowing an effect on a page: error of each compensator by belief."""

from __future__ import annotations

from typing import Any

import pandas as pd
from plotly.subplots import make_subplots

from rdpi_gym.report.page import Section
from rdpi_gym.report.style import INK, MUTED, PALETTE, figure_text, styled
from rdpi_gym.support.words import number

BELIEF_COLOURS = {
    "bare": PALETTE[6],
    "fitted": PALETTE[1],
    "discovered": PALETTE[2],
    "true": INK,
}
"""Colours of the beliefs, on every figure."""
_SYMBOLS = {"bare": "circle", "fitted": "square", "discovered": "diamond", "true": "line-ns-open"}


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
    return Section("What it pays to know the effect", text + method, payoff_figure(summary), table)


def payoff_figure(summary: pd.DataFrame) -> Any:
    """Draw the error by belief, one panel a compensator; a line joins the fitted to the discovered."""
    controllers = list(dict.fromkeys(summary["controller"]))
    figure = make_subplots(
        rows=1,
        cols=len(controllers),
        shared_yaxes=True,
        horizontal_spacing=0.03,
        subplot_titles=[figure_text(name) for name in controllers],
    )
    for column, controller in enumerate(controllers, start=1):
        rows = summary[summary["controller"] == controller]
        names = [figure_text(name) for name in rows["plant"]]
        for name, row in zip(names, rows.to_dict("records"), strict=True):
            if row["diverged"]:
                _say_diverged(figure, name, str(row["diverged"]), column)
                continue
            figure.add_scatter(
                x=[row["fitted"], row["discovered"]],
                y=[name, name],
                mode="lines",
                line={"color": MUTED, "width": 1},
                hoverinfo="skip",
                showlegend=False,
                row=1,
                col=column,
            )
        for belief, colour in BELIEF_COLOURS.items():
            figure.add_scatter(
                x=rows[belief],
                y=names,
                name=belief,
                legendgroup=belief,
                showlegend=column == 1,
                mode="markers",
                marker={
                    "color": colour,
                    "size": 11,
                    "symbol": _SYMBOLS[belief],
                    "line": {"width": 2 if belief == "true" else 0, "color": colour},
                },
                hovertemplate=f"%{{y}}, {belief}: %{{x:.3g}} %<extra></extra>",
                row=1,
                col=column,
            )
    figure.update_xaxes(type="log", title_text="RMSE (% of peak to peak)", dtick=1)
    figure.update_yaxes(autorange="reversed")
    return styled(figure, 190 + 44 * summary["plant"].nunique())


def _say_diverged(figure: Any, plant: str, beliefs: str, column: int) -> None:
    figure.add_annotation(
        x=0.98,
        xref=f"x{column if column > 1 else ''} domain",
        y=plant,
        yref=f"y{column if column > 1 else ''}",
        text=f"{beliefs}: diverged",
        showarrow=False,
        xanchor="right",
        yshift=15,
        font={"color": PALETTE[1], "size": 12},
    )
