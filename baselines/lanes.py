"""Arrays of lanes: limits of commands, a memory by names, and products summed in order."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.support.arrays import Array


class Limits(NamedTuple):
    """Lowest and highest command (V) and its largest change in one sample (V).

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> Limits.of(ObservationLayout.for_plant(named_plant("P5"), ts_s=1e-4))
    Limits(low_V=-25.0, high_V=25.0, step_V=inf)
    """

    low_V: float
    high_V: float
    step_V: float

    @classmethod
    def of(cls, layout: ObservationLayout) -> Limits:
        """Return what a layout allows; only actions read as increments limit the change."""
        low, high = layout.command_range_V
        step = layout.action_scale_V if layout.action == "increment" else math.inf
        return cls(float(low), float(high), float(step))

    @property
    def rest_V(self) -> float:
        """Command nearest 0 V (V), where an episode begins."""
        return min(max(0.0, self.low_V), self.high_V)


@njit(cache=True)
def limited(command: float, last: float, low: float, high: float, step: float) -> float:
    """Return what is allowed of one command (V) after `last` (V; NaN: no command yet)."""
    allowed = min(max(command, low), high)
    if not np.isnan(last):
        allowed = min(max(allowed, last - step), last + step)
    return allowed


@njit(cache=True)
def limit_block(u: Array, last: Array, low: float, high: float, step: float) -> None:
    """Clip commands to their range and to the largest change from sample to sample, in place."""
    for t in range(u.shape[0]):
        for b in range(u.shape[1]):
            last[b] = u[t, b] = limited(u[t, b], last[b], low, high, step)


class Rows:
    """Named blocks of rows of a memory ``float64[S, B]``.

    Examples
    --------
    >>> import numpy as np
    >>> rows = Rows(last_V=1, measured_um=3)
    >>> memory = np.zeros((rows.total, 2))
    >>> rows.of(memory, "measured_um")[:] = 1.0
    >>> memory[:, 0].tolist()
    [0.0, 1.0, 1.0, 1.0]
    """

    def __init__(self, **counts: int) -> None:
        self._slices: dict[str, slice] = {}
        self.total, self.names = 0, tuple(counts)
        for name, count in counts.items():
            self._slices[name] = slice(self.total, self.total + count)
            self.total += count

    def of(self, memory: Array, name: str) -> Array:
        """Return a block as a view, float64[rows, B]."""
        return memory[self._slices[name]]


def shift_in(ring: Array, newest: Array) -> None:
    """Move a block on by one: its oldest entry is dropped and `newest` becomes its last, in place."""
    ring[:-1] = ring[1:].copy()
    ring[-1] = newest


def product(matrix: Array, columns: Array) -> Array:
    """Return ``matrix @ columns``, terms added one after the other.

    A library's product takes them in an order that hangs on the number of lanes, so that what a
    controller does in one of them differs in the last digit.
    """
    if not matrix.size:  # a model without states
        return np.zeros((*matrix.shape[:-1], columns.shape[1]))
    # One layout, so that one compiled kernel serves all: two that are kept by two processes at once
    # may be mistaken for one another.
    rows = np.require(np.atleast_2d(matrix), np.float64, ["C", "W"])
    found: Array = _products(rows, np.ascontiguousarray(columns))
    return found[0] if matrix.ndim == 1 else found


@njit(cache=True)
def _products(matrix: Array, columns: Array) -> Array:
    rows, terms = matrix.shape
    out = np.zeros((rows, columns.shape[1]))
    for r in range(rows):
        for k in range(terms):
            for b in range(columns.shape[1]):
                out[r, b] += matrix[r, k] * columns[k, b]
    return out


@njit(cache=True)
def lane_products(one: Array, other: Array) -> Array:
    """Return Σ_k one[k] other[k] of every lane, terms added one after the other."""
    out = np.zeros(one.shape[1])
    for k in range(one.shape[0]):
        for b in range(one.shape[1]):
            out[b] += one[k, b] * other[k, b]
    return out
