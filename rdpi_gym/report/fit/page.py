"""The page of an identified model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from rdpi_gym.identification import FitResult
from rdpi_gym.identification.uncertainty import Z95
from rdpi_gym.report.page import Section, write_page
from rdpi_gym.report.style import PALETTE, figure_text, styled


def write_fit_page(
    path: Path | str, result: FitResult, lines: Sequence[str], parameters: pd.DataFrame
) -> Path:
    """Write a fit as a self-contained page."""
    said = [line for line in lines if not line.startswith("- ")]
    warnings = "\n".join(line for line in lines if line.startswith("- "))
    sections = [
        Section(
            "Parameters",
            "Weights over the thresholds at rest, with their 95 % intervals. A parameter whose "
            "standard error is infinite is not determined by these data.",
            _weights(result),
            parameters,
        ),
        Section(
            "Error by record",
            "RMS error of each record, with one free offset in each.",
            _errors(result),
            pd.DataFrame(
                {"record": list(result.rmse_um), "rmse_um": list(result.rmse_um.values())}
            ),
        ),
        Section(
            "What the data do not determine", warnings or "The data determine every parameter."
        ),
    ]
    return write_page(
        path,
        f"Model {result.plant.name}",
        "\n\n".join(said),
        sections,
        result.quantities,
    )


def _weights(result: FitResult) -> Any:
    hysteresis = result.plant.hysteresis
    thresholds = [0.0, *hysteresis.thresholds_V]
    errors = np.array([result.standard_errors[f"a_{i}"] for i in range(len(thresholds))])
    reach = np.where(np.isfinite(errors), Z95 * errors, 0.0)
    figure = go.Figure(
        go.Bar(
            x=thresholds,
            y=hysteresis.weights,
            width=0.6 * thresholds[1],
            error_y={"type": "data", "array": reach},
            marker_color=PALETTE[0],
            hovertemplate="%{x:.4g} {input_unit}: %{y:.4g} {output_unit}/{input_divisor}<extra></extra>",
        )
    )
    figure.update_xaxes(title_text="Threshold at rest ({input_unit})")
    figure.update_yaxes(title_text="Weight ({output_unit}/{input_divisor})")
    return styled(figure, 400)


def _errors(result: FitResult) -> Any:
    names = [figure_text(name) for name in result.rmse_um]
    figure = go.Figure(
        go.Bar(
            x=list(result.rmse_um.values()),
            y=names,
            orientation="h",
            marker_color=PALETTE[1],
            hovertemplate="%{y}: %{x:.4g} {output_unit}<extra></extra>",
        )
    )
    figure.update_xaxes(title_text="RMS error ({output_unit})", rangemode="tozero")
    figure.update_yaxes(autorange="reversed", showgrid=False)
    return styled(figure, round(140 + 26 * len(names)))
