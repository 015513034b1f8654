"""Sizes and rates of a data set, and the bounds of a fit that follow from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.identification.stack import Stack
from rdpi_gym.measurement import Record
from rdpi_gym.plant.parameters import DataScale
from rdpi_gym.support.arrays import Array

# The commands of the data, widened by this part of their range, are a fitted plant's.
_RANGE_MARGIN = 0.05
# References take this part of the measured stroke.
_REFERENCE_PART = 0.9


def plant_ranges(
    records: Sequence[Record],
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the command range (V) of a plant fitted to records, and its references (µm)."""
    low, high, least, most = _ranges(records)
    margin = _RANGE_MARGIN * (high - low)
    stroke = (least + most) / 2, _REFERENCE_PART * (most - least) / 2
    return (low - margin, high + margin), stroke


def _ranges(records: Sequence[Record]) -> tuple[float, float, float, float]:
    """Lowest and highest command (V), and displacement (µm) of the samples that count."""
    return (
        min(float(r.u_V.min()) for r in records),
        max(float(r.u_V.max()) for r in records),
        min(float(r.y_um[r.error_mask].min()) for r in records),
        max(float(r.y_um[r.error_mask].max()) for r in records),
    )


def data_scale(records: Sequence[Record]) -> DataScale:
    """Return centre, span, stroke, fastest rate and times of the records that move."""
    low, high, y_low, y_high = _ranges(records)
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


class Bounds(NamedTuple):
    """Bounds of the search."""

    delta1_V: tuple[float, float]  # Smallest and largest δ1 (V)
    delta2_s: tuple[float, float]  # Smallest and largest δ2 (s)
    a0: float  # Smallest a_0 (µm/V)
    # A play whose output moves (rms) less than this part of its command in every record is
    # held at weight 0
    motion: float
    reach_V: float  # Largest |memory extremum| (V)


class Scales(NamedTuple):
    """Sizes of a data set."""

    excursion_V: float  # Half the largest range (V) of a record's command
    # Smallest and largest rms rate (V/s) of a record
    slowest_V_s: float
    fastest_V_s: float


def data_scales(stack: Stack) -> Scales:
    """Measure the commands of a stack."""
    parts = [stack.record(r) for r in range(stack.edges.size - 1)]
    rates = [float(np.sqrt(np.mean(stack.rate_V_s[part] ** 2))) for part in parts]
    excursion = max(float(np.ptp(stack.u_V[part])) for part in parts) / 2
    return Scales(excursion, min(rates), max(rates))


def set_bounds(stack: Stack, n: int, min_motion: float) -> Bounds:
    """Bound a search by what can show in its data.

    A threshold above half the largest range slides once at most, one above the largest command
    never; far below the largest δ2, every threshold is beyond that even in the slowest record.
    """
    scales = data_scales(stack)
    largest = float(np.max(np.abs(stack.u_V)))
    displacement = float(np.linalg.norm(stack.root_weight * stack.y_um))
    gain = displacement / float(np.linalg.norm(stack.root_weight)) / (2 * scales.excursion_V)
    return Bounds(
        delta1_V=(1e-3 * scales.excursion_V / n, min(2 * scales.excursion_V, largest)),
        delta2_s=(0.0, 10 * scales.excursion_V / scales.slowest_V_s),
        a0=1e-4 * gain,
        motion=min_motion,
        reach_V=3 * largest,
    )


# Movements below this part of a record's range are ripple, no turning points: looked at closely,
# and from afar, where a fast tone upon a slow one is ripple too.
_RIPPLES = (0.05, 0.5)
# Movements below this part say little about the rates that shape the loops.
_SMALL = 0.2
# Rates below this part of a record's largest are rest.
_RESTING = 0.02
# Rates whose largest and smallest differ by less than this factor are alike.
_ALIKE = 1.5


@dataclass(frozen=True)
class RateSpread:
    """Spread of the rates of a data set.

    In all of them a tenth of each record's values is left out at either end.
    """

    # Smallest and largest peak rate (V/s) of a movement between two turning points
    slowest_V_s: float
    fastest_V_s: float
    rate_factor: float  # Largest over smallest rate of a sample while the command moves
    pace_factor: float  # Largest over smallest pace of a movement: its peak rate by its size

    @property
    def alike(self) -> bool:
        """Whether larger thresholds or a delay are indistinguishable from δ2."""
        return min(self.rate_factor, self.pace_factor) < _ALIKE


def rate_spread(stack: Stack) -> RateSpread:
    """Compare the rates in all records.

    Where the command always moves at the same rate, δ2 |v| is a constant that the thresholds at
    rest hold as well; where every movement takes the same time, a delay does what δ2 does.
    """
    rates, peaks, paces = [], [], []
    for r in range(stack.edges.size - 1):
        part = stack.record(r)
        speed = np.abs(stack.rate_V_s[part])
        rates.append(_inner(speed[speed > _RESTING * speed.max()]))
        for ripple in _RIPPLES:
            size, peak = movements(stack.u_V[part], stack.rate_V_s[part], ripple)
            peaks.append(_inner(peak))
            moved = size > 0.0
            if moved.any():
                paces.append(_inner(peak[moved] / size[moved]))
    slowest, fastest = np.min(peaks), np.max(peaks)
    return RateSpread(
        slowest_V_s=float(slowest),
        fastest_V_s=float(fastest),
        rate_factor=float(np.max(rates) / np.min(rates)),
        pace_factor=float(np.max(paces) / np.min(paces)),
    )


def _inner(values: Array) -> tuple[float, float]:
    tenth = values.size // 10
    parted = np.partition(values, (tenth, values.size - 1 - tenth))
    return float(parted[tenth]), float(parted[-1 - tenth])


def movements(u_V: Array, rate_V_s: Array, ripple: float) -> tuple[Array, Array]:
    """Size (V) and peak rate (V/s) of each larger movement between two turning points.

    The first and the last movement of a record are cut off by it and left out, unless there is no
    other.
    """
    turns = np.empty(u_V.size + 2, dtype=np.int64)
    turns = turns[: _turning_points(u_V, ripple * float(np.ptp(u_V)), turns)]
    if turns.size > 3:
        turns = turns[1:-1]
    size = np.abs(np.diff(u_V[turns]))
    speed = np.abs(rate_V_s[1 : turns[-1] + 1])  # a sample's rate is that of the way to it
    peak = np.maximum.reduceat(speed, turns[:-1])
    large = size >= _SMALL * size.max()
    return size[large], peak[large]


@njit(cache=True)
def _turning_points(u: Array, ripple: float, turns: NDArray[np.int64]) -> int:
    """Fill in the first and last sample and the turning points between, ripple ignored; count them."""
    turns[0] = 0
    count = 1
    low, high = 0, 0  # where the lowest and highest command since the last turning point stand
    direction = 0
    for t in range(u.shape[0]):
        if u[t] < u[low]:
            low = t
        if u[t] > u[high]:
            high = t
        if direction >= 0 and u[high] - u[t] > ripple:
            if direction > 0:
                turns[count] = high
                count += 1
            direction, low = -1, t
        elif direction <= 0 and u[t] - u[low] > ripple:
            if direction < 0:
                turns[count] = low
                count += 1
            direction, high = 1, t
    turns[count] = u.shape[0] - 1
    return count + 1
