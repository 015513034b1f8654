"""Minor loops: ramps of one rate between given turning points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from rdpi_gym.signals.base import ROUNDING, Signal
from rdpi_gym.signals.checks import refuse, set_numbers, set_positive
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError


def first_order_reversals(loops: int) -> tuple[float, ...]:
    """Return turning points for first-order reversal curves: from 1 down, and back to 1, deeper.

    Parameters
    ----------
    loops
        How many loops, 1 or more; the last goes to -1 and is the major loop.

    Raises
    ------
    InputError
        `loops` is below 1.

    Examples
    --------
    >>> first_order_reversals(2)
    (1.0, 0.0, 1.0, -1.0)
    """
    if loops < 1:
        raise InputError(f"loops is {loops!r}; give 1 loop or more")
    lows = 1.0 - 2.0 * np.arange(1, loops + 1) / loops
    return tuple(float(point) for low in lows for point in (1.0, low))


@dataclass(frozen=True, kw_only=True)
class NestedLoops(Signal):
    """Ramps of constant rate from turning point to turning point, then from the first again.

    It begins on the way from the last point to the first, where that is nearest to 0: with first-
    order reversal curves at 0, upwards.

    Parameters
    ----------
    turning_points
        The turning points, in units of the amplitude, none equal to the one before it.
    frequency_hz
        Frequency of the major loop (Hz), from -1 to 1 and back: the rate is 4 amplitudes times it.

    Examples
    --------
    >>> forc = NestedLoops(turning_points=first_order_reversals(2), frequency_hz=1.0)
    >>> forc([0.0, 0.25, 0.5, 0.75, 1.25, 1.5])
    array([ 0.,  1.,  0.,  1., -1.,  0.])
    >>> forc.period_s
    1.5
    """

    name: ClassVar[str] = "nested-loops"
    turning_points: tuple[float, ...] = first_order_reversals(5)
    frequency_hz: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        set_positive(self, "frequency_hz")
        set_numbers(self, "turning_points", count=2)
        if not np.diff(self.turning_points, append=self.turning_points[0]).all():
            raise refuse(self, "turning_points", "points that each differ from the one before")

    @property
    def period_s(self) -> float:
        """Time through all turning points (s)."""
        return float(self._corners[0][-1])

    @cached_property
    def _corners(self) -> tuple[Array, Array]:
        """Times (s) and values of one period, from the start to the start."""
        first, last = self.turning_points[0], self.turning_points[-1]
        start = float(np.clip(0.0, min(first, last), max(first, last)))
        values = np.array([start, *self.turning_points, start])
        times = np.cumsum(np.abs(np.diff(values, prepend=start))) / (4.0 * self.frequency_hz)
        return times, values

    def _shape(self, t: Array) -> Array:
        times, values = self._corners
        within: Array = np.mod(t, times[-1])
        return np.interp(within, times, values)

    def _shape_rate(self, t: Array) -> Array:
        times, values = self._corners
        directions: Array = np.sign(np.diff(values))
        within: Array = np.mod(t + ROUNDING / self.frequency_hz, times[-1])
        return 4.0 * self.frequency_hz * directions[np.searchsorted(times, within, "right") - 1]
