"""Charts and pages of measured records, of an identified model, and of a training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from rdpi_gym.identification import FitResult
from rdpi_gym.identification.uncertainty import Z95
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.report.chart import Axis, Bars, Chart, Level, Mark, Panel, Series, side_by_side
from rdpi_gym.report.chart_matplotlib import chart_png
from rdpi_gym.report.page import Section, write_page
from rdpi_gym.report.style import INK, MEASURED, MUTED, PALETTE
from rdpi_gym.report.traces import DISPLACEMENT_UM, TIME, thin_index
from rdpi_gym.support.arrays import Array

_MOST_SAMPLES = 60_000
_INPUT = Axis("{Input} ({input_unit})")
_OUTPUT = Axis(DISPLACEMENT_UM)
_NAMED = 8
"""Most records that the legend names."""


def records_chart(records: Sequence[Record]) -> Chart:
    """Draw displacement over time and over voltage, all records in the same panels."""
    moving = [record for record in records if not record.is_quiet]
    several = len(moving) > 1
    over_time, loops = [], []
    for i, record in enumerate(moving):
        k = thin_index(record.u_V, record.y_um)
        colour = PALETTE[i % len(PALETTE)] if several else MEASURED
        name = record.name if several and len(moving) <= _NAMED else ""
        y = record.y_um[k]
        over_time.append(Series(record.t_s[k], y, name, colour, width=1.1))
        loops.append(Series(record.u_V[k], y, colour=colour, width=1.1))
    return side_by_side([Panel(over_time, TIME, _OUTPUT), Panel(loops, _INPUT)])


def write_data_page(path: Path | str, dataset: Dataset) -> Path:
    """Write the records of a data set as a self-contained page."""
    samples = max(500, min(3000, _MOST_SAMPLES // len(dataset.records)))
    table = pd.DataFrame(
        [
            {
                "record": r.name,
                "role": "quiet" if r.is_quiet else r.role,
                "samples": r.t_s.size,
                "ts_s": r.ts_s,
                "duration_s": float(r.t_s[-1] - r.t_s[0]),
                "lowest_u_V": float(np.min(r.u_V)),
                "highest_u_V": float(np.max(r.u_V)),
                "lowest_y_um": r.y_range_um[0],
                "highest_y_um": r.y_range_um[1],
                "note": r.note,
            }
            for r in dataset.records
        ]
    )
    keep = (dataset.title, dataset.quantities.words, *(r.name for r in dataset.records))
    keep = (*keep, *(r.note for r in dataset.records))
    described = dataset.quantities.said(dataset.describe(), keep).splitlines()[1:]
    sections = [
        Section(
            "Each record",
            "{Input} and {output} over time, and the loops that they make. "
            "Drag over a stretch to enlarge it, double-click to return.",
            {record.name: _record_chart(record, samples) for record in dataset.records},
            table,
        ),
        Section(
            "How the records were read",
            "\n".join(f"- {line.strip()}" for line in described),
        ),
    ]
    moving = sum(not record.is_quiet for record in dataset.records)
    summary = (
        f"{len(dataset.records)} records, {moving} of them with a {{input}} that moves; "
        f"{len(dataset.train)} to fit, {len(dataset.validation)} to validate on."
    )
    return write_page(path, dataset.title, summary, sections, dataset.quantities)


def _record_chart(record: Record, samples: int) -> Chart:
    k = thin_index(record.u_V, record.y_um, samples=samples)
    t, u, y = record.t_s[k], record.u_V[k], record.y_um[k]

    def line(x: Array, values: Array, colour: str) -> list[Series]:
        return [Series(x, values, colour=colour, width=1.0)]

    panels = [
        Panel(line(t, y, MEASURED), y=_OUTPUT),
        Panel(line(u, y, MEASURED), _INPUT, _OUTPUT, column=2, rows=2),
        Panel(line(t, u, MUTED), TIME, _INPUT, row=2),
    ]
    return Chart(panels, 460, widths=(0.58, 0.42), row_gap=0.08)


def fit_chart(result: FitResult) -> Chart:
    """Draw weights over thresholds, and the error of each record."""
    return side_by_side([_weights(result), errors_panel(result.rmse_um)])


def write_fit_page(
    path: Path | str, result: FitResult, lines: Sequence[str], parameters: pd.DataFrame
) -> Path:
    """Write a fit as a self-contained page."""
    answer = [line for line in lines if not line.startswith("- ")]
    warnings = "\n".join(line for line in lines if line.startswith("- "))
    rmse_um = result.rmse_um
    sections = [
        Section(
            "Parameters",
            "Weights over the thresholds at rest, with their 95 % intervals. A parameter whose "
            "standard error is infinite is not determined by these data.",
            Chart([_weights(result)], 400),
            parameters,
        ),
        Section(
            "Error by record",
            "RMS error of each record, with one free offset in each.",
            Chart([errors_panel(rmse_um)], round(140 + 26 * len(rmse_um))),
            pd.DataFrame({"record": list(rmse_um), "rmse_um": list(rmse_um.values())}),
        ),
        Section(
            "What the data do not determine", warnings or "The data determine every parameter."
        ),
    ]
    title = f"Model {result.plant.name}"
    return write_page(path, title, "\n\n".join(answer), sections, result.quantities)


def _weights(result: FitResult) -> Panel:
    hysteresis = result.plant.hysteresis
    thresholds = [0.0, *hysteresis.thresholds_V]
    errors = np.array([result.standard_errors[f"a_{i}"] for i in range(len(thresholds))])
    bars = Bars(
        thresholds,
        hysteresis.weights,
        horizontal=False,
        width=0.6 * thresholds[1],
        errors=np.where(np.isfinite(errors), Z95 * errors, np.nan),
        hover="%{x:.4g} {input_unit}: %{y:.4g} {output_unit}/{input_divisor}",
    )
    weight = Axis("Weight ({output_unit}/{input_divisor}), 95 % interval")
    return Panel([bars], Axis("Threshold at rest ({input_unit})"), weight)


def errors_panel(errors_um: Mapping[str, float], label: str = "RMS error ({output_unit})") -> Panel:
    """Return a bar for each record, or each model, by name."""
    names = list(errors_um)
    hover = "%{y}: %{x:.4g} {output_unit}"
    bars = Bars(names, list(errors_um.values()), colour=PALETTE[1], hover=hover)
    categories = Axis(categories=names, reversed=True, grid=False)
    return Panel([bars], Axis(label, from_zero=True), categories)


_HELD_OUT = "policy, held-out plants"
_STEPS = "environment steps"


def training_picture(curve: pd.DataFrame, compensator: str, kept_at: float | None) -> bytes:
    """Draw error, cost, command variation and time over the steps of a training."""
    panels = [
        replace(panel, row=1 + i // 2, column=1 + i % 2, x=panel.x if i > 1 else Axis())
        for i, panel in enumerate(_training_panels(curve, compensator, kept_at))
    ]
    return chart_png(Chart(panels, shared="x", legend="below"), (9.0, 5.8), dpi=120)


def training_chart(curve: pd.DataFrame, compensator: str) -> Chart:
    """Draw the error on held-out plants over the steps, beside the compensator's."""
    error, *_ = _training_panels(curve, compensator, None)
    return Chart(
        [replace(error, title="", y=replace(error.y, label="RMSE on held-out plants (µm)"))]
    )


