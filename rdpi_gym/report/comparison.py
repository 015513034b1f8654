"""Charts of a model against measurement, and of several models beside one measurement."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from rdpi_gym.diagnosis import FEW_HALF_CYCLES, Comparison, ModelComparison, Plane, Trace
from rdpi_gym.diagnosis.comparison.error_views import PARTS
from rdpi_gym.report.chart import (
    Axis,
    Bars,
    Chart,
    Level,
    Panel,
    Series,
    frequency_axis,
    short_name,
    side_by_side,
    stacked,
)
from rdpi_gym.report.style import (
    DIVERGING,
    FALLING,
    INK,
    MUTED,
    PALETTE,
    PAPER,
    RESIDUAL,
    RISING,
    colour_steps,
    styled,
)
from rdpi_gym.report.traces import (
    COMMAND,
    Overlay,
    around_largest_error,
    displacement_panel,
    loops,
    one_model,
    over_time,
    residual_panel,
    rms_um,
    thin_index,
)

RMS_UM = "RMS error ({output_unit})"
MEAN_UM = "Mean of measured − model ({output_unit})"
_ROLES = {"train": PALETTE[0], "validation": PALETTE[1], "test": PALETTE[2]}
_NAMED_BARS = 46
_PARTS = {
    "gain_um": ("in step (gain)", PALETTE[0]),
    "width_um": ("a quarter period off (width, lag)", PALETTE[5]),
    "odd_um": ("odd harmonics (shape)", PALETTE[2]),
    "even_um": ("even harmonics (asymmetry)", PALETTE[1]),
    "other_um": ("not periodic", "#B4BCC4"),
}
_STATES = {
    "resting": ("since it came to rest", PALETTE[1]),
    "moving": ("since it last rested", PALETTE[0]),
}
# Loops of three models and a measurement that can still be followed, in samples.
_MODELS_LOOPS = 1000


def comparison_chart(comparison: Comparison) -> Chart:
    """Draw the half-cycles about the largest error of the worst record, over time and as a loop."""
    trace = comparison.traces[int(np.argmax(comparison.records["rmse_um"].to_numpy()))]
    k, overlays = around_largest_error(trace), one_model(trace)
    first = replace(
        displacement_panel(overlays, k, dash="dot"), title=f"{trace.name} ({trace.role})"
    )
    loop = displacement_panel(overlays, k, COMMAND, dash="dot")
    return side_by_side([first, replace(loop, y=Axis()), residual_panel(overlays, k, masked=True)])


def models_chart(found: ModelComparison) -> Chart:
    """Draw the half-cycles about the largest error of the best model's worst record."""
    records = found.records.iloc[: len(found.comparisons[0].records)]
    place = int(np.argmax(records[list(found.names)].min(axis=1).to_numpy()))
    best = int(np.argmin(records[list(found.names)].to_numpy()[place]))
    k = around_largest_error(found.comparisons[best].traces[place])
    overlays = _overlays(
        dict(zip(found.names, (c.traces[place] for c in found.comparisons), strict=True))
    )
    first = overlays[0].trace
    over_t = replace(residual_panel(overlays, k, masked=True), title=f"{first.name} ({first.role})")
    panels = [
        displacement_panel(overlays, k, COMMAND),
        over_t,
        residual_panel(overlays, k, COMMAND, masked=True),
    ]
    return side_by_side([panels[0], panels[1], replace(panels[2], y=Axis())])


def record_errors(records: pd.DataFrame) -> Chart:
    """Draw the RMS error of every record, coloured by its role."""
    places = np.arange(1, len(records) + 1)
    marks = []
    for role, colour in _ROLES.items():
        here = (records["role"] == role).to_numpy()
        if here.any():
            marks.append(
                Bars(
                    places[here], records["rmse_um"].to_numpy()[here], role, colour, width=0.7,
                    names=list(map(str, records["name"][here])),
                    hover="%{hovertext}<br>%{x:.4g} {output_unit}",
                )
            )  # fmt: skip
    named = len(records) <= _NAMED_BARS
    names = [short_name(str(name)) for name in records["name"]]
    y = Axis(
        "" if named else "Record, as in the table",
        limits=(len(records) + 0.6, 0.4),  # the first record on top
        ticks=(places.tolist(), names) if named else None,
        grid=False,
    )
    bar_px = 26 if named else 1200 / len(records)
    panel = Panel(marks, Axis(RMS_UM, from_zero=True), y)
    return Chart([panel], round(100 + bar_px * len(records)))


