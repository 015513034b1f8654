"""A command cut at its reversals: every stretch has a direction, a frequency, an amplitude."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.support.arrays import Array

SMALLEST_SWING = 0.04
"""A reversal counts where the command then moves by this share of its peak to peak or more."""

# Of another size by this share of the usual one; fewer are how a record begins and ends.
_OTHER, _FEWEST_OTHERS = 0.1, 3

Values = TypeVar("Values", np.float64, np.bool_, np.intp)


@dataclass(frozen=True, eq=False)
class HalfCycles:
    """Stretches of a record from one reversal of the command to the next, H of them.

    Every stretch has a direction. Frequency and amplitude are NaN for the first and the last,
    which begin or end where the record does and not at a reversal, and for stretches in which
    the command mostly rests (steps and holds).

    Parameters
    ----------
    edges
        ``intp[H + 1]``; stretch h holds the samples ``edges[h]`` to ``edges[h + 1] - 1``, the
        last of which is the reversal.
    rising
        ``bool[H]``; whether the command rises.
    frequency_hz
        ``float64[H]``; one over twice the duration (Hz).
    amplitude_V
        ``float64[H]``; half of the way between the two reversals (V).
    """

    edges: NDArray[np.intp]
    rising: NDArray[np.bool_]
    frequency_hz: Array
    amplitude_V: Array

    @property
    def whole(self) -> NDArray[np.bool_]:
        """``bool[H]``: moving from reversal to reversal, so that it has a frequency."""
        return np.isfinite(self.frequency_hz)

    def by_sample(self, values: NDArray[Values]) -> NDArray[Values]:
        """Repeat a value of every stretch, ``(H,)``, for each of its samples, ``(N,)``."""
        return np.repeat(values, np.diff(self.edges))


def half_cycles(u_V: Array, ts_s: float) -> HalfCycles:
    """Cut a command at its reversals.

    Parameters
    ----------
    u_V
        Command (V), ``(N,)``.
    ts_s
        Sampling time (s).

    Returns
    -------
    HalfCycles
        Swings below `SMALLEST_SWING` of the command's peak to peak are ripple and no stretch of
        their own.

    Examples
    --------
    >>> t = np.arange(2000) * 1e-3
    >>> cycles = half_cycles(5.0 * np.sin(2 * np.pi * 3.0 * t), 1e-3)
    >>> cycles.frequency_hz[1:3].round(3).tolist(), cycles.amplitude_V[1:3].round(3).tolist()
    ([3.0, 3.0], [5.0, 5.0])
    """
    u = np.ascontiguousarray(u_V, dtype=np.float64)
    turns, rises_first = _reversals(u, SMALLEST_SWING * float(np.ptp(u)))
    count = turns.size + 1
    frequency_hz, amplitude_V = np.full(count, np.nan), np.full(count, np.nan)
    if turns.size > 1:
        times, extrema = _vertices(u, turns)
        frequency_hz[1:-1] = 0.5 / (np.diff(times) * ts_s)
        amplitude_V[1:-1] = 0.5 * np.abs(np.diff(extrema))
    edges = np.concatenate([[0], turns + 1, [u.size]]).astype(np.intp)
    resting = _resting(u, edges)
    frequency_hz[resting], amplitude_V[resting] = np.nan, np.nan
    rising = (np.arange(count) % 2 == 0) == rises_first
    return HalfCycles(edges, rising, frequency_hz, amplitude_V)


@njit(cache=True)
def _reversals(u: Array, swing: float) -> tuple[NDArray[np.intp], bool]:
    """Samples at which the command turned, and whether it rose first."""
    turns = np.empty(u.shape[0], dtype=np.intp)
    count = 0
    low = high = 0
    direction = 0
    rises_first = u[-1] >= u[0]
    for k in range(1, u.shape[0]):
        if u[k] > u[high]:
            high = k
        if u[k] < u[low]:
            low = k
        if direction <= 0 and u[k] - u[low] >= swing and u[k] > u[low]:
            if direction == 0:
                rises_first = True
            else:
                turns[count] = low
                count += 1
            direction, high = 1, k
        elif direction >= 0 and u[high] - u[k] >= swing and u[high] > u[k]:
            if direction == 0:
                rises_first = False
            else:
                turns[count] = high
                count += 1
            direction, low = -1, k
    return turns[:count].copy(), rises_first


@njit(cache=True)
def _resting(u: Array, edges: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Stretches that spend a third of their time within 2 % of their way (a sine: 9 %)."""
    resting = np.zeros(edges.shape[0] - 1, dtype=np.bool_)
    for h in range(resting.shape[0]):
        first, last = edges[h], edges[h + 1] - 1
        start = u[max(first - 1, 0)]
        way = u[last] - start
        count = np.zeros(51, dtype=np.int64)
        for k in range(first, last + 1):
            progress = (u[k] - start) / way if way != 0.0 else 0.0
            count[min(max(int(50.0 * progress), 0), 50)] += 1
        longest = max(count.max(), count[49] + count[50])
        resting[h] = longest > max(3, (last + 1 - first) // 3)
    return resting


def _vertices(u: Array, turns: NDArray[np.intp]) -> tuple[Array, Array]:
    """Where the parabola through a reversal and its two neighbours turns: sample, command."""
    before, at, after = u[turns - 1], u[turns], u[turns + 1]
    slope, bend = 0.5 * (after - before), before - 2.0 * at + after
    shift = np.divide(-slope, bend, out=np.zeros_like(bend), where=bend != 0.0)
    shift = np.clip(shift, -0.5, 0.5)
    return turns.astype(np.float64) + shift, at + slope * shift + 0.5 * bend * shift * shift


def vary(values: Array) -> bool:
    """Whether sizes or paces of half-cycles differ, more than a record's beginning and end make them."""
    usual = np.median(values)
    return int((np.abs(values - usual) > _OTHER * usual).sum()) >= _FEWEST_OTHERS
