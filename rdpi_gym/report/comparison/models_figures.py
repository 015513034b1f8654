"""Figures of several models beside one measurement: one colour a model throughout the page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from rdpi_gym.diagnosis import FEW_HALF_CYCLES, ModelComparison, Trace
from rdpi_gym.report.comparison.figures import frequency_axis, short_name
from rdpi_gym.report.style import INK, MEASURED, PALETTE, PAPER, figure_text, styled
from rdpi_gym.report.thin import around_largest_error, thin_index
from rdpi_gym.report.trace_figures import (
    DISPLACEMENT_UM,
    axis_range,
    gapped,
    loop_index,
    rms_um,
    shade_left_out,
)
from rdpi_gym.support.arrays import Array

RMS_UM = "RMS error ({output_unit})"
_FLOOR = {"color": INK, "dash": "dash", "width": 1.2}
# Loops of three models and a measurement that can still be followed, in samples.
_LOOPS = 1000


def colours(names: tuple[str, ...]) -> dict[str, str]:
    """Give each model its colour."""
    return dict(zip(names, PALETTE, strict=False))


def errors(found: ModelComparison, most: int) -> Any:
    """Draw the RMS error of every record and role, a bar a model; returns a Plotly figure."""
    table = found.records
    count = len(found.comparisons[0].records)
    records, pooled = table.iloc[:count], table.iloc[count:]
    least = records[list(found.names)].min(axis=1)
    records = records.loc[sorted(least.nlargest(most).index)]
    table = pd.concat([pooled, records])
    places = np.arange(1, len(table) + 1)
    width = 0.8 / len(found.names)
    figure = go.Figure()
    for i, (name, colour) in enumerate(colours(found.names).items()):
        figure.add_bar(
            x=table[name].to_numpy(),
            y=places - 0.4 + (i + 0.5) * width,
            orientation="h",
            width=0.9 * width,
            name=short_name(name),
            marker_color=colour,
            hovertext=[figure_text(str(record)) for record in table["record"]],
            hovertemplate=f"{figure_text(name)}<br>%{{hovertext}}: %{{x:.4g}} {{output_unit}}<extra></extra>",
        )
    figure.add_vline(x=found.noise_floor_um, line=_FLOOR)
    figure.add_scatter(x=[None], y=[None], mode="lines", name="noise floor", line=_FLOOR)
    figure.update_yaxes(
        range=[len(table) + 0.6, 0.4],
        showgrid=False,
        tickvals=places,
        ticktext=[
            short_name(f"{record}" if record in set(pooled["record"]) else f"{record} ({role})")
            for record, role in zip(table["record"], table["role"], strict=True)
        ],
    )
    figure.update_xaxes(title_text=RMS_UM, rangemode="tozero")
    bar_px = max(26, 9 * len(found.names))
    return styled(figure, round(120 + bar_px * len(table)))


def error_by_frequency(found: ModelComparison) -> Any:
    """Draw each model's error over the frequency of the command; returns a Plotly figure."""
    figure = _by(found, found.by_frequency, "frequency_hz", "Hz")
    figure.update_xaxes(title_text="Frequency (Hz)")
    return frequency_axis(figure, found.by_frequency["frequency_hz"].to_numpy())


def error_by_amplitude(found: ModelComparison) -> Any:
    """Draw each model's error over the amplitude of the command; returns a Plotly figure."""
    figure = _by(found, found.by_amplitude, "amplitude_V", "{input_unit}")
    return figure.update_xaxes(
        title_text="Amplitude of the command ({input_unit})", rangemode="tozero"
    )


def _by(found: ModelComparison, table: pd.DataFrame, column: str, unit: str) -> Any:
    figure = go.Figure()
    x = table[column].to_numpy()
    few = table["half_cycles"] < FEW_HALF_CYCLES
    for name, colour in colours(found.names).items():
        figure.add_scatter(
            x=x,
            y=table[name].to_numpy(),
            name=short_name(name),
            mode="lines+markers",
            line={"color": colour, "width": 1.2},
            marker={
                "size": 8,
                "color": np.where(few, PAPER, colour),
                "line": {"color": colour, "width": 1.5},
            },
            hovertemplate=f"{figure_text(name)}<br>%{{x:.4g}} {unit}: %{{y:.4g}} {{output_unit}}<extra></extra>",
        )
    figure.add_hline(y=found.noise_floor_um, line=_FLOOR)
    figure.add_scatter(x=[None], y=[None], mode="lines", name="noise floor", line=_FLOOR)
    figure.update_yaxes(title_text=RMS_UM, rangemode="tozero")
    return styled(figure, 400)