def error_by_command(table: pd.DataFrame) -> Chart:
    """Draw the mean residual along the command, rising and falling."""
    marks = []
    for name, colour in (("rising", RISING), ("falling", FALLING)):
        rows = table[table["direction"] == name]
        marks.append(
            Series(
                (0.5 * (rows["low_V"] + rows["high_V"])).to_numpy(), rows["mean_um"].to_numpy(), name, colour,
                marker="circle", data=rows[["samples", "rmse_um"]].to_numpy(),
                hover="%{x:.4g} {input_unit}: mean %{y:.3g} {output_unit}<br>RMS %{customdata[1]:.3g} "
                "{output_unit}, %{customdata[0]} samples",
            )
        )  # fmt: skip
    return Chart([Panel(marks, COMMAND, Axis(MEAN_UM))], 400)


def error_by_frequency(table: pd.DataFrame) -> Chart:
    """Draw the error over the frequency of the command, in µm and in per cent of the stroke."""
    return _trend(table, "frequency_hz", frequency_axis(table["frequency_hz"].to_numpy()), "Hz")


def error_by_amplitude(table: pd.DataFrame) -> Chart:
    """Draw the error over the amplitude of the command, in µm and in per cent of the stroke."""
    return _trend(table, "amplitude_V", _AMPLITUDE, "{input_unit}")


_AMPLITUDE = Axis("Amplitude of the command ({input_unit})", from_zero=True)


def _trend(table: pd.DataFrame, column: str, x: Axis, unit: str) -> Chart:
    panels = []
    for name, title, label in (
        ("rmse_um", "Absolute", RMS_UM),
        ("relative_percent", "Relative to the stroke", "RMS error (% of the amplitude)"),
    ):
        line = Series(
            table[column].to_numpy(), table[name].to_numpy(), width=1.0, marker="circle", size=9,
            fill=_few(table, PALETTE[0]), data=table[["half_cycles", "samples"]].to_numpy(),
            hover=f"%{{x:.4g}} {unit}: %{{y:.4g}}<br>%{{customdata[0]}} half-cycles, "
            "%{customdata[1]} samples",
        )  # fmt: skip
        panels.append(Panel([line], x, Axis(label, from_zero=True), title))
    return side_by_side(panels, 380)


def _few(table: pd.DataFrame, colour: str) -> Any:
    """Return the fill of markers: white where they rest on few half-cycles."""
    return np.where(table["half_cycles"] < FEW_HALF_CYCLES, PAPER, colour)


def residual_plane(plane: Plane) -> Any:
    """Draw the mean residual over command and rate, for a page alone; returns a Plotly figure."""
    import plotly.graph_objects as go

    known = np.abs(plane.mean_um[np.isfinite(plane.mean_um)])
    reach = float(np.percentile(known, 98)) if known.size else 1.0
    figure = go.Figure(
        go.Heatmap(
            x=plane.command_edges_V, y=plane.rate_edges_V_s, z=plane.mean_um.T, zmin=-reach, zmax=reach,
            customdata=plane.samples.T,
            colorscale=colour_steps(DIVERGING),
            colorbar={"title": {"text": "Mean of<br>measured<br>− model<br>({output_unit})"}},
            hoverongaps=False,
            hovertemplate="%{x:.4g} {input_unit}, %{y:.4g} {input_unit}/s: %{z:.3g} {output_unit}<br>"
            "%{customdata} samples<extra></extra>",
        )
    )  # fmt: skip
    figure.update_xaxes(title_text=COMMAND.label, showgrid=False)
    figure.update_yaxes(title_text="Rate of the command ({input_unit}/s)", showgrid=False)
    return styled(figure, 460).update_layout(plot_bgcolor="#E9ECEF")


