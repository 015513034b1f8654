"""Learning curves in one picture."""

from __future__ import annotations

import io
from typing import Any

import pandas as pd
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, LogLocator, NullLocator, StrMethodFormatter

from rdpi_gym.report.style import INK, PALETTE, matplotlib_style

_ROWS = {
    "rmse_um": "RMSE on held-out plants (µm)",
    "variation_ratio": "command variation\nover the compensator's",
}


def learning_picture(bands: pd.DataFrame, compensator: str, compensator_rmse_um: float) -> bytes:
    """Draw error and command variation over the steps, one column an algorithm, one line an agent."""
    style: Any = matplotlib_style()
    named = bands["agent"].str.split("-", n=1, expand=True)
    bands = bands.assign(algorithm=named[0], action=named[1])
    actions = list(bands["action"].unique())
    algorithms = list(bands["algorithm"].unique())
    with rc_context(style):
        figure = Figure(figsize=(2.2 + 3.4 * len(algorithms), 5.6), layout="constrained")
        grid = figure.subplots(2, len(algorithms), sharex="col", sharey="row", squeeze=False)
        for column, algorithm in enumerate(algorithms):
            part = bands[bands["algorithm"] == algorithm]
            for row, name in enumerate(_ROWS):
                axes = grid[row, column]
                for action, lines in part.groupby("action", sort=False):
                    _draw(axes, lines, name, PALETTE[actions.index(str(action))], str(action))
                level = compensator_rmse_um if name == "rmse_um" else 1.0
                axes.axhline(level, color=INK, linestyle="--", linewidth=1.2, label=compensator)
                axes.set_yscale("log", nonpositive="clip")
                axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                axes.yaxis.set_minor_locator(NullLocator())
                axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            grid[0, column].set_title(algorithm.upper(), loc="left")
            grid[1, column].set_xlabel("environment steps")
            grid[1, column].xaxis.set_major_formatter(EngFormatter())
        grid[1, 0].set_ylim(*_variation_range(bands))
        for row, label in enumerate(_ROWS.values()):
            grid[row, 0].set_ylabel(label)
        found = (grid[0, column].get_legend_handles_labels() for column in range(len(algorithms)))
        handles = {label: handle for pair in found for handle, label in zip(*pair, strict=True)}
        legend = {name: handles[name] for name in (*actions, compensator)}
        figure.legend(
            list(legend.values()), list(legend), loc="outside lower center", ncols=len(legend)
        )
        stream = io.BytesIO()
        # no version of the library in the file: the same result is the same picture
        figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()


def _variation_range(bands: pd.DataFrame) -> tuple[float, float]:
    """Show a factor of two about 1 at least, and no idle network far below."""
    low, high = bands["variation_ratio_low"].min(), bands["variation_ratio_high"].max()
    return min(max(0.8 * low, 0.1), 0.5), max(1.2 * high, 2.0)


def _draw(axes: Any, lines: pd.DataFrame, name: str, colour: str, label: str) -> None:
    steps = lines["timesteps"]
    axes.fill_between(
        steps, lines[f"{name}_low"], lines[f"{name}_high"], color=colour, alpha=0.2, linewidth=0
    )
    axes.plot(steps, lines[name], color=colour, marker="o", markersize=3.0, label=label)
