"""Figures of a comparison over the error's own frequency, its harmonics, and time."""

from __future__ import annotations

from typing import Any

import pandas as pd
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from rdpi_gym.diagnosis.comparison.spectrum import PARTS
from rdpi_gym.report.style import MUTED, PALETTE, RESIDUAL, figure_text, styled

_PART_NAMES = {
    "gain_um": "in step (gain)",
    "width_um": "a quarter period off (width, lag)",
    "odd_um": "odd harmonics (shape)",
    "even_um": "even harmonics (asymmetry)",
    "other_um": "not periodic",
}
_PART_COLOURS = (PALETTE[0], PALETTE[5], PALETTE[2], PALETTE[1], "#B4BCC4")
_STATES = {"resting": PALETTE[1], "moving": PALETTE[0]}
_NOISE = {"color": MUTED, "dash": "dash", "width": 1}


def error_spectrum(table: pd.DataFrame) -> Any:
    """Draw the error by its own frequency beside the noise, and what follows from the command."""
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, row_heights=[0.62, 0.38], vertical_spacing=0.07
    )
    x = table["frequency_hz"].to_numpy()
    lines = (
        ("residual_um", "error", {"color": RESIDUAL}),
        ("noise_um", "noise floor, if white", _NOISE),
    )
    for column, name, line in lines:
        figure.add_scatter(
            x=x,
            y=table[column].to_numpy(),
            name=name,
            line=line,
            hovertemplate="%{x:.3g} Hz: %{y:.3g} {output_unit}<extra></extra>",
            row=1,
            col=1,
        )
    figure.add_scatter(
        x=x,
        y=table["coherent_percent"].to_numpy(),
        name="coherent with the command",
        line={"color": PALETTE[0]},
        fill="tozeroy",
        fillcolor="rgba(0, 114, 178, 0.15)",
        hovertemplate="%{x:.3g} Hz: %{y:.0f} %<extra></extra>",
        row=2,
        col=1,
    )
    figure.update_xaxes(type="log", dtick=1)
    figure.update_xaxes(title_text="Frequency of the error (Hz)", row=2, col=1)
    figure.update_yaxes(
        title_text="RMS in a third of an octave ({output_unit})",
        type="log",
        dtick=1,
        exponentformat="power",
        row=1,
        col=1,
    )
    figure.update_yaxes(title_text="Coherent (%)", range=[0, 105], row=2, col=1)
    return styled(figure, 500)


def distortion_parts(table: pd.DataFrame) -> Any:
    """Draw what the error under steady periods is made of; returns a Plotly figure."""
    figure = go.Figure()
    names = [
        figure_text(f"{name} ({f:.4g} Hz)")
        for name, f in zip(table["name"], table["frequency_hz"], strict=True)
    ]
    for part, colour in zip(PARTS, _PART_COLOURS, strict=True):
        figure.add_bar(
            y=names,
            x=table[part].to_numpy(),
            orientation="h",
            name=_PART_NAMES[part],
            marker_color=colour,
            hovertemplate="%{y}<br>%{x:.3g} {output_unit}<extra></extra>",
        )
    figure.update_layout(barmode="group", bargap=0.25)
    figure.update_xaxes(title_text="RMS ({output_unit})", rangemode="tozero")
    figure.update_yaxes(autorange="reversed", showgrid=False)
    return styled(figure, round(150 + 75 * len(table)))


def error_since_rest(table: pd.DataFrame, noise_um: float) -> Any:
    """Draw how measured minus model goes on in rests, and the error since rests began and ended."""
    figure = make_subplots(
        rows=1,
        cols=2,
        horizontal_spacing=0.11,
        subplot_titles=["How it goes on while the command rests", "How large it is"],
    )
    for state, colour in _STATES.items():
        rows = table[table["state"] == state]
        if rows.empty:
            continue
        shared = {
            "x": rows["time_s"].to_numpy(),
            "customdata": rows["samples"].to_numpy(),
            "mode": "lines+markers",
            "line_color": colour,
            "hovertemplate": "%{x:.3g} s: %{y:.3g} {output_unit}<br>%{customdata} samples<extra></extra>",
        }
        if state == "resting":
            figure.add_scatter(
                y=rows["moved_um"].to_numpy(), showlegend=False, row=1, col=1, **shared
            )
        name = "since it came to rest" if state == "resting" else "since it last rested"
        figure.add_scatter(y=rows["rmse_um"].to_numpy(), name=name, row=1, col=2, **shared)
    figure.add_hline(y=noise_um, line=_NOISE, row=1, col=2)
    figure.update_xaxes(type="log", dtick=1, title_text="Time (s)", exponentformat="power")
    figure.update_yaxes(
        title_text="Measured − model, with the last move ({output_unit})", row=1, col=1
    )
    figure.update_yaxes(title_text="RMS error ({output_unit})", rangemode="tozero", row=1, col=2)
    return styled(figure, 400)


def error_over_clock(table: pd.DataFrame) -> Any:
    """Draw the mean error over the experiment's clock, one line a record; returns a Plotly figure."""
    figure = go.Figure()
    colours = {"train": PALETTE[0], "validation": PALETTE[1], "test": PALETTE[2]}
    seen: set[str] = set()
    for (name, role), rows in table.groupby(["name", "role"], sort=False):
        figure.add_scatter(
            x=rows["t_s"].to_numpy(),
            y=rows["mean_um"].to_numpy(),
            mode="lines+markers",
            marker_size=5,
            line={"color": colours[str(role)], "width": 1},
            name=str(role),
            legendgroup=str(role),
            showlegend=role not in seen,
            hovertemplate=f"{figure_text(str(name))}<br>%{{x:.4g}} s: %{{y:.3g}} {{output_unit}}<extra></extra>",
        )
        seen.add(str(role))
    figure.update_xaxes(title_text="Time of the experiment (s)")
    figure.update_yaxes(title_text="Mean of measured − model ({output_unit})")
    return styled(figure, 380)