def error_spectrum(table: pd.DataFrame) -> Chart:
    """Draw the error by its own frequency beside the noise, and its part coherent with the command."""
    x = table["frequency_hz"].to_numpy()
    hover = "%{x:.3g} Hz: %{y:.3g} {output_unit}"
    lines = [
        Series(x, table["residual_um"].to_numpy(), "error", RESIDUAL, hover=hover),
        Series(
            x,
            table["noise_um"].to_numpy(),
            "noise floor, if white",
            MUTED,
            "dash",
            1.0,
            hover=hover,
        ),
    ]
    part = Series(
        x, table["coherent_percent"].to_numpy(), "coherent with the command", area=True,
        hover="%{x:.3g} Hz: %{y:.0f} %",
    )  # fmt: skip
    rms = Axis(
        "RMS in a third of an octave ({output_unit})", log=True, ticks="decades", powers=True
    )
    frequency = Axis("Frequency of the error (Hz)", log=True, ticks="decades")
    panels = [
        Panel(lines, replace(frequency, label=""), rms),
        Panel([part], frequency, Axis("Coherent (%)", limits=(0.0, 105.0))),
    ]
    return replace(stacked(panels, (0.62, 0.38), 500), row_gap=0.07)


def distortion_parts(table: pd.DataFrame) -> Chart:
    """Draw the parts of the error under steady periods."""
    pairs = zip(table["name"], table["frequency_hz"], strict=True)
    names = [f"{name} ({f:.4g} Hz)" for name, f in pairs]
    bars = [
        Bars(names, table[part].to_numpy(), *_PARTS[part], hover="%{y}<br>%{x:.3g} {output_unit}")
        for part in PARTS
    ]
    y = Axis(categories=names, reversed=True, grid=False)
    panel = Panel(bars, Axis("RMS ({output_unit})", from_zero=True), y)
    return Chart([panel], round(150 + 75 * len(table)))


def error_since_rest(table: pd.DataFrame, noise_um: float) -> Chart:
    """Draw the residual during rests, and the error since rests began and ended."""
    drift, size = [], []
    for state, (name, colour) in _STATES.items():
        rows = table[table["state"] == state]
        if rows.empty:
            continue
        line = Series(
            rows["time_s"].to_numpy(), rows["moved_um"].to_numpy(), colour=colour, marker="circle",
            data=rows["samples"].to_numpy(),
            hover="%{x:.3g} s: %{y:.3g} {output_unit}<br>%{customdata} samples",
        )  # fmt: skip
        if state == "resting":
            drift.append(line)
        size.append(replace(line, y=rows["rmse_um"].to_numpy(), name=name))
    time = Axis("Time (s)", log=True, ticks="decades", powers=True)
    panels = [
        Panel(
            drift,
            time,
            Axis("Measured − model, with the last move ({output_unit})"),
            "Residual while the command rests",
        ),
        Panel(
            [*size, Level(noise_um, colour=MUTED, width=1.0)],
            time,
            Axis(RMS_UM, from_zero=True),
            "Its size",
        ),
    ]
    return side_by_side(panels, 400)


def error_over_clock(table: pd.DataFrame) -> Chart:
    """Draw the mean error over the experiment's clock, one line a record."""
    marks: list[Series] = []
    for (name, role), rows in table.groupby(["name", "role"], sort=False):
        marks.append(
            Series(
                rows["t_s"].to_numpy(), rows["mean_um"].to_numpy(), str(role), _ROLES[str(role)], width=1.0,
                marker="circle", size=5, group=str(role), listed=all(m.group != role for m in marks),
                data=[short_name(str(name), 80)] * len(rows),
                hover="%{customdata}<br>%{x:.4g} s: %{y:.3g} {output_unit}",
            )
        )  # fmt: skip
    return Chart([Panel(marks, Axis("Time of the experiment (s)"), Axis(MEAN_UM))], 380)


