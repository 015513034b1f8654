"""The size of a data set: what starting values and typical parameters are measured by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rdpi_gym.measurement import Record
from rdpi_gym.plant.parameters import DataScale

# The commands of the data, widened by this part of their range, are a fitted plant's.
_RANGE_MARGIN = 0.05
# References take this part of the measured stroke.
_REFERENCE_PART = 0.9


def plant_ranges(
    records: Sequence[Record],
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the command range (V) of a plant fitted to records, and its references (µm)."""
    low = min(float(record.u_V.min()) for record in records)
    high = max(float(record.u_V.max()) for record in records)
    least = min(float(record.y_um[record.error_mask].min()) for record in records)
    most = max(float(record.y_um[record.error_mask].max()) for record in records)
    margin = _RANGE_MARGIN * (high - low)
    stroke = (least + most) / 2, _REFERENCE_PART * (most - least) / 2
    return (low - margin, high + margin), stroke


def data_scale(records: Sequence[Record]) -> DataScale:
    """Return centre, span, stroke, fastest rate and times of the records that move."""
    low = min(float(r.u_V.min()) for r in records)
    high = max(float(r.u_V.max()) for r in records)
    y_low = min(float(r.y_um[r.error_mask].min()) for r in records)
    y_high = max(float(r.y_um[r.error_mask].max()) for r in records)
    return DataScale(
        centre_V=0.5 * (low + high),
        span_V=0.5 * (high - low),
        stroke_um=0.5 * (y_high - y_low),
        fastest_V_s=_fastest_V_s(records),
        shortest_s=min(r.ts_s for r in records),
        longest_s=max(float(r.t_s[-1] - r.t_s[0]) for r in records),
        end_s=max(float(r.t_s[-1]) for r in records),
    )


def _fastest_V_s(records: Sequence[Record]) -> float:
    """Largest rate of the command, jumps left out where it does anything but jump (V/s)."""
    moves = [(np.abs(np.diff(r.u_V)), r.ts_s) for r in records]
    usual = max(float(np.quantile(change, 0.99)) / ts for change, ts in moves)
    return usual or max(float(np.max(change)) / ts for change, ts in moves)
