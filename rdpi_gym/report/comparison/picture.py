"""A comparison in one picture: the record of the largest error, over time and as a loop."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rdpi_gym.diagnosis import Comparison, ModelComparison
from rdpi_gym.report.style import MEASURED, MODEL, PALETTE, RESIDUAL
from rdpi_gym.report.thin import around_largest_error

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_comparison(figure: Figure, comparison: Comparison) -> Any:
    """Draw the half-cycles about the largest error of the worst record into an empty figure."""
    trace = comparison.traces[int(np.argmax(comparison.records["rmse_um"].to_numpy()))]
    axes = figure.subplots(1, 3)
    k = around_largest_error(trace)
    t, u = trace.t_s[k], trace.u_V[k]
    for panel, x in ((axes[0], t), (axes[1], u)):
        panel.plot(x, trace.measured_um[k], color=MEASURED, linewidth=0.9, label="measured")
        panel.plot(x, trace.model_um[k], color=MODEL, linewidth=0.9, linestyle=":", label="model")
    axes[2].plot(
        t, np.where(trace.counted, trace.residual_um, np.nan)[k], color=RESIDUAL, linewidth=0.8
    )
    axes[0].set_ylabel("{Output} ({output_unit})")
    axes[2].set_ylabel("Measured − model ({output_unit})")
    axes[0].set_xlabel("Time (s)")
    axes[1].set_xlabel("Command ({input_unit})")
    axes[2].set_xlabel("Time (s)")
    axes[0].set_title(f"{trace.name} ({trace.role})", loc="left")
    axes[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.08), ncols=2)
    return axes


def draw_models(figure: Figure, found: ModelComparison) -> Any:
    """Draw the half-cycles about the largest error of the best model's worst record."""
    records = found.records.iloc[: len(found.comparisons[0].records)]
    place = int(np.argmax(records[list(found.names)].min(axis=1).to_numpy()))
    best = int(np.argmin(records[list(found.names)].to_numpy()[place]))
    first = found.comparisons[best].traces[place]
    k = around_largest_error(first)
    t, u = first.t_s[k], first.u_V[k]
    axes = figure.subplots(1, 3)
    axes[0].plot(u, first.measured_um[k], color=MEASURED, linewidth=1.1, label="measured")
    for name, comparison, colour in zip(found.names, found.comparisons, PALETTE, strict=False):
        trace = comparison.traces[place]
        left = np.where(trace.counted, trace.residual_um, np.nan)[k]
        axes[0].plot(u, trace.model_um[k], color=colour, linewidth=0.8, label=name)
        axes[1].plot(t, left, color=colour, linewidth=0.8)
        axes[2].plot(u, left, color=colour, linewidth=0.8)
    axes[0].set_ylabel("{Output} ({output_unit})")
    axes[1].set_ylabel("Measured − model ({output_unit})")
    axes[0].set_xlabel("Command ({input_unit})")
    axes[1].set_xlabel("Time (s)")
    axes[2].set_xlabel("Command ({input_unit})")
    axes[1].set_title(f"{first.name} ({first.role})", loc="left")
    figure.legend(loc="outside upper center", ncols=4)
    return axes
