"""Broadband signals: multisine, band-limited noise, chirp, decaying sine, random processes."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import ArrayLike, NDArray

from rdpi_gym.signals.base import ROUNDING, Signal, number, positive, refuse, whole
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

MOST_LINES = 5000


@dataclass(frozen=True, kw_only=True)
class LineSpectrum(Signal):
    """Sines of equal amplitude and random phase at equally spaced lines; its peak is the amplitude.

    Parameters
    ----------
    seed
        Seed of the phases, 0 or more.
    """

    seed: int = whole(0, minimum=0)

    @property
    @abstractmethod
    def period_s(self) -> float:
        """Time after which the signal repeats (s)."""

    @property
    @abstractmethod
    def _harmonics(self) -> range:
        """The lines, in multiples of one over the period."""

    @cached_property
    def lines_hz(self) -> Array:
        """The frequencies of the lines (Hz)."""
        return np.array(self._harmonics) / self.period_s

    @cached_property
    def crest_factor(self) -> float:
        """Peak over root mean square."""
        return float(self._peak / math.sqrt(0.5 * len(self._harmonics)))

    @cached_property
    def _phasors(self) -> NDArray[np.complex128]:
        turns = np.random.default_rng(self.seed).uniform(0.0, 1.0, len(self._harmonics))
        phasors: NDArray[np.complex128] = np.exp(2j * np.pi * turns)
        return phasors

    @cached_property
    def _peak(self) -> float:
        """Largest absolute value of the sum, found on a grid and sharpened by Newton's method."""
        harmonics = np.array(self._harmonics)
        points = 16 * int(harmonics[-1])
        spectrum = np.zeros(points // 2 + 1, dtype=np.complex128)
        spectrum[harmonics] = -0.5j * points * self._phasors
        size = np.abs(np.fft.irfft(spectrum, points))
        # At 16 points a period of the highest line, the grid misses at most 2 % of a peak.
        summit = (size >= np.roll(size, 1)) & (size >= np.roll(size, -1))
        t = np.flatnonzero(summit & (size >= 0.98 * size.max())) / points * self.period_s
        for _ in range(4):
            t = t - self._sum(t, order=1) / self._sum(t, order=2)
        return float(max(size.max(), np.abs(self._sum(t, order=0)).max()))

    def _sum(self, t: Array, order: int) -> Array:
        """Return the `order`-th derivative of the sum, as a polynomial in exp(2πi t / period)."""
        harmonics = self._harmonics
        coefficients = self._phasors * (2j * np.pi * self.lines_hz) ** order
        turns = np.mod(t / self.period_s, 1.0)
        step = np.exp(2j * np.pi * harmonics.step * turns)
        first = np.exp(2j * np.pi * harmonics.start * turns)
        return np.asarray((first * polyval(step, coefficients)).imag, dtype=np.float64)

    def _shape(self, t: Array) -> Array:
        return self._sum(t, order=0) / self._peak

    def _shape_rate(self, t: Array) -> Array:
        return self._sum(t, order=1) / self._peak


@dataclass(frozen=True, kw_only=True)
class Multisine(LineSpectrum):
    """A periodic random-phase multisine over the first lines, all of them or the odd ones.

    Odd lines only leave the even ones free to show even nonlinearities (R. Pintelon, J. Schoukens,
    System Identification: A Frequency Domain Approach, 2012).

    Parameters
    ----------
    frequency_hz
        Frequency of the first line (Hz); the signal repeats after one over it.
    lines
        How many lines, 1 to 5000.
    odd
        Whether only odd multiples of ``frequency_hz`` are excited.

    Examples
    --------
    >>> Multisine(frequency_hz=10.0, lines=3, odd=True).lines_hz
    array([10., 30., 50.])
    """

    name: ClassVar[str] = "multisine"
    frequency_hz: float = positive(1.0)
    lines: int = whole(16, minimum=1, maximum=MOST_LINES)
    odd: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.odd, bool | np.bool_):
            raise refuse(self, "odd", "True or False")
        object.__setattr__(self, "odd", bool(self.odd))

    @property
    def period_s(self) -> float:
        """One over the frequency (s)."""
        return 1.0 / self.frequency_hz

    @property
    def _harmonics(self) -> range:
        return range(1, 2 * self.lines, 2) if self.odd else range(1, self.lines + 1)


