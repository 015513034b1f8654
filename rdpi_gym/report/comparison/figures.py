"""Figures of a comparison's numbers, drawn from the comparison alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from rdpi_gym.diagnosis import FEW_HALF_CYCLES, Plane
from rdpi_gym.report.style import (
    DIVERGING,
    FALLING,
    PALETTE,
    PAPER,
    RISING,
    colour_steps,
    figure_text,
    styled,
)
from rdpi_gym.support.arrays import Array

COMMAND_V = "Command ({input_unit})"
_ROLES = {"train": PALETTE[0], "validation": PALETTE[1], "test": PALETTE[2]}
_NAMED_BARS = 46


def record_errors(records: pd.DataFrame) -> Any:
    """Draw the RMS error of every record, coloured by its role; returns a Plotly figure."""
    figure = go.Figure()
    places = np.arange(1, len(records) + 1)
    for role, colour in _ROLES.items():
        here = (records["role"] == role).to_numpy()
        if here.any():
            figure.add_bar(
                x=records["rmse_um"].to_numpy()[here],
                y=places[here],
                orientation="h",
                width=0.7,
                name=role,
                marker_color=colour,
                hovertext=[figure_text(str(name)) for name in records["name"][here]],
                hovertemplate="%{hovertext}<br>%{x:.4g} {output_unit}<extra></extra>",
            )
    named = len(records) <= _NAMED_BARS
    figure.update_yaxes(
        range=[len(records) + 0.6, 0.4],  # the first record on top
        showgrid=False,
        tickvals=places if named else None,
        ticktext=[short_name(str(name)) for name in records["name"]] if named else None,
        title_text=None if named else "Record, as in the table",
    )
    figure.update_xaxes(title_text="RMS error ({output_unit})", rangemode="tozero")
    bar_px = 26 if named else 1200 / len(records)
    return styled(figure.update_layout(showlegend=True), round(100 + bar_px * len(records)))


def error_by_command(table: pd.DataFrame) -> Any:
    """Draw the mean residual along the command, rising and falling; returns a Plotly figure."""
    figure = go.Figure()
    for name, colour in (("rising", RISING), ("falling", FALLING)):
        rows = table[table["direction"] == name]
        figure.add_scatter(
            x=(0.5 * (rows["low_V"] + rows["high_V"])).to_numpy(),
            y=rows["mean_um"].to_numpy(),
            customdata=rows[["samples", "rmse_um"]].to_numpy(),
            name=name,
            mode="lines+markers",
            line_color=colour,
            hovertemplate="%{x:.4g} {input_unit}: mean %{y:.3g} {output_unit}<br>RMS %{customdata[1]:.3g} {output_unit}, "
            "%{customdata[0]} samples<extra></extra>",
        )
    figure.update_xaxes(title_text=COMMAND_V)
    figure.update_yaxes(title_text="Mean of measured − model ({output_unit})")
    return styled(figure, 400)


def error_by_frequency(table: pd.DataFrame) -> Any:
    """Draw the error over the frequency of the command, in µm and in per cent of the stroke."""
    figure = _trend(table, "frequency_hz", "Frequency (Hz)", "Hz")
    return frequency_axis(figure, table["frequency_hz"].to_numpy())


def frequency_axis(figure: Any, frequencies_hz: Array) -> Any:
    """Give a figure a logarithmic axis of frequency (Hz), with ticks that a reader can use."""
    # one decade at least, so that a single frequency is not drawn on an axis without ticks
    x = np.log10(frequencies_hz)
    margin = max(0.06, 0.5 * (1.0 - float(np.ptp(x))))
    low, high = float(x.min()) - margin, float(x.max()) + margin
    decades = 10.0 ** np.arange(np.floor(low), np.ceil(high))
    ticks = np.outer(decades, [1.0, 2.0, 5.0] if high - low < 2.5 else [1.0]).ravel()
    return figure.update_xaxes(
        type="log", range=[low, high], tickvals=ticks, ticktext=[f"{tick:g}" for tick in ticks]
    )


def error_by_amplitude(table: pd.DataFrame) -> Any:
    """Draw the error over the amplitude of the command, in µm and in per cent of the stroke."""
    return _trend(
        table, "amplitude_V", "Amplitude of the command ({input_unit})", "{input_unit}"
    ).update_xaxes(rangemode="tozero")


def _trend(table: pd.DataFrame, column: str, title: str, unit: str) -> Any:
    figure = make_subplots(
        rows=1,
        cols=2,
        horizontal_spacing=0.11,
        subplot_titles=["Absolute", "Relative to the stroke"],
    )
    panels = (
        ("rmse_um", "RMS error ({output_unit})"),
        ("relative_percent", "RMS error (% of the amplitude)"),
    )
    for col, (name, label) in enumerate(panels, start=1):
        figure.add_scatter(
            x=table[column].to_numpy(),
            y=table[name].to_numpy(),
            customdata=table[["half_cycles", "samples"]].to_numpy(),
            mode="lines+markers",
            marker={
                "size": 9,
                "color": np.where(table["half_cycles"] < FEW_HALF_CYCLES, PAPER, PALETTE[0]),
                "line": {"color": PALETTE[0], "width": 1.5},
            },
            line={"color": PALETTE[0], "width": 1},
            showlegend=False,
            hovertemplate=f"%{{x:.4g}} {unit}: %{{y:.4g}}<br>%{{customdata[0]}} half-cycles, "
            "%{customdata[1]} samples<extra></extra>",
            row=1,
            col=col,
        )
        figure.update_yaxes(title_text=label, rangemode="tozero", row=1, col=col)
    figure.update_xaxes(title_text=title)
    return styled(figure, 380)


def residual_plane(plane: Plane) -> Any:
    """Draw the mean residual over command and rate; returns a Plotly figure."""
    known = np.abs(plane.mean_um[np.isfinite(plane.mean_um)])
    reach = float(np.percentile(known, 98)) if known.size else 1.0
    figure = go.Figure(
        go.Heatmap(
            x=plane.command_edges_V,
            y=plane.rate_edges_V_s,
            z=plane.mean_um.T,
            customdata=plane.samples.T,
            zmin=-reach,
            zmax=reach,
            colorscale=colour_steps(DIVERGING),
            colorbar={"title": {"text": "Mean of<br>measured<br>− model<br>({output_unit})"}},
            hoverongaps=False,
            hovertemplate="%{x:.4g} {input_unit}, %{y:.4g} {input_unit}/s: %{z:.3g} {output_unit}<br>%{customdata} samples"
            "<extra></extra>",
        )
    )
    figure.update_xaxes(title_text=COMMAND_V, showgrid=False)
    figure.update_yaxes(title_text="Rate of the command ({input_unit}/s)", showgrid=False)
    return styled(figure, 460).update_layout(plot_bgcolor="#E9ECEF")


def short_name(name: str, most: int = 34) -> str:
    """Return a name for an axis or a legend, cut where it is long."""
    return figure_text(name if len(name) <= most else f"{name[: most - 1]}…")
