"""An identified model: its weights and errors as charts, and its page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from rdpi_gym.identification import FitResult
from rdpi_gym.identification.uncertainty import Z95
from rdpi_gym.report.chart import Axis, Bars, Chart, Panel, side_by_side
from rdpi_gym.report.page import Section, write_page
from rdpi_gym.report.style import PALETTE


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
