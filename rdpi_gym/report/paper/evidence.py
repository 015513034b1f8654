"""The figures of the paper's page that show why: error and growth over Ts, runs that part."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rdpi_gym.report.paper.canvas import BLUE, RED, STYLES, legend_below, sheet, title_panel
from rdpi_gym.report.paper.results import PaperResults
from rdpi_gym.report.style import INK, MUTED


def error_against_ts(results: PaperResults) -> Figure:
    """Draw largest and RMS error of every reading over the sampling time, with slope guides.

    Lines are medians of the realisations, shades their whole range. The reading whose error is
    rounding is left out.
    """
    figure, grid = sheet(1, 2, 5.2, sharex=True, sharey=True)
    limit_s = results.limit("P5", "literal").found_s
    for axes, field, title in zip(
        grid[0], ("max_error_um", "rms_error_um"), ("largest error", "RMS error"), strict=True
    ):
        for name, style in STYLES.items():
            runs = results.swept(name)
            ts = [run.sine.ts_s for run in runs]
            values = [np.asarray(getattr(run, field)) for run in runs]
            axes.loglog(ts, [np.median(v) for v in values], label=name, **style)
            if any(not run.reproducible for run in runs):
                low, high = [v.min() for v in values], [v.max() for v in values]
                axes.fill_between(ts, low, high, color=style["color"], alpha=0.2, lw=0)
        axes.axvline(limit_s, color=MUTED, lw=0.9, ls="--")
        _note(axes, "limit of\nliteral", limit_s, 3.2)
        _slope_guide(axes, 1.0, 4e-4, "slope 1")
        _slope_guide(axes, 0.5, 2.2e-3, "slope ½")
        axes.set(xlabel="sampling time $T_s$ (s)", ylim=(3e-4, 5.5))
        title_panel(axes, "", f"{title}, 50 Hz, amplitude 10")
    grid[0, 0].set_ylabel("error over the last period")
    legend_below(figure, 3)
    return figure


def _note(axes: Axes, text: str, x: float, y: float) -> None:
    axes.annotate(
        text, (x, y), (4, 0), textcoords="offset points", color=MUTED, fontsize=8, va="center"
    )


def _slope_guide(axes: Axes, order: float, start: float, text: str) -> None:
    x = np.array([1.6e-5, 9.6e-5])
    y = start * (x / x[0]) ** order
    axes.loglog(x, y, color=MUTED, lw=0.9)
    _note(axes, text, x[1], y[1])


def growth_against_ts(results: PaperResults) -> Figure:
    """Draw the growth of a small disturbance in a sample, simulated and predicted."""
    figure, grid = sheet(1, 2, 4.2, sharex=True, sharey=True)
    readings = {
        "literal": "Eq. 6 as printed",
        "closed-form own-rate": "classical inverse on its own rate",
    }
    for axes, (name, title) in zip(grid[0], readings.items(), strict=True):
        axes.axhline(1.0, color=INK, lw=0.8)
        for plant, colour in (("P5", BLUE), ("P10", RED)):
            limit = results.limit(plant, name)
            ts_ms = [1e3 * loop.ts_s for loop in limit.loops]
            predicted = [loop.growth for loop in limit.predicted_loops]
            simulated = [loop.growth for loop in limit.loops]
            axes.loglog(ts_ms, predicted, color=colour, label=f"{plant}, by the polynomial")
            axes.loglog(
                ts_ms, simulated, "o", ms=4, mfc="none", color=colour, label=f"{plant}, simulated"
            )
            found_ms = 1e3 * limit.found_s
            axes.plot([found_ms] * 2, [0.25, 1.0], color=colour, lw=0.9, ls="--")
            axes.annotate(
                f"{found_ms:.3f} ms",
                (found_ms, 0.265),
                (-2, 0),
                textcoords="offset points",
                color=colour,
                fontsize=8.5,
                rotation=90,
                ha="right",
            )
        axes.set(xlabel="sampling time $T_s$ (ms)", xlim=(0.045, 1.35), ylim=(0.25, 7.0))
        axes.set_xticks([0.05, 0.1, 0.2, 0.5, 1.0], ["0.05", "0.1", "0.2", "0.5", "1"])
        axes.set_yticks([0.25, 0.5, 1.0, 2.0, 4.0], ["0.25", "0.5", "1", "2", "4"])
        axes.minorticks_off()
        axes.text(1.3, 1.04, "grows", ha="right", va="bottom", fontsize=8.5, color=MUTED)
        axes.text(1.3, 0.96, "decays", ha="right", va="top", fontsize=8.5, color=MUTED)
        title_panel(axes, "", title)
    grid[0, 0].set_ylabel("growth of a disturbance\nin a sample, all plays sliding")
    legend_below(figure, 4)
    return figure


def irreproducible(results: PaperResults) -> Figure:
    """Draw the difference of two commands whose references differ by a relative 1e-15."""
    figure, grid = sheet(1, 1, 3.6)
    axes = grid[0, 0]
    for x in results.divergences:
        # differences of zero have no place on a logarithmic axis
        parted = np.where(x.command_V == 0.0, np.nan, np.abs(x.command_V))
        style = STYLES[x.reading.name] | {"lw": 1.1}
        axes.semilogy(1e3 * x.t_s, parted, label=x.reading.name, **style)
    axes.set(xlabel="time (ms)", ylabel="difference of the commands (V)", ylim=(1e-17, 30.0))
    title_panel(axes, "", "A reference changed by a relative $10^{-15}$: 50 Hz, $T_s = 10^{-4}$ s")
    legend_below(figure, 4)
    return figure
