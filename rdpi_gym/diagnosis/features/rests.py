"""Rests of a command."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.diagnosis.features.noise import rough_part
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array

_FLAT = 1e-4  # of the command's widest swing: a rest stays within it
_NOISY = 8.0  # times the roughness of a measured command
_FEWEST = 20
_BEFORE = 20.0  # times the tolerance: a move that ends in a rest is so large
_STOPS, _FEWEST_BEFORE = 4, 5  # of the rest's length; samples: within this it comes so far


@dataclass(frozen=True, eq=False)
class Rest:
    """A stretch of constant command."""

    record: Record  # where it stands
    # Its samples are ``first`` to ``last - 1``
    first: int
    last: int
    # Net change of the command in the move that ended in it; 0 at a record's beginning
    move_V: float

    @property
    def duration_s(self) -> float:
        """Duration from the first to the last sample (s)."""
        return (self.last - 1 - self.first) * self.record.ts_s


@njit(cache=True)
def _flat_runs(u: Array, tolerance: float, fewest: int) -> NDArray[np.intp]:
    runs = np.empty((u.shape[0] // fewest + 1, 2), dtype=np.intp)
    count = start = 0
    low = high = u[0]
    for k in range(1, u.shape[0] + 1):
        if k < u.shape[0]:
            low_k, high_k = min(low, u[k]), max(high, u[k])
            if high_k - low_k <= tolerance:
                low, high = low_k, high_k
                continue
        if k - start >= fewest:
            runs[count, 0], runs[count, 1] = start, k
            count += 1
        if k < u.shape[0]:
            start, low, high = k, u[k], u[k]
    return runs[:count]


def find_rests(record: Record, span_V: float) -> list[Rest]:
    """Find where a record's command rests; the crest of a slow wave is no rest, nor its shoulder."""
    u = record.u_V
    if u.size < _FEWEST:
        return []
    tolerance = max(_FLAT * span_V, _NOISY * rough_part(u))
    rests: list[Rest] = []
    for first, last in _flat_runs(np.ascontiguousarray(u), tolerance, _FEWEST):
        # a move that ends in a rest stops; a shoulder of a wave, however flat, does not
        before = u[max(0, first - max((last - first) // _STOPS, _FEWEST_BEFORE)) : first]
        far = before.size > 0 and float(np.max(np.abs(before - u[first]))) > _BEFORE * tolerance
        if first == 0 or far:
            end = rests[-1].last - 1 if rests else 0
            rests.append(Rest(record, int(first), int(last), float(u[first] - u[end])))
    return rests