@dataclass(frozen=True, kw_only=True)
class BandLimitedNoise(LineSpectrum):
    """Noise of a flat spectrum within a band and nothing outside it, repeating after a long time.

    Parameters
    ----------
    low_hz, high_hz
        The band (Hz); a ``low_hz`` of 0 begins at the first line.
    repeat_s
        Time after which it repeats (s); the lines are 1 / ``repeat_s`` apart. At most 5000 lines
        may lie in the band: the time to evaluate is in proportion to their number.

    Examples
    --------
    >>> noise = BandLimitedNoise(low_hz=5.0, high_hz=20.0, repeat_s=4.0, seed=1)
    >>> noise.lines_hz[[0, 1, -1]]
    array([ 5.  ,  5.25, 20.  ])
    """

    name: ClassVar[str] = "noise"
    low_hz: float = number(0.0, minimum=0.0)
    high_hz: float = positive(50.0)
    repeat_s: float = positive(10.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        # a product that no float holds has no floor
        is_countable = max(self.low_hz, self.high_hz) * self.repeat_s < 1e15
        lines = len(self._harmonics) if is_countable else math.inf
        if not 1 <= lines <= MOST_LINES:
            raise InputError(
                f"noise: {float(lines):g} lines 1 / {self.repeat_s:g} s apart lie between "
                f"low_hz = {self.low_hz:g} and high_hz = {self.high_hz:g}; "
                f"choose these three fields for 1 to {MOST_LINES} lines"
            )

    @property
    def period_s(self) -> float:
        """The time after which it repeats (s)."""
        return self.repeat_s

    @property
    def _harmonics(self) -> range:
        # The bounds belong to the band although 0.3 * 10 is not 3 in binary.
        low = math.ceil(self.low_hz * self.repeat_s * (1.0 - 1e-12))
        high = math.floor(self.high_hz * self.repeat_s * (1.0 + 1e-12))
        return range(max(low, 1), high + 1)


MOST_INCREMENTS = 10_000_000


@dataclass(frozen=True, kw_only=True)
class RandomWalk(Signal):
    """Independent increments on a grid, linear in between, reflected at -1 and 1; from 0 at t = 0.

    It is drawn for `duration_s`, after which it is retraced backwards, then forwards again, and so
    on: any time has its value, and a longer duration goes on from a shorter one.

    Parameters
    ----------
    seed
        Seed of the increments, 0 or more.
    interval_s
        Time from one increment to the next (s).
    spread_s
        Time in which the standard deviation grows to the amplitude where nothing reflects (s).
    duration_s
        Time that is drawn (s), at least `interval_s`.
    """

    seed: int = whole(0, minimum=0)
    interval_s: float = positive(0.01)
    spread_s: float = positive(1.0)
    duration_s: float = positive(60.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self._increments <= MOST_INCREMENTS:
            raise InputError(
                f"{self.name}: duration_s = {self.duration_s:g} holds {float(self._increments):g} intervals "
                f"of interval_s = {self.interval_s:g}; choose them for 1 to {MOST_INCREMENTS}"
            )

    @property
    def period_s(self) -> float:
        """Time forwards and backwards (s)."""
        return 2.0 * self._increments * self.interval_s

    @property
    def _increments(self) -> int:
        return math.floor(self.duration_s / self.interval_s + ROUNDING)

    @abstractmethod
    def _draw(self, rng: np.random.Generator, count: int) -> Array:
        """Return `count` increments of unit variance."""

    @cached_property
    def _knots(self) -> Array:
        """The walk on its grid: the free walk, folded into -1 to 1."""
        increments = self._draw(np.random.default_rng(self.seed), self._increments)
        free = np.cumsum(np.append(0.0, increments)) * math.sqrt(self.interval_s / self.spread_s)
        folded: Array = np.abs(np.mod(free - 1.0, 4.0) - 2.0) - 1.0
        return folded

    def _shape(self, t: Array) -> Array:
        position, _, index = self._place(t)
        knots = self._knots
        return knots[index] + (position - index) * (knots[index + 1] - knots[index])

    def _shape_rate(self, t: Array) -> Array:
        _, direction, index = self._place(t)
        knots = self._knots
        return direction / self.interval_s * (knots[index + 1] - knots[index])

    def _place(self, t: Array) -> tuple[Array, Array, NDArray[np.intp]]:
        """Return the place on the grid, the direction (1 or -1), and the knot to the left."""
        count = self._increments
        cycle: Array = np.mod(t / self.interval_s + ROUNDING, 2 * count)
        direction = np.where(cycle < count, 1.0, -1.0)
        rounded = np.where(cycle < count, cycle, 2 * count - cycle)
        index = np.minimum(np.floor(rounded), count - 1).astype(np.intp)
        return rounded - direction * ROUNDING, direction, index


@dataclass(frozen=True, kw_only=True)
class WienerProcess(RandomWalk):
    """A random walk with normally distributed increments.

    Examples
    --------
    >>> walk = WienerProcess(amplitude_um=20.0, interval_s=1e-3, spread_s=0.5, seed=4)
    >>> bool((abs(walk([1.0, 5.0, 20.0])) <= 20.0).all())
    True
    """

    name: ClassVar[str] = "wiener"

    def _draw(self, rng: np.random.Generator, count: int) -> Array:
        return rng.standard_normal(count)


@dataclass(frozen=True, kw_only=True)
class LaplaceProcess(RandomWalk):
    """A random walk with Laplace distributed increments: long calm, now and then a large move.

    Examples
    --------
    >>> LaplaceProcess(seed=1) == LaplaceProcess().with_seed(1)
    True
    """

    name: ClassVar[str] = "laplace"

    def _draw(self, rng: np.random.Generator, count: int) -> Array:
        return rng.laplace(scale=math.sqrt(0.5), size=count)


@dataclass(frozen=True, kw_only=True)
class Chirp(Signal):
    """A sine whose frequency goes from one to another, where it then stays.

    Parameters
    ----------
    start_hz, stop_hz
        Frequency at t = 0 and from ``duration_s`` on (Hz); up or down.
    duration_s
        Time of the sweep (s).
    sweep
        ``linear``: equal steps of frequency in equal times; ``logarithmic``: equal ratios.

    Examples
    --------
    >>> chirp = Chirp(start_hz=1.0, stop_hz=100.0, duration_s=10.0, sweep="logarithmic")
    >>> round(float(chirp.instantaneous_hz(5.0)), 6)
    10.0
    """

    name: ClassVar[str] = "chirp"
    start_hz: float = positive(1.0)
    stop_hz: float = positive(100.0)
    duration_s: float = positive(10.0)
    sweep: Literal["linear", "logarithmic"] = "linear"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.sweep, str) or self.sweep not in ("linear", "logarithmic"):
            raise refuse(self, "sweep", "'linear' or 'logarithmic'")

    def instantaneous_hz(self, t: ArrayLike) -> Array:
        """Return the frequency (Hz) at times `t` (s), 0 or later."""
        part = np.minimum(np.asarray(t, dtype=np.float64) / self.duration_s, 1.0)
        if self.sweep == "linear":
            return self.start_hz + (self.stop_hz - self.start_hz) * part
        return self.start_hz * np.exp(part * math.log(self.stop_hz / self.start_hz))

    def _cycles(self, t: Array) -> Array:
        """Integrate the instantaneous frequency from 0 to `t`."""
        swept = np.minimum(t, self.duration_s)
        part = swept / self.duration_s
        log_ratio = math.log(self.stop_hz / self.start_hz)
        if self.sweep == "linear" or log_ratio == 0.0:
            cycles = swept * (self.start_hz + 0.5 * (self.stop_hz - self.start_hz) * part)
        else:
            cycles = self.start_hz * self.duration_s * np.expm1(part * log_ratio) / log_ratio
        return cycles + self.stop_hz * (t - swept)

    def _shape(self, t: Array) -> Array:
        return np.sin(2.0 * np.pi * self._cycles(t))

    def _shape_rate(self, t: Array) -> Array:
        return 2.0 * np.pi * self.instantaneous_hz(t) * np.cos(2.0 * np.pi * self._cycles(t))


@dataclass(frozen=True, kw_only=True)
class DecayingSine(Signal):
    """``exp(-t / decay_s) sin(2π frequency_hz t)``: loops that shrink, each inside the last.

    Parameters
    ----------
    frequency_hz
        Frequency (Hz).
    decay_s
        Time in which the amplitude falls to 37 % (s).

    Examples
    --------
    >>> round(float(DecayingSine(frequency_hz=1.0, decay_s=1.0)(0.25)), 4)
    0.7788
    """

    name: ClassVar[str] = "decaying-sine"
    frequency_hz: float = positive(1.0)
    decay_s: float = positive(2.0)

    def _shape(self, t: Array) -> Array:
        return np.exp(-t / self.decay_s) * np.sin(2.0 * np.pi * self.frequency_hz * t)

    def _shape_rate(self, t: Array) -> Array:
        omega = 2.0 * np.pi * self.frequency_hz
        turn = omega * np.cos(omega * t) - np.sin(omega * t) / self.decay_s
        return np.exp(-t / self.decay_s) * turn
