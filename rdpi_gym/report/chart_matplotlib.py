"""Charts drawn by Matplotlib, for notebooks and files."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from rdpi_gym.report.chart import Axis, Bands, Bars, Chart, Level, Mark, Note, Series
from rdpi_gym.report.style import INK, MUTED, matplotlib_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Write = Callable[[str], str]
_DASHES = {"solid": "-", "dash": "--", "dot": ":", "dashdot": "-."}
_MARKERS = {
    "circle": "o", "square": "s", "diamond": "D", "triangle-up": "^", "x": "x", "line-ns-open": "|",
}  # fmt: skip
_POINTS = 0.75
"""Points in a pixel, of widths and of markers."""


def draw_chart(figure: Figure, chart: Chart, write: Write = str) -> Any:
    """Draw a chart into an empty figure; `write` fills in the user's quantities.

    Returns
    -------
    matplotlib.axes.Axes, or an array of them
    """
    panels = chart.panels
    rows = max(panel.row + panel.rows - 1 for panel in panels)
    columns = max(panel.column + panel.columns - 1 for panel in panels)
    grid = figure.add_gridspec(
        rows, columns, height_ratios=chart.heights, width_ratios=chart.widths
    )
    drawn: dict[tuple[int, int], Axes] = {}
    for panel in panels:
        above = drawn.get((1, panel.column)) if "x" in chart.shared else None
        left = drawn.get((panel.row, 1)) if "y" in chart.shared else None
        axes = figure.add_subplot(
            grid[
                panel.row - 1 : panel.row - 1 + panel.rows,
                panel.column - 1 : panel.column - 1 + panel.columns,
            ],
            sharex=above,
            sharey=left,
        )
        drawn[panel.row, panel.column] = axes
        _set_axis(axes, "x", panel.x, write)
        _set_axis(axes, "y", panel.y, write)
        for mark in panel.marks:
            _DRAW[type(mark)](axes, mark, write)
        if panel.x.from_zero:
            axes.set_xlim(left=0.0)
        if panel.y.from_zero:
            axes.set_ylim(bottom=0.0)
        if any(isinstance(mark, Bands) and mark.across for mark in panel.marks):
            axes.set_xlim(axes.dataLim.intervalx)
        if panel.title:
            axes.set_title(write(panel.title), loc="left", parse_math=False)
        axes.tick_params(
            labelleft=left is None,
            labelbottom="x" not in chart.shared or panel.row + panel.rows > rows,
        )
    _add_legend(figure, chart)
    axes_of = list(drawn.values())
    return axes_of[0] if len(axes_of) == 1 else np.array(axes_of)


def chart_png(
    chart: Chart, inches: tuple[float, float], dpi: int = 160, write: Write = str
) -> bytes:
    """Draw a chart as a PNG file; the same chart gives the same bytes."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    style: Any = matplotlib_style()
    with rc_context(style):
        figure = Figure(figsize=inches, layout="constrained")
        draw_chart(figure, chart, write)
        stream = io.BytesIO()
        figure.savefig(stream, format="png", dpi=dpi, metadata={"Software": None})
    return stream.getvalue()


def _set_axis(axes: Axes, side: str, axis: Axis, write: Write) -> None:
    from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter, StrMethodFormatter

    own = axes.xaxis if side == "x" else axes.yaxis
    set_limits: Any = axes.set_xlim if side == "x" else axes.set_ylim
    if axis.label:
        own.set_label_text(write(axis.label))
    if axis.log:
        (axes.set_xscale if side == "x" else axes.set_yscale)("log", nonpositive="clip")
        if axis.ticks == "1-2-5":
            own.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            own.set_major_formatter(StrMethodFormatter("{x:g}"))
        own.set_minor_formatter(NullFormatter())
    elif axis.powers:
        own.set_major_formatter(EngFormatter())
    if axis.categories is not None:
        own.set_ticks(range(len(axis.categories)), list(axis.categories), parse_math=False)
        count = len(axis.categories)
        set_limits(*((count - 0.4, -0.6) if axis.reversed else (-0.5, count - 0.5)))
    if isinstance(axis.ticks, tuple):
        own.set_ticks(axis.ticks[0], list(axis.ticks[1]), minor=False, parse_math=False)
    if axis.limits is not None:
        set_limits(*axis.limits)
    if not axis.grid:
        axes.grid(visible=False, axis="x" if side == "x" else "y")


def _places(axes: Axes, side: str, values: Any) -> Any:
    """Return numbers as they are, and names of categories as their places on an axis."""
    own = axes.xaxis if side == "x" else axes.yaxis
    names = {label.get_text(): i for i, label in enumerate(own.get_ticklabels())}
    if isinstance(values, str):
        return names[values]
    if isinstance(values, list | tuple):
        return [np.nan if v is None else names[v] if isinstance(v, str) else v for v in values]
    return np.asarray(values)


