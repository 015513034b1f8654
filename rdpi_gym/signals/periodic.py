"""Signals of one frequency: sine, triangle, sawtooth, nested loops, the axes of a raster scan."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from rdpi_gym.signals.base import ROUNDING, Signal, number, numbers, positive, refuse, whole
from rdpi_gym.signals.steps import Staircase
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Periodic(Signal):
    """A signal with a frequency and a phase.

    Parameters
    ----------
    frequency_hz
        Frequency (Hz), above 0.
    phase_rad
        Phase at t = 0 (rad); 2π is one period.
    """

    frequency_hz: float = positive(1.0)
    phase_rad: float = number(0.0)

    @property
    def period_s(self) -> float:
        """One over the frequency (s)."""
        return 1.0 / self.frequency_hz

    def _cycles(self, t: Array) -> Array:
        return self.frequency_hz * t + self.phase_rad / (2.0 * np.pi)


@dataclass(frozen=True, kw_only=True)
class Sine(Periodic):
    """``sin(2π frequency_hz t + phase_rad)``.

    Examples
    --------
    >>> Sine(amplitude_um=40.0, frequency_hz=80.0).period_s
    0.0125
    """

    name: ClassVar[str] = "sine"

    def _shape(self, t: Array) -> Array:
        return np.sin(2.0 * np.pi * self.frequency_hz * t + self.phase_rad)

    def _shape_rate(self, t: Array) -> Array:
        omega = 2.0 * np.pi * self.frequency_hz
        return omega * np.cos(omega * t + self.phase_rad)


@dataclass(frozen=True, kw_only=True)
class Triangle(Periodic):
    """A triangle of constant rate that starts upwards at 0, as the sine does.

    Examples
    --------
    >>> Triangle(frequency_hz=1.0)([0.0, 0.25, 0.5, 0.75])
    array([ 0.,  1.,  0., -1.])
    """

    name: ClassVar[str] = "triangle"

    def _shape(self, t: Array) -> Array:
        return ramps(self._cycles(t) + 0.25, rise=0.5)

    def _shape_rate(self, t: Array) -> Array:
        return self.frequency_hz * ramps_rate(self._cycles(t) + 0.25, rise=0.5)


@dataclass(frozen=True, kw_only=True)
class Sawtooth(Periodic):
    """A ramp that returns at once, or within a part of the period; it starts upwards at 0.

    Parameters
    ----------
    flyback_fraction
        Part of the period that the return takes, 0 to below 1; at 0 the return is a jump.

    Examples
    --------
    >>> Sawtooth(frequency_hz=1.0)([0.0, 0.25, 0.5, 0.75])
    array([ 0. ,  0.5, -1. , -0.5])
    >>> Sawtooth().has_derivative, Sawtooth(flyback_fraction=0.1).has_derivative
    (False, True)
    """

    name: ClassVar[str] = "sawtooth"
    flyback_fraction: float = number(0.0, minimum=0.0, maximum=0.999)

    @property
    def has_derivative(self) -> bool:
        """Whether the return takes time."""
        return self.flyback_fraction > 0.0

    def _shape(self, t: Array) -> Array:
        rise = 1.0 - self.flyback_fraction
        return ramps(self._cycles(t) + 0.5 * rise, rise)

    def _shape_rate(self, t: Array) -> Array:
        rise = 1.0 - self.flyback_fraction
        return self.frequency_hz * ramps_rate(self._cycles(t) + 0.5 * rise, rise)


def ramps(cycles: Array, rise: float, turnaround: float = 0.0) -> Array:
    """Return periodic ramps between -1 and 1, at -1 where `cycles` is whole."""
    if rise == 1.0:
        part = np.maximum(cycles - np.floor(cycles + ROUNDING), 0.0)
        return 2.0 * part - 1.0
    part = cycles - np.floor(cycles)
    sharp = np.interp(part, [0.0, rise, 1.0], [-1.0, 1.0, -1.0])
    if turnaround == 0.0:
        return sharp
    # A parabola cuts each corner; the ramps are steeper by 1 / (1 - turnaround), so that the
    # vertices of the parabolas lie at -1 and 1.
    curvature = 2.0 / (rise * (1.0 - rise) * turnaround)
    top: Array = np.maximum(0.5 * turnaround - np.abs(part - rise), 0.0)
    bottom: Array = np.maximum(0.5 * turnaround - np.abs(part - np.rint(part)), 0.0)
    return (sharp + 0.5 * curvature * (bottom**2 - top**2)) / (1.0 - turnaround)


def ramps_rate(cycles: Array, rise: float, turnaround: float = 0.0) -> Array:
    """Return the right-sided derivative of `ramps` (per period)."""
    if rise == 1.0:
        return np.full_like(cycles, 2.0)
    part = cycles + ROUNDING - np.floor(cycles + ROUNDING)
    up, down = 2.0 / rise, -2.0 / (1.0 - rise)
    if turnaround == 0.0:
        return np.where(part < rise, up, down)
    half, middle = 0.5 * turnaround, 0.5 * (up + down)
    corners = [0.0, half, rise - half, rise + half, 1.0 - half, 1.0]
    rate: Array = np.interp(
        cycles - np.floor(cycles), corners, [middle, up, up, down, down, middle]
    )
    return rate / (1.0 - turnaround)


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
    turning_points: tuple[float, ...] = numbers(first_order_reversals(5), count=2)
    frequency_hz: float = positive(1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
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
