"""The paper's Fig. 3, 4, 5, 7 and 8 from our results, all figures of its page, and the page of results."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.paper.run import PaperResults
from benchmarks.paper.tracking import Trace, Tracking
from rdpi_gym.report.chart import Axis, Chart, Panel, Series
from rdpi_gym.report.page import Section, write_page
from rdpi_gym.report.style import INK, MUTED, PALETTE, REFERENCE, matplotlib_style
from rdpi_gym.report.traces import thin_index
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.files import write_atomic

_WIDTH_IN = 9.0
BLUE, RED, GREEN, PINK, ORANGE, SKY, GREY = PALETTE
STYLES: dict[str, dict[str, Any]] = {
    "none": {"color": REFERENCE, "ls": "-"},
    "literal": {"color": RED, "ls": "-"},
    "given": {"color": BLUE, "ls": "-"},
    "low-passed in both": {"color": SKY, "ls": (0, (5, 3))},
    "low-passed": {"color": GREEN, "ls": "-"},
    "reference-rate/A": {"color": PINK, "ls": "-"},
    "closed-form reference-rate/A": {"color": ORANGE, "ls": (0, (4, 1.5))},
    "closed-form reference-rate": {"color": GREY, "ls": (0, (4, 1.5))},
    "closed-form own-rate": {"color": INK, "ls": (0, (1, 1.2))},
}
"""Colour and line of each reading, the same in every figure."""


def _sheet(
    rows: int, columns: int, height_in: float, width_in: float = _WIDTH_IN, **options: Any
) -> tuple[Figure, Any]:
    """Return a figure and its axes, always as an array of `rows` by `columns`."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def _title_panel(axes: Axes, letter: str, title: str) -> None:
    """Title a panel at its left, with its letter if it has one."""
    axes.set_title(f"({letter})  {title}" if letter else title, loc="left")


def _legend_below(figure: Figure, columns: int) -> None:
    """Put one legend of everything labelled in the figure under its axes."""
    found: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    figure.legend(
        list(found.values()),
        list(found),
        loc="outside lower center",
        ncols=columns,
        handlelength=2.6,
    )


def _write_seconds(ts_s: float) -> str:
    """Write a sampling time for a figure: as a power of ten where it is one, else in µs."""
    exponent = np.log10(ts_s)
    if abs(exponent - round(exponent)) < 1e-6:
        return f"$T_s = 10^{{{round(exponent)}}}$ s"
    return f"$T_s$ = {1e6 * ts_s:g} µs"


def error_against_ts(results: PaperResults) -> Figure:
    """Draw largest and RMS error of every reading over the sampling time, with slope guides.

    Lines are medians of the realisations, shades their whole range. The reading whose error is
    rounding is left out.
    """
    figure, grid = _sheet(1, 2, 5.2, sharex=True, sharey=True)
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
        _title_panel(axes, "", f"{title}, 50 Hz, amplitude 10")
    grid[0, 0].set_ylabel("error over the last period")
    _legend_below(figure, 3)
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
    figure, grid = _sheet(1, 2, 4.2, sharex=True, sharey=True)
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
        _title_panel(axes, "", title)
    grid[0, 0].set_ylabel("growth of a disturbance\nin a sample, all plays sliding")
    _legend_below(figure, 4)
    return figure


def irreproducible(results: PaperResults) -> Figure:
    """Draw the difference of two commands whose references differ by a relative 1e-15."""
    figure, grid = _sheet(1, 1, 3.6)
    axes = grid[0, 0]
    for x in results.divergences:
        # differences of zero have no place on a logarithmic axis
        parted = np.where(x.command_V == 0.0, np.nan, np.abs(x.command_V))
        style = STYLES[x.reading.name] | {"lw": 1.1}
        axes.semilogy(1e3 * x.t_s, parted, label=x.reading.name, **style)
    axes.set(xlabel="time (ms)", ylabel="difference of the commands (V)", ylim=(1e-17, 30.0))
    _title_panel(axes, "", "A reference changed by a relative $10^{-15}$: 50 Hz, $T_s = 10^{-4}$ s")
    _legend_below(figure, 4)
    return figure


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


def _trace(run: Tracking) -> Trace:
    assert run.trace is not None, "the figures are given runs with their traces"
    return run.trace


def _closed(values: Array) -> Array:
    """Return a period with its first sample again at the end, so that a loop closes."""
    return np.append(values, values[0])