def _draw_series(axes: Axes, mark: Series, write: Write) -> None:
    if not mark.visible:
        return
    y = _places(axes, "y", mark.y)
    x = mark.x * np.arange(len(y)) if isinstance(mark.x, float) else _places(axes, "x", mark.x)
    label = write(mark.name) if mark.name and mark.listed else None
    symbol = (mark.marker or "").removesuffix("-open")
    is_open = symbol != mark.marker and mark.marker != "line-ns-open"
    colour: Any = mark.colour
    axes.plot(
        x,
        y,
        color=colour,
        linestyle=_DASHES[mark.dash] if mark.dash else "",
        linewidth=_POINTS * (1.6 if mark.width is None else mark.width),
        marker=_MARKERS.get(mark.marker or "", _MARKERS.get(symbol)) if mark.fill is None else None,
        markersize=_POINTS * mark.size * (1.6 if mark.marker == "line-ns-open" else 1.0),
        zorder=2 if mark.dash else 4,
        markerfacecolor="none" if is_open else colour,
        markeredgewidth=1.8 if mark.marker == "line-ns-open" else 1.0,
        drawstyle="steps-mid" if mark.stepped else "default",
        label=label if mark.fill is None or mark.dash else None,
    )
    if mark.fill is not None:
        alone = label if not mark.dash else None
        axes.scatter(
            x, y, s=(_POINTS * mark.size) ** 2, c=mark.fill, edgecolors=colour, zorder=3, label=alone,
            linewidths=_POINTS * mark.edge,
        )  # fmt: skip
    if mark.errors is not None:
        lengths: Any = {f"{mark.errors_along}err": np.array(mark.errors)}
        ink = MUTED if mark.dash is None else colour
        axes.errorbar(x, y, **lengths, fmt="none", ecolor=ink, elinewidth=0.9)
    if mark.area:
        axes.fill_between(x, y, color=colour, alpha=0.15, linewidth=0)
    for at, height, text in zip(x, y, mark.texts or (), strict=False):
        axes.annotate(
            text, (at, height), (0, 4), textcoords="offset points", ha="center", color=colour,
            fontsize=8,
        )  # fmt: skip


def _draw_bars(axes: Axes, mark: Bars, write: Write) -> None:
    lengths: Any = np.asarray(mark.lengths, dtype=np.float64)
    side, draw = ("y", axes.barh) if mark.horizontal else ("x", axes.bar)
    places, width = _places(axes, side, mark.places), mark.width or 0.75
    draw(places, lengths, width, color=mark.colour, label=write(mark.name) if mark.name else None)
    if mark.errors is not None:
        x, y, along = (lengths, places, "x") if mark.horizontal else (places, lengths, "y")
        reach: Any = {f"{along}err": mark.errors}
        axes.errorbar(x, y, **reach, fmt="none", ecolor=INK, capsize=3)


def _draw_level(axes: Axes, mark: Level, write: Write) -> None:
    style: Any = {
        "color": mark.colour, "linestyle": _DASHES[mark.dash], "linewidth": _POINTS * mark.width,
        "label": write(mark.name) if mark.name else None,
    }  # fmt: skip
    if np.isfinite(mark.value):
        (axes.axhline if mark.along == "y" else axes.axvline)(mark.value, **style)


def _draw_bands(axes: Axes, mark: Bands, write: Write) -> None:
    across = axes.axhspan if mark.along == "y" else axes.axvspan
    for i, (low, high) in enumerate(mark.spans):
        label = write(mark.name) if mark.name and i == 0 else None
        across(low, high, color=mark.colour, alpha=mark.opacity, linewidth=0, label=label)


def _draw_note(axes: Axes, mark: Note, write: Write) -> None:
    from matplotlib.transforms import blended_transform_factory

    at_x = 0.98 if mark.x is None else _places(axes, "x", mark.x)
    at_y = 0.98 if mark.y is None else _places(axes, "y", mark.y)
    place: Any = blended_transform_factory(
        axes.transAxes if mark.x is None else axes.transData,
        axes.transAxes if mark.y is None else axes.transData,
    )
    axes.annotate(
        write(mark.text), (at_x, at_y), (0, _POINTS * mark.shift_px), xycoords=place,
        textcoords="offset points", ha=mark.anchor, va="center", fontsize=8, color=mark.colour,
        parse_math=False,
    )  # fmt: skip


def _add_legend(figure: Figure, chart: Chart) -> None:
    """Put one legend of everything that has a name beside the panels."""
    handles: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    if len(handles) > 1:
        place: Any = "outside upper left" if chart.legend == "above" else "outside lower center"
        most = max(1, int(figure.get_size_inches()[0] // 2.2))
        legend = figure.legend(
            list(handles.values()), list(handles), loc=place, ncols=min(most, len(handles))
        )
        for text in legend.get_texts():
            text.set_parse_math(False)


_DRAW: dict[type[Mark], Callable[[Any, Any, Write], None]] = {
    Series: _draw_series,
    Bars: _draw_bars,
    Level: _draw_level,
    Bands: _draw_bands,
    Note: _draw_note,
}