def write_training_page(
    path: Path | str,
    curve: pd.DataFrame,
    compensator: str,
    kept_at: float | None,
    title: str,
    answer: str,
) -> Path:
    """Write a training as a self-contained page: answer, the four courses, every evaluation."""
    dotted = Axis(f"{_STEPS}, dotted: the policy that is kept")
    sections = [
        Section(
            panel.title, text.format(compensator), Chart([replace(panel, title="", x=dotted)], 380)
        )
        for panel, text in zip(_training_panels(curve, compensator, kept_at), _TEXTS, strict=True)
    ]
    table = curve[["timesteps", "seconds", "rmse_um", "rmse_percent", "reward"]].assign(
        variation=curve["command_variation_V_s"] / curve["compensator_command_variation_V_s"]
    )
    named = table.rename(
        columns={
            "timesteps": "Steps", "seconds": "Time (s)", "rmse_um": "RMSE (µm)",
            "rmse_percent": "RMSE (% of peak to peak)", "reward": "Reward of a sample",
            "variation": "Command variation over the compensator's",
        }
    )  # fmt: skip
    note = "Means over the held-out plants, as in training.csv. The first row is the untrained network."
    return write_page(
        path, title, answer, [*sections, Section("Every evaluation", note, None, named)]
    )


_TEXTS = (
    "Root mean square tracking error on plants and references that were never trained on. The dashed "
    "line is {}'s on the same ones.",
    "The reward with its sign turned, so that less is better: the error over the amplitude, and the "
    "price of moving the command. In training it holds exploration too.",
    "Total variation of the command over time. Above about 1.5 times that of {} it dithers or passes "
    "noise on.",
    "Time that passed until an evaluation was done, evaluations included.",
)


def _training_panels(curve: pd.DataFrame, compensator: str, kept_at: float | None) -> list[Panel]:
    """Return error, cost, command variation and time, in the order of their texts."""

    def line(values: pd.Series, name: str, colour: str = PALETTE[0]) -> list[Mark]:
        x, y = curve["timesteps"].to_numpy(float), values.astype(float).to_numpy()
        drawn = Series(x, y, name, colour, marker="circle", size=5.0)
        if colour == INK:
            drawn = replace(drawn, dash="dash", marker=None)
        return [drawn] if values.notna().any() else []

    kept: list[Mark] = (
        [] if kept_at is None else [Level(kept_at, "policy that is kept", MUTED, "dot", 1.6, "x")]
    )
    steps = Axis(_STEPS, powers=True)
    rival = curve["compensator_rmse_um"], curve["compensator_command_variation_V_s"]
    return [
        Panel(
            [*line(curve["rmse_um"], _HELD_OUT), *line(rival[0], compensator, INK), *kept],
            steps,
            Axis("RMSE (µm)", log=True, ticks="1-2-5"),
            "Error",
        ),
        Panel(
            [
                *line(-curve["reward"], _HELD_OUT),
                *line(-curve["training_reward"], "policy, in training", PALETTE[1]),
                *kept,
            ],
            steps,
            Axis("cost of a sample (−reward)", log=True, ticks="1-2-5"),
            "Cost",
        ),
        Panel(
            [
                *line(curve["command_variation_V_s"], _HELD_OUT),
                *line(rival[1], compensator, INK),
                *kept,
            ],
            steps,
            Axis("command variation (V/s)", log=True, ticks="1-2-5"),
            "Command variation",
        ),
        Panel(
            [*line(curve["seconds"], _HELD_OUT), *kept],
            steps,
            Axis("time (s)", from_zero=True),
            "Time",
        ),
    ]