def models_errors(found: ModelComparison, most: int) -> Chart:
    """Draw the RMS error of every record and role, a bar a model."""
    table = found.records
    count = len(found.comparisons[0].records)
    records, pooled = table.iloc[:count], table.iloc[count:]
    least = records[list(found.names)].min(axis=1)
    records = records.loc[sorted(least.nlargest(most).index)]
    table = pd.concat([pooled, records])
    places = np.arange(1, len(table) + 1)
    width = 0.8 / len(found.names)
    bars = [
        Bars(
            places - 0.4 + (i + 0.5) * width, table[name].to_numpy(), short_name(name), colour,
            width=0.9 * width, names=[f"{name}\n{record}" for record in table["record"]],
            hover="%{hovertext}: %{x:.4g} {output_unit}",
        )
        for i, (name, colour) in enumerate(zip(found.names, PALETTE, strict=False))
    ]  # fmt: skip
    pooled_names = set(pooled["record"])
    names = [
        short_name(f"{record}" if record in pooled_names else f"{record} ({role})")
        for record, role in zip(table["record"], table["role"], strict=True)
    ]
    y = Axis(limits=(len(table) + 0.6, 0.4), ticks=(places.tolist(), names), grid=False)
    floor = Level(found.noise_floor_um, "noise floor", INK, along="x")
    bar_px = max(26, 9 * len(found.names))
    panel = Panel([*bars, floor], Axis(RMS_UM, from_zero=True), y)
    return Chart([panel], round(120 + bar_px * len(table)))


def models_by_frequency(found: ModelComparison) -> Chart:
    """Draw each model's error over the frequency of the command."""
    table = found.by_frequency
    return _by(found, table, "frequency_hz", frequency_axis(table["frequency_hz"].to_numpy()), "Hz")


def models_by_amplitude(found: ModelComparison) -> Chart:
    """Draw each model's error over the amplitude of the command."""
    return _by(found, found.by_amplitude, "amplitude_V", _AMPLITUDE, "{input_unit}")


def _by(found: ModelComparison, table: pd.DataFrame, column: str, x: Axis, unit: str) -> Chart:
    lines = [
        Series(
            table[column].to_numpy(), table[name].to_numpy(), short_name(name), colour, width=1.2,
            marker="circle", size=8, fill=_few(table, colour), tagged=True,
            hover=f"%{{x:.4g}} {unit}: %{{y:.4g}} {{output_unit}}",
        )
        for name, colour in zip(found.names, PALETTE, strict=False)
    ]  # fmt: skip
    floor = Level(found.noise_floor_um, "noise floor", INK)
    return Chart([Panel([*lines, floor], x, Axis(RMS_UM, from_zero=True))], 400)


def _overlays(traces: Mapping[str, Trace]) -> list[Overlay]:
    return [
        Overlay(short_name(name), trace, colour)
        for (name, trace), colour in zip(traces.items(), PALETTE, strict=False)
    ]


def time_traces(trace: Trace, samples: int) -> Chart:
    """Draw measured and modelled displacement over time, and below them the residual."""
    k = thin_index(trace.measured_um, trace.model_um, trace.residual_um, samples=samples)
    return _one_over_time(trace, k, left_out=True)


def largest_error(trace: Trace, samples: int) -> Chart:
    """Draw the half-cycle of the largest error that counts, and those before and after it."""
    return _one_over_time(trace, around_largest_error(trace, samples), left_out=False)


def _one_over_time(trace: Trace, k: Any, left_out: bool) -> Chart:
    return over_time(
        one_model(trace), k, left_out=left_out, dash="dot", heights=(0.62, 0.38), height_px=520,
        label="Difference ({output_unit})",
    )  # fmt: skip


def models_time_traces(traces: Mapping[str, Trace], samples: int) -> Chart:
    """Draw a record and every model of it over time, and below them their residuals."""
    residuals = [trace.residual_um for trace in traces.values()]
    k = thin_index(next(iter(traces.values())).measured_um, *residuals, samples=samples)
    return over_time(_overlays(traces), k, left_out=True, height_px=620)


def models_largest_error(traces: Mapping[str, Trace], samples: int) -> Chart:
    """Draw the same about the largest error of the model that is nearest on the record."""
    k = around_largest_error(min(traces.values(), key=rms_um), samples)
    return over_time(_overlays(traces), k, left_out=False, height_px=620)


def models_loops(traces: Mapping[str, Trace]) -> Chart:
    """Draw the loops of a record and every model of it, and each model's residual along them."""
    return loops(_overlays(traces), _MODELS_LOOPS, height_px=500, masked=True, settled=True)
