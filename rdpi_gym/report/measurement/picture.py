"""Measured records in one picture: over time, and as loops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rdpi_gym.measurement import Record
from rdpi_gym.report.style import MEASURED, PALETTE
from rdpi_gym.report.thin import thin_index

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NAMED = 8


def draw_records(figure: Figure, records: Sequence[Record]) -> Any:
    """Draw displacement over time and over voltage into an empty figure."""
    axes = figure.subplots(1, 2)
    moving = [record for record in records if not record.is_quiet]
    for i, record in enumerate(moving):
        colour = PALETTE[i % len(PALETTE)] if len(moving) > 1 else MEASURED
        k = thin_index(record.u_V, record.y_um)
        axes[0].plot(record.t_s[k], record.y_um[k], color=colour, linewidth=0.8, label=record.name)
        axes[1].plot(record.u_V[k], record.y_um[k], color=colour, linewidth=0.8)
    axes[0].set_xlabel("Time (s)")
    axes[1].set_xlabel("{Input} ({input_unit})")
    axes[0].set_ylabel("{Output} ({output_unit})")
    if 1 < len(moving) <= _NAMED:
        axes[0].legend()
    return axes
