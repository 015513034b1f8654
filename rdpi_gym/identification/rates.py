"""How fast the commands of a data set go: whether they tell rate from lag at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.identification.stack import Stack
from rdpi_gym.support.arrays import Array

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
    """How much the rates of a data set differ.

    Parameters
    ----------
    slowest_V_s, fastest_V_s
        Smallest and largest peak rate (V/s) of a movement between two turning points.
    rate_factor
        Largest over smallest rate of a sample while the command moves.
    pace_factor
        Largest over smallest pace of a movement: its peak rate by its size.

    In all of them a tenth of each record's values is left out at either end.
    """

    slowest_V_s: float
    fastest_V_s: float
    rate_factor: float
    pace_factor: float

    @property
    def alike(self) -> bool:
        """Whether larger thresholds, or a delay, would do what δ2 does."""
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
    turns = _turning_points(u_V, ripple * float(np.ptp(u_V)))
    if turns.size > 3:
        turns = turns[1:-1]
    size = np.abs(np.diff(u_V[turns]))
    speed = np.abs(rate_V_s[1 : turns[-1] + 1])  # a sample's rate is that of the way to it
    peak = np.maximum.reduceat(speed, turns[:-1])
    large = size >= _SMALL * size.max()
    return size[large], peak[large]


@njit(cache=True)
def _turning_points(u: Array, ripple: float) -> NDArray[np.int64]:
    """Indices of the first and last sample and of the turning points between, ripple ignored."""
    turns = [0]
    low, high = 0, 0  # where the lowest and highest command since the last turning point stand
    direction = 0
    for t in range(u.shape[0]):
        if u[t] < u[low]:
            low = t
        if u[t] > u[high]:
            high = t
        if direction >= 0 and u[high] - u[t] > ripple:
            if direction > 0:
                turns.append(high)
            direction, low = -1, t
        elif direction <= 0 and u[t] - u[low] > ripple:
            if direction < 0:
                turns.append(low)
            direction, high = 1, t
    turns.append(u.shape[0] - 1)
    return np.array(turns)
