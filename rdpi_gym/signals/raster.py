"""The two axes of a raster scan."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from rdpi_gym.signals.base import Signal, number, positive, refuse, whole
from rdpi_gym.signals.periodic import Periodic, ramps, ramps_rate
from rdpi_gym.signals.steps import Staircase
from rdpi_gym.support.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Raster(Periodic):
    """The fast axis: trace and retrace of one line after the other, starting at -1.

    Parameters
    ----------
    frequency_hz
        Line rate (Hz): one trace and one retrace in a period.
    trace_fraction
        Part of the line that the trace takes, from one turning point to the other, 0.001 to 0.999.
    turnaround_fraction
        Part of the line that each turnaround takes, at constant acceleration, at most the shorter
        of trace and retrace; 0: sharp.

    Examples
    --------
    >>> sharp = Raster(frequency_hz=10.0, trace_fraction=0.75, turnaround_fraction=0.0)
    >>> sharp([0.0, 0.025, 0.05, 0.075])
    array([-1.        , -0.33333333,  0.33333333,  1.        ])
    """

    name: ClassVar[str] = "raster"
    trace_fraction: float = number(0.5, minimum=0.001, maximum=0.999)
    turnaround_fraction: float = number(0.1, minimum=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        shorter = min(self.trace_fraction, 1.0 - self.trace_fraction)
        if self.turnaround_fraction > shorter:
            raise refuse(
                self, "turnaround_fraction", f"at most the shorter of the two ways, {shorter:g}"
            )

    def _shape(self, t: Array) -> Array:
        return ramps(self._cycles(t), self.trace_fraction, self.turnaround_fraction)

    def _shape_rate(self, t: Array) -> Array:
        rate = ramps_rate(self._cycles(t), self.trace_fraction, self.turnaround_fraction)
        return self.frequency_hz * rate


@dataclass(frozen=True, kw_only=True)
class RasterSlowRamp(Signal):
    """The slow axis as a ramp from -1 to 1 within one frame, and back within the next.

    Parameters
    ----------
    frequency_hz
        Line rate of the fast axis (Hz).
    lines
        Lines in a frame, 2 or more.

    Examples
    --------
    >>> RasterSlowRamp(frequency_hz=10.0, lines=20)([0.0, 1.0, 2.0, 3.0])
    array([-1.,  0.,  1.,  0.])
    """

    name: ClassVar[str] = "raster-slow-ramp"
    frequency_hz: float = positive(1.0)
    lines: int = whole(64, minimum=2, maximum=1_000_000)

    @property
    def period_s(self) -> float:
        """Time of a frame up and a frame down (s)."""
        return 2.0 * self.lines / self.frequency_hz

    def _shape(self, t: Array) -> Array:
        return ramps(t / self.period_s, rise=0.5)

    def _shape_rate(self, t: Array) -> Array:
        return ramps_rate(t / self.period_s, rise=0.5) / self.period_s


@dataclass(frozen=True, kw_only=True)
class RasterSlowStairs(Staircase):
    """The slow axis at rest during each line: from -1 to 1 within one frame, back within the next.

    Parameters
    ----------
    frequency_hz
        Line rate of the fast axis (Hz).
    lines
        Lines in a frame, 2 or more.

    Examples
    --------
    >>> RasterSlowStairs(frequency_hz=10.0, lines=3)([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    array([-1.,  0.,  1.,  1.,  0., -1.])
    """

    name: ClassVar[str] = "raster-slow-stairs"
    frequency_hz: float = positive(1.0)
    lines: int = whole(64, minimum=2, maximum=1_000_000)

    @property
    def _hold_s(self) -> float:
        return 1.0 / self.frequency_hz

    @cached_property
    def _stairs(self) -> Array:
        up = np.linspace(-1.0, 1.0, self.lines)
        return np.concatenate([up, up[::-1]])
