"""Figures of one record beside its model: over time, and as loops over the command."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from rdpi_gym.diagnosis import Trace
from rdpi_gym.report.style import FALLING, MEASURED, MODEL, RESIDUAL, RISING, styled
from rdpi_gym.report.thin import DISPLAY_SAMPLES, around_largest_error, thin_index
from rdpi_gym.support.arrays import Array

DISPLACEMENT_UM = "{Output} ({output_unit})"
_LOOP_SAMPLES = 120
_LEFT_OUT = "#9AA3AB"
_Shown = TypeVar("_Shown")


def rms_um(trace: Trace) -> float:
    """RMS error of a record over the samples that count (µm); 0 where none does."""
    error = trace.residual_um[trace.counted]
    return float(np.sqrt(np.mean(error**2))) if error.size else 0.0


def peak_um(trace: Trace) -> float:
    """Largest error of a record over the samples that count (µm); 0 where none does."""
    return float(np.max(np.abs(trace.residual_um[trace.counted]), initial=0.0))


def worst_first(
    records: Mapping[str, _Shown], error_um: Callable[[_Shown], float], most: int | None = None
) -> dict[str, _Shown]:
    """Sort records by name so that a page opens on the one with the largest error."""
    order = sorted(records, key=lambda name: -error_um(records[name]))
    return {name: records[name] for name in order[:most]}


def time_traces(trace: Trace, samples: int = DISPLAY_SAMPLES) -> Any:
    """Draw measured and modelled displacement over time, and below them what they differ by."""
    k = thin_index(trace.measured_um, trace.model_um, trace.residual_um, samples=samples)
    return _over_time(trace, k, left_out=True)


def largest_error(trace: Trace, samples: int = DISPLAY_SAMPLES) -> Any:
    """Draw the half-cycle of the largest error that counts, and those before and after it."""
    return _over_time(trace, around_largest_error(trace, samples), left_out=False)


def _over_time(trace: Trace, k: NDArray[np.intp], left_out: bool) -> Any:
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, row_heights=[0.62, 0.38], vertical_spacing=0.06
    )
    t = trace.t_s[k]
    figure.add_scatter(
        x=t, y=trace.measured_um[k], name="measured", line_color=MEASURED, row=1, col=1
    )
    figure.add_scatter(
        x=t, y=trace.model_um[k], name="model", line={"color": MODEL, "dash": "dot"}, row=1, col=1
    )
    figure.add_scatter(
        x=t,
        y=trace.residual_um[k],
        name="measured − model",
        line={"color": RESIDUAL, "width": 1},
        row=2,
        col=1,
    )
    if left_out:
        shade_left_out(figure, trace)
    shown = k[trace.counted[k]] if trace.counted[k].any() else k
    both = np.concatenate([trace.measured_um[shown], trace.model_um[shown]])
    figure.update_yaxes(title_text=DISPLACEMENT_UM, range=axis_range(both), row=1, col=1)
    figure.update_yaxes(
        title_text="Difference ({output_unit})",
        range=axis_range(trace.residual_um[shown]),
        row=2,
        col=1,
    )
    figure.update_xaxes(title_text="Time (s)", row=2, col=1)
    return styled(figure, 520)


def shade_left_out(figure: Any, trace: Trace) -> None:
    """Shade what is left out of the error."""
    change = np.flatnonzero(np.diff(trace.counted.astype(np.int8))) + 1
    edges = np.concatenate([[0], change, [trace.counted.size]])
    runs = [(first, last) for first, last in pairwise(edges.tolist()) if not trace.counted[first]]
    figure.update_layout(
        shapes=[
            *figure.layout.shapes,
            *(
                {
                    "type": "rect",
                    "xref": "x",
                    "yref": "paper",
                    "x0": trace.t_s[first],
                    "x1": trace.t_s[last - 1],
                    "y0": 0,
                    "y1": 1,
                    "fillcolor": _LEFT_OUT,
                    "opacity": 0.22,
                    "line_width": 0,
                    "layer": "below",
                }
                for first, last in runs
            ),
        ]
    )
    if runs:
        figure.add_scatter(
            x=[None],
            y=[None],
            mode="markers",
            name="left out of the error",
            marker={"symbol": "square", "size": 11, "color": _LEFT_OUT, "opacity": 0.4},
        )


def loops(trace: Trace, samples: int = 2 * DISPLAY_SAMPLES) -> Any:
    """Draw displacement over command, and beside it the residual, rising and falling apart."""
    k = loop_index(trace, samples)
    u = gapped(trace.u_V, k)
    figure = make_subplots(
        rows=1,
        cols=2,
        horizontal_spacing=0.11,
        subplot_titles=["Loops", "Residual along the loops"],
    )
    figure.add_scatter(
        x=u, y=gapped(trace.measured_um, k), name="measured", line_color=MEASURED, row=1, col=1
    )
    figure.add_scatter(
        x=u,
        y=gapped(trace.model_um, k),
        name="model",
        line={"color": MODEL, "width": 1},
        row=1,
        col=1,
    )
    rising = trace.cycles.by_sample(trace.cycles.rising)
    for name, colour, of in (("rising", RISING, rising), ("falling", FALLING, ~rising)):
        residual = np.where(of & trace.counted, trace.residual_um, np.nan)
        figure.add_scatter(
            x=u, y=gapped(residual, k), name=name, line={"color": colour, "width": 1}, row=1, col=2
        )
    figure.update_xaxes(title_text="Command ({input_unit})")
    figure.update_yaxes(title_text=DISPLACEMENT_UM, row=1, col=1)
    # the stretch before the first reversal is drawn, but does not set the scale
    known = k[k >= trace.cycles.edges[1]] if trace.cycles.edges.size > 3 else k[k >= 0]
    limits = axis_range(trace.residual_um[known]) if known.size else None
    figure.update_yaxes(title_text="Measured − model ({output_unit})", range=limits, row=1, col=2)
    return styled(figure, 480)


def loop_index(trace: Trace, samples: int) -> NDArray[np.intp]:
    """Choose whole loops, evenly over the record, until `samples` are used; -1 lifts the pen."""
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


def gapped(values: Array, k: NDArray[np.intp]) -> NDArray[np.float32]:
    """Choose samples for drawing; an index of -1 lifts the pen."""
    # seven digits are more than a screen shows, and half the bytes on the page
    return np.where(k < 0, np.nan, values[k]).astype(np.float32)


def axis_range(values: Array) -> list[float]:
    """Return the limits of an axis that shows all values, with a margin."""
    low, high = float(np.min(values)), float(np.max(values))
    margin = 0.06 * (high - low) or 1.0
    return [low - margin, high + margin]
