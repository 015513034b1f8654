"""Sines whose frequency or amplitude changes: chirp, decaying sine."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from rdpi_gym.signals.base import Signal
from rdpi_gym.signals.checks import refuse, set_positive
from rdpi_gym.support.arrays import Array


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
    start_hz: float = 1.0
    stop_hz: float = 100.0
    duration_s: float = 10.0
    sweep: Literal["linear", "logarithmic"] = "linear"

    def __post_init__(self) -> None:
        super().__post_init__()
        set_positive(self, "start_hz", "stop_hz", "duration_s")
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
    frequency_hz: float = 1.0
    decay_s: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        set_positive(self, "frequency_hz", "decay_s")

    def _shape(self, t: Array) -> Array:
        return np.exp(-t / self.decay_s) * np.sin(2.0 * np.pi * self.frequency_hz * t)

    def _shape_rate(self, t: Array) -> Array:
        omega = 2.0 * np.pi * self.frequency_hz
        turn = omega * np.cos(omega * t) - np.sin(omega * t) / self.decay_s
        return np.exp(-t / self.decay_s) * turn
