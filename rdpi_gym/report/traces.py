"""Charts of one record beside models of it, over time and as loops over the command, and the samples drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.diagnosis import Trace
from rdpi_gym.report.chart import (
    Axis,
    Bands,
    Chart,
    Dash,
    Mark,
    Panel,
    Series,
    limits_of,
    side_by_side,
    single,
    stacked,
)
from rdpi_gym.report.style import FALLING, MEASURED, MODEL, PALETTE, RESIDUAL, RISING
from rdpi_gym.support.arrays import Array

DISPLAY_SAMPLES = 3000
"""Samples of one trace that a page is given: more than any screen has columns."""


def thin_index(*traces: Array, samples: int = DISPLAY_SAMPLES) -> NDArray[np.intp]:
    """Choose the samples of traces that are worth drawing.

    The record is cut into stretches of equal length; of each, the samples where a trace is lowest
    and highest are kept, so that no peak is lost, and the first and the last of all.
    """
    total = traces[0].shape[0]
    if total <= samples:
        return np.arange(total)
    stretches = max(1, samples // (2 * len(traces)))
    edges = np.linspace(0, total, stretches + 1).astype(np.intp)
    length = int(np.max(np.diff(edges)))
    # each stretch is a row; rows that are one sample shorter repeat their last sample
    rows = np.minimum(edges[:-1, None] + np.arange(length), edges[1:, None] - 1)
    chosen = [np.array([0, total - 1], dtype=np.intp)]
    for trace in traces:
        values = np.asarray(trace, dtype=np.float64)[rows]
        low = np.argmin(np.where(np.isnan(values), np.inf, values), axis=1)
        high = np.argmax(np.where(np.isnan(values), -np.inf, values), axis=1)
        row = np.arange(stretches)
        chosen += [rows[row, low], rows[row, high]]
    return np.unique(np.concatenate(chosen))


def around_largest_error(
    trace: Trace, samples: int = DISPLAY_SAMPLES, *others: Array
) -> NDArray[np.intp]:
    """Choose the samples of the half-cycle of the largest error, and of those beside it.

    Thinned so that no peak of the others is lost either.
    """
    error = np.where(trace.counted, np.abs(trace.residual_um), -1.0)
    worst = int(np.argmax(error))
    edges = trace.cycles.edges
    at = int(np.searchsorted(edges, worst, side="right")) - 1
    around = np.arange(edges[max(0, at - 1)], edges[min(edges.size - 1, at + 2)])
    kept = [values[around] for values in (trace.measured_um, trace.residual_um, *others)]
    thinned = thin_index(*kept, samples=samples)
    return around[thinned]


TIME = Axis("Time (s)")
COMMAND = Axis("Command ({input_unit})")
DISPLACEMENT_UM = "{Output} ({output_unit})"
DIFFERENCE_UM = "Measured − model ({output_unit})"
FLOOR = PALETTE[2]
"""Colour of the noise floor."""
_LOOP_SAMPLES = 120
_LEFT_OUT = "#9AA3AB"
_R = TypeVar("_R")
Index = NDArray[np.intp]
"""Samples that are drawn; -1 interrupts the line."""


@dataclass(frozen=True, eq=False)
class Overlay:
    """A model of a record as it is drawn beside the measurement."""

    name: str  # in the legend
    trace: Trace  # the record, and the model's displacement
    colour: str = MODEL  # of the displacement, and of a residual without an own name
    visible: bool = True  # drawn before it is chosen in the legend
    residual: str = ""  # name of the residual in the legend, where it has an own entry and colour


def one_model(trace: Trace) -> tuple[Overlay]:
    """Return a record's only model, its residual in the colour of residuals."""
    return (Overlay("model", trace, residual="measured − model"),)


def rms_um(trace: Trace) -> float:
    """RMS error of a record over the samples that count (µm); 0 where none does."""
    error = trace.residual_um[trace.counted]
    return float(np.sqrt(np.mean(error**2))) if error.size else 0.0


def peak_um(trace: Trace) -> float:
    """Largest error of a record over the samples that count (µm); 0 where none does."""
    return float(np.max(np.abs(trace.residual_um[trace.counted]), initial=0.0))


def worst_first(
    records: Mapping[str, _R], error_um: Callable[[_R], float], most: int | None = None
) -> dict[str, _R]:
    """Sort records by name so that a page opens on the one with the largest error."""
    order = sorted(records, key=lambda name: -error_um(records[name]))
    return {name: records[name] for name in order[:most]}


def displacement_panel(
    overlays: Sequence[Overlay],
    k: Index,
    x: Axis = TIME,
    *,
    dash: Dash = "solid",
    width: float | None = None,
) -> Panel:
    """Return measured and modelled displacement over time, or over the command, at some samples."""
    first = overlays[0].trace
    at = _abscissa(first, k, x)
    marks: list[Mark] = [Series(at, gapped(first.measured_um, k), "measured", MEASURED)]
    marks += [
        Series(
            at, gapped(each.trace.model_um, k), each.name, each.colour, dash, width,
            group=None if each.residual else each.name, visible=each.visible,
        )
        for each in overlays
    ]  # fmt: skip
    return Panel(marks, x, Axis(DISPLACEMENT_UM))


