"""The paper's Fig. 3, 4, 5, 7 and 8 from our results, and all figures of its page as PNG files."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rdpi_gym.report.paper.canvas import (
    BLUE,
    GREEN,
    ORANGE,
    RED,
    STYLES,
    legend_below,
    sheet,
    title_panel,
    write_seconds,
)
from rdpi_gym.report.paper.evidence import error_against_ts, growth_against_ts, irreproducible
from rdpi_gym.report.paper.results import LastPeriod, PaperResults, Run
from rdpi_gym.report.style import INK, MUTED, REFERENCE, matplotlib_style
from rdpi_gym.report.thin import thin_index
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.files import write_atomic

_DPI = 110
_TICKS = (-10, -5, 0, 5, 10)
_READINGS = ("literal", "given")


def write_paper_figures(folder: Path, results: PaperResults) -> list[Path]:
    """Draw every figure of the page and write it as PNG."""
    figures: dict[str, Callable[[PaperResults], Figure]] = {
        "fig3": figure_3,
        "fig4": figure_4,
        "fig5": figure_5,
        "stability": error_against_ts,
        "limit": growth_against_ts,
        "irreproducible": irreproducible,
        "fig7": figure_7,
        "fig8": figure_8,
    }
    written = []
    style: Any = matplotlib_style()
    with mpl.rc_context(style):
        for name, draw in figures.items():
            png = io.BytesIO()
            # no version in the file: the same results give the same bytes
            draw(results).savefig(png, format="png", dpi=_DPI, metadata={"Software": None})
            written.append(write_atomic(folder / f"{name}.png", png.getvalue()))
    return written


def _trace(run: Run) -> LastPeriod:
    assert run.trace is not None, "the figures are given runs with their traces"
    return run.trace


def _closed(values: Array) -> Array:
    """Return a period with its first sample again at the end, so that a loop closes."""
    return np.append(values, values[0])


def _runs(results: PaperResults, label: str, reading: str) -> list[Run]:
    return [
        run
        for case, run in zip(results.cases, results.runs, strict=True)
        if case.label == label and case.reading.name == reading
    ]


def figure_3(results: PaperResults) -> Figure:
    """Draw loops without compensation and the error at three sampling times, for two readings."""
    figure, grid = sheet(3, 3, 7.4)
    for column, (loop, panel) in enumerate(zip("abc", "def", strict=True)):
        (bare,) = _runs(results, f"Fig. 3{loop}", "none")
        axes = grid[0, column]
        axes.plot(_TICKS, _TICKS, color=REFERENCE, lw=0.8, ls=":")
        axes.plot(_closed(_trace(bare).u), _closed(_trace(bare).y), color=INK)
        axes.set(xlabel="command $u = y_r$", xticks=_TICKS)
        title_panel(axes, loop, f"{bare.sine.frequency_hz:g} Hz, no compensation")
        grid[2, column].sharey(grid[1, column])
        grid[1, column].sharex(grid[2, column])
        grid[1, column].tick_params(labelbottom=False)
        grid[2, column].set_xlabel("time in the last period (ms)")
        for axes, reading, mark in zip(grid[1:, column], _READINGS, ("", "′"), strict=True):
            for run, colour in zip(
                _runs(results, f"Fig. 3{panel}", reading), (GREEN, ORANGE, BLUE), strict=True
            ):
                trace = _trace(run)
                k = thin_index(trace.error)
                label = write_seconds(run.sine.ts_s)
                axes.plot(1e3 * trace.t[k], trace.error[k], color=colour, lw=0.9, label=label)
            title_panel(axes, f"{panel}{mark}", f"{bare.sine.frequency_hz:g} Hz, {reading}")
    grid[0, 0].set_ylabel("output $y$")
    for axes in grid[1:, 0]:
        axes.set_ylabel("error $e = y_r - y$")
    legend_below(figure, 3)
    return figure


def _maps(results: PaperResults, labels: tuple[str, ...], height_in: float) -> Figure:
    """Draw output (above) and error (below) against the reference, one panel a column."""
    figure, grid = sheet(2, len(labels), height_in, sharex=True)
    for column, label in enumerate(labels):
        above, below = grid[:, column]
        above.plot(_TICKS, _TICKS, color=REFERENCE, lw=0.8, ls=":", label="$y = y_r$")
        for name in _READINGS:
            (run,) = _runs(results, label, name)
            trace = _trace(run)
            k = thin_index(trace.error)
            style = STYLES[name] | {"lw": 1.0, "label": name}
            above.plot(_closed(trace.y_r[k]), _closed(trace.y[k]), **style)
            below.plot(_closed(trace.y_r[k]), _closed(trace.error[k]), **style)
        title = f"{run.sine.frequency_hz:g} Hz, {write_seconds(run.sine.ts_s)}"
        title_panel(above, label[-1], title)
        above.set_yticks(_TICKS)
        below.set(xlabel="reference $y_r$", xticks=_TICKS)
    grid[0, 0].set_ylabel("output $y$")
    grid[1, 0].set_ylabel("error $e = y_r - y$")
    legend_below(figure, 3)
    return figure


def figure_4(results: PaperResults) -> Figure:
    """Draw output and error against the reference at 50 Hz and two sampling times."""
    return _maps(results, ("Fig. 4a", "Fig. 4b"), 6.2)


def figure_5(results: PaperResults) -> Figure:
    """Draw output and error against the reference at the smallest sampling time."""
    return _maps(results, ("Fig. 5a", "Fig. 5b", "Fig. 5c"), 5.6)


def figure_7(results: PaperResults) -> Figure:
    """Draw the loops of the identified model at two frequencies."""
    figure, grid = sheet(1, 1, 4.6, width_in=6.0)
    axes = grid[0, 0]
    for run, colour in zip(_runs(results, "Fig. 7", "none"), (BLUE, RED), strict=True):
        trace = _trace(run)
        label = f"{run.sine.frequency_hz:g} Hz, {len(trace.t)} samples"
        axes.plot(_closed(trace.u), _closed(trace.y), color=colour, label=label)
    axes.set(xlabel="command $u$ (V)", ylabel="displacement $y$ (µm)")
    axes.legend(loc="upper left")
    title_panel(axes, "", "Loops of the model of Section IV-B")
    return figure


def figure_8(results: PaperResults) -> Figure:
    """Draw 80 Hz: output of both methods, errors beside the paper's bound, commands."""
    figure, grid = sheet(2, 2, 6.6, sharex=True)
    proposed = {name: _runs(results, "Fig. 8a", name)[0] for name in _READINGS}
    inverse = "closed-form reference-rate/A"
    classical = {inverse: _runs(results, "Fig. 8b", inverse)[0]}
    for axes, runs, letter, title in (
        (grid[0, 0], proposed, "a", "Eq. 6"),
        (grid[0, 1], classical, "b", "classical inverse"),
    ):
        trace = _trace(next(iter(runs.values())))
        wide = {"color": REFERENCE, "lw": 2.4, "label": "reference $y_r$"}
        axes.plot(1e3 * trace.t, trace.y_r, **wide)
        for reading, run in runs.items():
            _over_time(axes, reading, run, _trace(run).y)
        title_panel(axes, letter, title)
    bound = next(case.paper_value for case in results.cases if case.label == "Fig. 8a")
    if bound is not None:
        shade = {"color": MUTED, "alpha": 0.15, "lw": 0, "label": f"paper: ±{bound:g} µm"}
        grid[1, 0].axhspan(-bound, bound, **shade)
    for reading, run in (proposed | classical).items():
        _over_time(grid[1, 0], reading, run, _trace(run).error)
        _over_time(grid[1, 1], reading, run, _trace(run).u)
    for axes, label in zip(
        grid.flat,
        ("displacement (µm)", "displacement (µm)", "error $y_r - y$ (µm)", "command $u$ (V)"),
        strict=True,
    ):
        axes.set_ylabel(label)
    for axes, letter, title in zip(grid[1], "cd", ("errors", "commands"), strict=True):
        axes.set_xlabel("time in the last period (ms)")
        title_panel(axes, letter, title)
    legend_below(figure, 5)
    return figure


def _over_time(axes: Axes, reading: str, run: Run, values: Array) -> None:
    style: dict[str, Any] = STYLES[reading] | {"lw": 1.1, "label": reading}
    axes.plot(1e3 * _trace(run).t, values, **style)
