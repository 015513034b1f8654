"""An identified model in one picture: its weights with their intervals, its error by record."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rdpi_gym.identification import FitResult
from rdpi_gym.identification.uncertainty import Z95
from rdpi_gym.report.style import INK, PALETTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_fit(figure: Figure, result: FitResult) -> Any:
    """Draw weights over thresholds and the error of each record into an empty figure."""
    axes = figure.subplots(1, 2)
    hysteresis = result.plant.hysteresis
    thresholds = [0.0, *hysteresis.thresholds_V]
    errors = np.array([result.standard_errors[f"a_{i}"] for i in range(len(thresholds))])
    known = np.isfinite(errors)
    axes[0].bar(thresholds, hysteresis.weights, width=0.6 * thresholds[1], color=PALETTE[0])
    axes[0].errorbar(
        np.array(thresholds)[known],
        np.array(hysteresis.weights)[known],
        yerr=Z95 * errors[known],
        fmt="none",
        ecolor=INK,
        capsize=3,
    )
    axes[0].set_xlabel("Threshold at rest ({input_unit})")
    axes[0].set_ylabel("Weight ({output_unit}/{input_divisor}), 95 % interval")
    axes[1].barh(list(result.rmse_um), list(result.rmse_um.values()), color=PALETTE[1])
    axes[1].invert_yaxis()
    axes[1].set_xlabel("RMS error ({output_unit})")
    return axes
