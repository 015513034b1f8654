"""Descriptions of figures: panels, their marks and axes, from which both plotting libraries draw.

Names are plain text; labels, titles and hover texts may hold fields of the user's quantities, as
``{output_unit}``. Hover texts are written in Plotly's notation, and only pages show them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.report.style import PALETTE
from rdpi_gym.support.arrays import Array

Dash = Literal["solid", "dash", "dot", "dashdot"]
Side = Literal["x", "y"]


@dataclass(frozen=True, eq=False)
class Series:
    """A line, markers, or both."""

    # numbers or names of categories; None or NaN interrupts the line, a single number as `x` is the
    # distance of the samples, from zero on
    x: Any
    y: Any
    name: str = ""  # in the legend; without one there is no entry
    colour: str = PALETTE[0]  # of the line and the markers
    dash: Dash | None = "solid"  # None: markers alone
    width: float | None = None  # of the line (pixels)
    marker: str | None = None  # symbol, by Plotly's names; None: a line alone
    size: float = 6.0  # of the markers (pixels)
    fill: Any = None  # colours of the single markers, inside an edge of `colour`
    edge: float = 1.5  # width of the markers' edge (pixels)
    group: str | None = None  # hidden and shown together; the first of a group is in the legend
    listed: bool = True  # in the legend
    visible: bool = True  # drawn before it is chosen in the legend
    hover: str | None = None  # text beside a point; an empty one: none
    data: Any = None  # columns that the hover text takes further values from
    tagged: bool = False  # the name stands beside the hover text
    errors: tuple[Any, Any] | None = None  # lengths of error bars below and above each point
    errors_along: Side = "y"
    area: bool = False  # shaded down to zero
    texts: Sequence[str] | None = None  # above each point
    stepped: bool = False  # goes in steps, with its treads about the points


@dataclass(frozen=True, eq=False)
class Bars:
    """Bars from zero: their places along one axis, their lengths along the other.

    `colour` is one for all or one a bar; `errors` reach to either side of a bar's end, and one that
    is NaN is not drawn; `names` are what the hover text calls them as
    ``%{hovertext}``; `texts` stand in or beside the bars.
    """

    places: Any
    lengths: Any
    name: str = ""
    colour: str | Sequence[str] = PALETTE[0]
    horizontal: bool = True
    width: float | None = None
    errors: Any = None
    hover: str | None = None
    names: Sequence[str] | None = None
    texts: Sequence[str] | None = None


@dataclass(frozen=True)
class Level:
    """A straight line across a panel at one value of an axis, as a noise floor."""

    value: float
    name: str = ""
    colour: str = PALETTE[0]
    dash: Dash = "dash"
    width: float = 1.2
    along: Side = "y"


@dataclass(frozen=True)
class Bands:
    """Shaded stretches of an axis; `across`: over all panels of a figure."""

    spans: Sequence[tuple[float, float]]
    name: str = ""
    colour: str = PALETTE[0]
    opacity: float = 0.2
    along: Side = "y"
    across: bool = False


@dataclass(frozen=True)
class Note:
    """A text at a place of a panel; None: at the end of that axis."""

    x: float | str | None
    y: float | str | None
    text: str
    colour: str
    anchor: Literal["left", "center", "right"] = "left"
    shift_px: float = 0.0


Mark = Series | Bars | Level | Bands | Note


@dataclass(frozen=True)
class Axis:
    """An axis."""

    label: str = ""  # quantity and unit
    log: bool = False
    limits: tuple[float, float] | None = None  # the first may be the larger
    from_zero: bool = False
    # values and their texts, or those of decades
    ticks: tuple[Sequence[float], Sequence[str]] | Literal["decades", "1-2-5"] | None = None
    categories: Sequence[str] | None = None  # names in their order, of an axis without numbers
    reversed: bool = False  # the first category stands on top
    grid: bool = True
    powers: bool = False  # large and small numbers as powers of ten


@dataclass(frozen=True)
class Panel:
    """One panel: its marks in the order in which they are drawn, its axes, its place in the grid."""

    marks: Sequence[Mark]
    x: Axis = Axis()
    y: Axis = Axis()
    title: str = ""
    row: int = 1
    column: int = 1
    rows: int = 1
    columns: int = 1


@dataclass(frozen=True)
class Chart:
    """A figure."""

    panels: Sequence[Panel]
    height_px: int = 420  # on a page
    # parts of the rows and columns; equal ones by default
    heights: Sequence[float] | None = None
    widths: Sequence[float] | None = None
    shared: str = ""  # axes that all panels of a column ("x") or row ("y") have in common
    # between columns and rows, as parts of the figure's width and height
    gap: float = 0.11
    row_gap: float = 0.06
    legend: Literal["above", "below"] = "above"  # below: in columns


def stacked(panels: Sequence[Panel], heights: Sequence[float], height_px: int) -> Chart:
    """Return panels one below the other over one horizontal axis, whose label the last one has."""
    placed = [replace(panel, row=row) for row, panel in enumerate(panels, start=1)]
    return Chart(placed, height_px, heights=heights, shared="x")


def side_by_side(panels: Sequence[Panel], height_px: int = 420, **options: Any) -> Chart:
    """Return panels one beside the other."""
    placed = [replace(panel, column=column) for column, panel in enumerate(panels, start=1)]
    return Chart(placed, height_px, **options)


def frequency_axis(frequencies_hz: Array, label: str = "Frequency (Hz)") -> Axis:
    """Return a logarithmic axis of one decade at least: a single frequency has ticks too."""
    x = np.log10(frequencies_hz)
    margin = max(0.06, 0.5 * (1.0 - float(np.ptp(x))))
    low, high = float(x.min()) - margin, float(x.max()) + margin
    steps = (1.0, 2.0, 5.0) if high - low < 2.5 else (1.0,)
    return Axis(
        label, log=True, limits=(10.0**low, 10.0**high), ticks=decade_ticks(low, high, steps)
    )


def decade_ticks(
    low: float, high: float, steps: Sequence[float] = (1.0, 2.0, 5.0)
) -> tuple[list[float], list[str]]:
    """Return ticks at multiples of the powers of ten between two exponents, with their texts."""
    decades = 10.0 ** np.arange(np.floor(low), np.ceil(high))
    ticks = np.outer(decades, steps).ravel().tolist()
    return ticks, [f"{tick:.4g}" for tick in ticks]


def limits_of(*values: Array) -> tuple[float, float]:
    """Return the limits of an axis that shows all values, with a margin."""
    low, high = min(map(np.min, values)), max(map(np.max, values))
    margin = 0.06 * float(high - low) or 1.0
    return float(low) - margin, float(high) + margin


def single(values: Array) -> NDArray[np.float32]:
    """Return values in single precision: finer than a screen, and half the bytes on a page."""
    return np.asarray(values, dtype=np.float32)


def short_name(name: str, most: int = 34) -> str:
    """Return a name for an axis or a legend, cut where it is long."""
    return name if len(name) <= most else f"{name[: most - 1]}…"