def _runs(results: PaperResults, label: str, reading: str) -> list[Tracking]:
    return [
        run
        for case, run in zip(results.cases, results.runs, strict=True)
        if case.label == label and case.reading.name == reading
    ]


def figure_3(results: PaperResults) -> Figure:
    """Draw loops without compensation and the error at three sampling times, for two readings."""
    figure, grid = _sheet(3, 3, 7.4)
    for column, (loop, panel) in enumerate(zip("abc", "def", strict=True)):
        (bare,) = _runs(results, f"Fig. 3{loop}", "none")
        axes = grid[0, column]
        axes.plot(_TICKS, _TICKS, color=REFERENCE, lw=0.8, ls=":")
        axes.plot(_closed(_trace(bare).u), _closed(_trace(bare).y), color=INK)
        axes.set(xlabel="command $u = y_r$", xticks=_TICKS)
        _title_panel(axes, loop, f"{bare.sine.frequency_hz:g} Hz, no compensation")
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
                label = _write_seconds(run.sine.ts_s)
                axes.plot(1e3 * trace.t[k], trace.error[k], color=colour, lw=0.9, label=label)
            _title_panel(axes, f"{panel}{mark}", f"{bare.sine.frequency_hz:g} Hz, {reading}")
    grid[0, 0].set_ylabel("output $y$")
    for axes in grid[1:, 0]:
        axes.set_ylabel("error $e = y_r - y$")
    _legend_below(figure, 3)
    return figure


def _maps(results: PaperResults, labels: tuple[str, ...], height_in: float) -> Figure:
    """Draw output (above) and error (below) against the reference, one panel a column."""
    figure, grid = _sheet(2, len(labels), height_in, sharex=True)
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
        title = f"{run.sine.frequency_hz:g} Hz, {_write_seconds(run.sine.ts_s)}"
        _title_panel(above, label[-1], title)
        above.set_yticks(_TICKS)
        below.set(xlabel="reference $y_r$", xticks=_TICKS)
    grid[0, 0].set_ylabel("output $y$")
    grid[1, 0].set_ylabel("error $e = y_r - y$")
    _legend_below(figure, 3)
    return figure


def figure_4(results: PaperResults) -> Figure:
    """Draw output and error against the reference at 50 Hz and two sampling times."""
    return _maps(results, ("Fig. 4a", "Fig. 4b"), 6.2)


def figure_5(results: PaperResults) -> Figure:
    """Draw output and error against the reference at the smallest sampling time."""
    return _maps(results, ("Fig. 5a", "Fig. 5b", "Fig. 5c"), 5.6)


def figure_7(results: PaperResults) -> Figure:
    """Draw the loops of the identified model at two frequencies."""
    figure, grid = _sheet(1, 1, 4.6, width_in=6.0)
    axes = grid[0, 0]
    for run, colour in zip(_runs(results, "Fig. 7", "none"), (BLUE, RED), strict=True):
        trace = _trace(run)
        label = f"{run.sine.frequency_hz:g} Hz, {len(trace.t)} samples"
        axes.plot(_closed(trace.u), _closed(trace.y), color=colour, label=label)
    axes.set(xlabel="command $u$ (V)", ylabel="displacement $y$ (µm)")
    axes.legend(loc="upper left")
    _title_panel(axes, "", "Loops of the model of Section IV-B")
    return figure


def figure_8(results: PaperResults) -> Figure:
    """Draw 80 Hz: output of both methods, errors beside the paper's bound, commands."""
    figure, grid = _sheet(2, 2, 6.6, sharex=True)
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
        _title_panel(axes, letter, title)
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
        _title_panel(axes, letter, title)
    _legend_below(figure, 5)
    return figure


def _over_time(axes: Axes, reading: str, run: Tracking, values: Array) -> None:
    style: dict[str, Any] = STYLES[reading] | {"lw": 1.1, "label": reading}
    axes.plot(1e3 * _trace(run).t, values, **style)


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
                STYLES.get(reading, {"color": GREY})["color"], hover="%{x:.3g} s: %{y:.3g} %", tagged=True,
            )
        )  # fmt: skip
    axes = Axis("Sampling time (s)", log=True), Axis("Largest error (% of the amplitude)", log=True)
    return Chart([Panel(lines, *axes)], 480)