def time_traces(traces: Mapping[str, Trace], samples: int) -> Any:
    """Draw a record and every model of it over time, and below them what they differ by.

    The two panels share their axis of time, and a model's two lines their entry in the legend.
    """
    first = next(iter(traces.values()))
    residuals = [trace.residual_um for trace in traces.values()]
    return _over_time(traces, thin_index(first.measured_um, *residuals, samples=samples), True)


def largest_error(traces: Mapping[str, Trace], samples: int) -> Any:
    """Draw the same about the largest error of the model that is nearest on the record."""
    return _over_time(
        traces, around_largest_error(min(traces.values(), key=rms_um), samples), False
    )


def _over_time(traces: Mapping[str, Trace], k: NDArray[np.intp], left_out: bool) -> Any:
    first = next(iter(traces.values()))
    residuals = [trace.residual_um for trace in traces.values()]
    t = first.t_s[k]
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, row_heights=[0.55, 0.45], vertical_spacing=0.06
    )
    figure.add_scatter(
        x=t, y=_short(first.measured_um[k]), name="measured", line_color=MEASURED, row=1, col=1
    )
    for (name, trace), colour in zip(traces.items(), PALETTE, strict=False):
        group = {
            "name": short_name(name),
            "legendgroup": name,
            "line": {"color": colour, "width": 1.1},
        }
        figure.add_scatter(x=t, y=_short(trace.model_um[k]), row=1, col=1, **group)
        figure.add_scatter(
            x=t, y=_short(trace.residual_um[k]), showlegend=False, row=2, col=1, **group
        )
    if left_out:
        shade_left_out(figure, first)
    shown = k[first.counted[k]] if first.counted[k].any() else k
    both = [first.measured_um[shown], *(trace.model_um[shown] for trace in traces.values())]
    figure.update_yaxes(
        title_text=DISPLACEMENT_UM, range=axis_range(np.concatenate(both)), row=1, col=1
    )
    left = np.concatenate([residual[shown] for residual in residuals])
    figure.update_yaxes(
        title_text="Measured − model ({output_unit})", range=axis_range(left), row=2, col=1
    )
    figure.update_xaxes(title_text="Time (s)", row=2, col=1)
    return styled(figure, 620)


def loops(traces: Mapping[str, Trace]) -> Any:
    """Draw the loops of a record and every model of it, and each model's residual along them."""
    first = next(iter(traces.values()))
    k = loop_index(first, _LOOPS)
    u = gapped(first.u_V, k)
    figure = make_subplots(
        rows=1, cols=2, horizontal_spacing=0.11, shared_xaxes=True,
        subplot_titles=["Loops", "Residual along the loops"],
    )  # fmt: skip
    figure.add_scatter(
        x=u, y=gapped(first.measured_um, k), name="measured", line_color=MEASURED, row=1, col=1
    )
    known = k[k >= first.cycles.edges[1]] if first.cycles.edges.size > 3 else k[k >= 0]
    left = []
    for (name, trace), colour in zip(traces.items(), PALETTE, strict=False):
        group = {
            "name": short_name(name),
            "legendgroup": name,
            "line": {"color": colour, "width": 1.0},
        }
        residual = np.where(trace.counted, trace.residual_um, np.nan)
        figure.add_scatter(x=u, y=gapped(trace.model_um, k), row=1, col=1, **group)
        figure.add_scatter(x=u, y=gapped(residual, k), showlegend=False, row=1, col=2, **group)
        left.append(trace.residual_um[known])
    figure.update_xaxes(title_text="Command ({input_unit})", matches="x")
    figure.update_yaxes(title_text=DISPLACEMENT_UM, row=1, col=1)
    limits = axis_range(np.concatenate(left)) if known.size else None
    figure.update_yaxes(title_text="Measured − model ({output_unit})", range=limits, row=1, col=2)
    return styled(figure, 500)


def _short(values: Array) -> Any:
    # seven digits are more than a screen shows, and half the bytes on the page
    return values.astype(np.float32)
