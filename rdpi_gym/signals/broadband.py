"""Sums of sines with random phases: multisine, band-limited noise."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import NDArray

from rdpi_gym.signals.base import Signal
from rdpi_gym.signals.checks import refuse, set_integer, set_number, set_positive
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

    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        set_integer(self, "seed", minimum=0)

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
    frequency_hz: float = 1.0
    lines: int = 16
    odd: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        set_positive(self, "frequency_hz")
        set_integer(self, "lines", minimum=1, maximum=MOST_LINES)
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
    low_hz: float = 0.0
    high_hz: float = 50.0
    repeat_s: float = 10.0

    def __post_init__(self) -> None:
        super().__post_init__()
        set_number(self, "low_hz", minimum=0.0)
        set_positive(self, "high_hz", "repeat_s")
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
