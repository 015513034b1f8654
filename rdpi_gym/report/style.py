"""One look for every figure: colours that colour-blind readers tell apart, fonts, margins."""

from __future__ import annotations

from functools import cache
from html import escape
from typing import Any

PALETTE: tuple[str, ...] = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#5B5B5B",
)  # fmt: skip
"""Colours of series, in order (Okabe and Ito, without the yellow that white paper swallows)."""

INK, MUTED, GRID, PAPER = "#1C2126", "#5A646E", "#E3E7EB", "#FFFFFF"
MEASURED, MODEL, REFERENCE = INK, PALETTE[0], "#8A949E"
RISING, FALLING, RESIDUAL = PALETTE[1], PALETTE[2], "#7B3F7D"
"""Colours by meaning: the same thing has the same colour on every page."""

SEQUENTIAL: tuple[str, ...] = ("#00224E", "#35456C", "#666970", "#948E77", "#C8B866", "#FEE838")
"""Low to high (cividis)."""
DIVERGING: tuple[str, ...] = ("#0B4F7D", "#5BA3CF", "#F4F4F2", "#F0A35E", "#A34700")
"""Below zero to above zero, through white."""

FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"


def figure_text(text: str) -> str:
    """Make a name safe inside a Plotly figure, which reads ``<b>`` and ``<a>`` as markup."""
    return escape(text, quote=False)


def colour_steps(colours: tuple[str, ...]) -> list[list[float | str]]:
    """Give colours as a Plotly colour scale, evenly spaced from 0 to 1."""
    return [[i / (len(colours) - 1), colour] for i, colour in enumerate(colours)]


@cache
def plotly_template() -> Any:
    """Build the Plotly template of the house."""
    import plotly.graph_objects as go

    axis = {
        "gridcolor": GRID,
        "linecolor": MUTED,
        "zerolinecolor": "#B9C1C9",
        "zerolinewidth": 1,
        "showline": True,
        "ticks": "outside",
        "ticklen": 4,
        "tickcolor": MUTED,
        "automargin": True,
        "title": {"standoff": 8},
    }
    return go.layout.Template(
        layout={
            "font": {"family": FONT, "size": 13, "color": INK},
            "colorway": list(PALETTE),
            "paper_bgcolor": PAPER,
            "plot_bgcolor": PAPER,
            "margin": {"l": 64, "r": 20, "t": 40, "b": 52},
            "xaxis": axis,
            "yaxis": axis,
            "colorscale": {
                "sequential": colour_steps(SEQUENTIAL),
                "diverging": colour_steps(DIVERGING),
            },
            "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
            "hoverlabel": {"font": {"family": FONT, "size": 12}, "bgcolor": PAPER},
            "hovermode": "closest",
            "annotationdefaults": {"font": {"size": 13, "color": INK}},
        },
        data={"scatter": [{"line": {"width": 1.6}}]},
    )


def styled(figure: Any, height_px: int = 420) -> Any:
    """Give a Plotly figure the look of the house and return it."""
    figure.update_layout(template=plotly_template(), height=height_px, autosize=True)
    if figure.layout.annotations:  # the titles of subplots stand where the legend would
        figure.update_layout(margin_t=64, legend_y=1.0 + 26.0 / (height_px - 116.0))
    return figure


def matplotlib_style() -> dict[str, Any]:
    """Give Matplotlib's settings for the same look: ``with plt.rc_context(matplotlib_style())``."""
    from cycler import cycler

    return {
        "figure.dpi": 110,
        "savefig.dpi": 160,
        "savefig.bbox": "tight",
        "font.family": "sans-serif",
        "font.size": 9.5,
        "axes.titlesize": 10.5,
        "axes.labelcolor": INK,
        "axes.edgecolor": MUTED,
        "axes.grid": True,
        "axes.axisbelow": True,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.prop_cycle": cycler(color=list(PALETTE)),
        "grid.color": GRID,
        "grid.linewidth": 0.7,
        "lines.linewidth": 1.3,
        "legend.frameon": False,
        "legend.fontsize": 9,
        "text.color": INK,
        "xtick.color": MUTED,
        "ytick.color": MUTED,
        "svg.hashsalt": "rdpi",
        "text.usetex": False,  # a matplotlibrc of the current folder would have LaTeX run
    }