def residual_panel(
    overlays: Sequence[Overlay],
    k: Index,
    x: Axis = TIME,
    *,
    masked: bool = False,
    settled: bool = False,
    noise_um: float | None = None,
    label: str = DIFFERENCE_UM,
) -> Panel:
    """Return measured minus model of each, and the noise floor as a band; limits fit what counts.

    `masked`: samples left out of the error interrupt the line. `settled`: the stretch before the
    first reversal is drawn, but does not set the scale.
    """
    first = overlays[0].trace
    at = _abscissa(first, k, x)
    marks: list[Mark] = []
    for each in overlays:
        residual = each.trace.residual_um
        if masked:
            residual = np.where(each.trace.counted, residual, np.nan)
        marks.append(
            Series(
                at, gapped(residual, k), each.residual or each.name, RESIDUAL if each.residual else each.colour,
                width=1.0, group=None if each.residual else each.name, listed=bool(each.residual),
                visible=each.visible,
            )
        )  # fmt: skip
    noise = [] if noise_um is None else [np.array([-noise_um, noise_um])]
    if noise_um is not None:
        marks.append(noise_band(noise_um))
    known = _scaling(first, k, settled)
    shown = [each.trace.residual_um[known] for each in overlays if each.visible]
    limits = limits_of(*shown, *noise) if known.size else None
    return Panel(marks, x, Axis(label, limits=limits))


def over_time(
    overlays: Sequence[Overlay],
    k: Index,
    *,
    left_out: bool,
    dash: Dash = "solid",
    heights: tuple[float, float] = (0.55, 0.45),
    height_px: int = 600,
    **residual: Any,
) -> Chart:
    """Draw displacement over time and below it the residual; shade what is left out of the error."""
    first = overlays[0].trace
    above = displacement_panel(overlays, k, dash=dash)
    known = _scaling(first, k)
    shown = [each.trace.model_um[known] for each in overlays if each.visible]
    above = replace(
        above,
        x=Axis(),
        y=Axis(DISPLACEMENT_UM, limits=limits_of(first.measured_um[known], *shown)),
        marks=[*above.marks, _left_out(first)] if left_out else above.marks,
    )
    return stacked([above, residual_panel(overlays, k, **residual)], heights, height_px)


def loops(
    overlays: Sequence[Overlay],
    samples: int = 2 * DISPLAY_SAMPLES,
    *,
    title: str = "Residual along the loops",
    height_px: int = 480,
    **residual: Any,
) -> Chart:
    """Draw displacement over the command, and beside it the residual; of one model by direction."""
    first = overlays[0].trace
    k = loop_index(first, samples)
    right = residual_panel(overlays, k, COMMAND, **residual)
    if overlays[0].residual:
        u, rising = gapped(first.u_V, k), first.cycles.by_sample(first.cycles.rising)
        marks = [
            Series(
                u,
                gapped(np.where(of & first.counted, first.residual_um, np.nan), k),
                name,
                colour,
                width=1.0,
            )
            for name, colour, of in (("rising", RISING, rising), ("falling", FALLING, ~rising))
        ]
        right = replace(right, marks=marks)
    left = displacement_panel(overlays, k, COMMAND, width=1.0)
    return side_by_side([replace(left, title="Loops"), replace(right, title=title)], height_px)


def noise_band(noise_um: float, listed: bool = True) -> Bands:
    """Return what the noise alone may reach: the floor to either side of zero."""
    return Bands([(-noise_um, noise_um)], "noise floor (± rms)" if listed else "", FLOOR, 0.16)


def _left_out(trace: Trace) -> Bands:
    change = np.flatnonzero(np.diff(trace.counted.astype(np.int8))) + 1
    edges = np.concatenate([[0], change, [trace.counted.size]])
    runs = [(first, last) for first, last in pairwise(edges.tolist()) if not trace.counted[first]]
    spans = [(float(trace.t_s[first]), float(trace.t_s[last - 1])) for first, last in runs]
    return Bands(spans, "left out of the error", _LEFT_OUT, 0.22, "x", across=True)


def _abscissa(trace: Trace, k: Index, x: Axis) -> Any:
    at: Array = trace.t_s[k]
    return gapped(trace.u_V, k) if x is COMMAND else at


def _scaling(trace: Trace, k: Index, settled: bool = False) -> Index:
    """Return the samples that set the scale of an axis: those that count, where any does."""
    edges = trace.cycles.edges
    k = k[k >= (edges[1] if settled and edges.size > 3 else 0)]
    return k[trace.counted[k]] if trace.counted[k].any() else k


def loop_index(trace: Trace, samples: int) -> Index:
    """Choose whole loops, evenly over the record, until `samples` are used."""
    reversals: list[int] = [0, *(trace.cycles.edges[1:] - 1).tolist()]
    loops = [
        (first, last)
        for first, last in zip(reversals[:-1:2], [*reversals[2::2], reversals[-1]], strict=False)
        if trace.counted[first : last + 1].any()
    ]
    most = max(1, samples // _LOOP_SAMPLES)
    if len(loops) > most:
        loops = [loops[i] for i in np.linspace(0, len(loops) - 1, most).astype(np.intp)]
    pieces = []
    for first, last in loops:
        count = min(last - first + 1, samples // len(loops))
        piece = np.linspace(first, last, count).astype(np.intp)
        pieces += [piece[trace.counted[piece]], np.array([-1], dtype=np.intp)]
    return np.concatenate(pieces)


def gapped(values: Array, k: Index) -> NDArray[np.float32]:
    """Choose samples for drawing; an index of -1 interrupts the line."""
    return single(np.where(k < 0, np.nan, values[k]))
