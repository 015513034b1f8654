"""Sensor noise that is not white: a wander, and the mains."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from rdpi_gym.support.arrays import Array


@dataclass(frozen=True)
class NoiseLaw:
    """What a sensor adds, in units of the standard deviation that its plant states.

    Parameters
    ----------
    white
        Standard deviation of the white part.
    wander
        Standard deviation of the coloured part, white noise through a first-order low-pass.
    corner_hz
        Corner (Hz) of that low-pass.
    hum
        Amplitude of the mains, at 50 Hz, its phase drawn for each episode.

    Examples
    --------
    >>> NoiseLaw(white=1.0, wander=2.0, corner_hz=5.0, hum=0.0).rms
    2.23606797749979
    """

    white: float = 1.0
    wander: float = 0.0
    corner_hz: float = 5.0
    hum: float = 0.0

    @property
    def rms(self) -> float:
        """Root mean square of the whole."""
        return math.sqrt(self.white**2 + self.wander**2 + 0.5 * self.hum**2)


class ColouredNoise:
    """Noise that remembers: a :class:`~rdpi_gym.envs.tracking.NoiseSource`.

    Parameters
    ----------
    law
        Its parts.
    ts_s
        Sampling time (s).
    rng
        Where it comes from.

    Examples
    --------
    >>> law = NoiseLaw(wander=2.0, hum=1.0)
    >>> noise = ColouredNoise(law, 1e-4, np.random.default_rng(0)).standard_normal(100_000)
    >>> bool(abs(noise.std() / law.rms - 1.0) < 0.1)
    True
    """

    def __init__(self, law: NoiseLaw, ts_s: float, rng: np.random.Generator) -> None:
        self._law, self._ts_s, self._rng = law, ts_s, rng
        self._phase = rng.uniform(0.0, 2.0 * math.pi)
        self._wander = np.array([rng.standard_normal()])
        self._count = 0

    def standard_normal(self, size: int, /) -> Array:
        """Return the next numbers, ``float64[size]``."""
        law, rng = self._law, self._rng
        white, driven = rng.standard_normal(size), rng.standard_normal(size)
        pole = math.exp(-2.0 * math.pi * law.corner_hz * self._ts_s)
        gain = math.sqrt(1.0 - pole**2)
        wander, last = lfilter([gain], [1.0, -pole], driven, zi=pole * self._wander)
        self._wander = last / pole if pole else last
        time = self._ts_s * np.arange(self._count, self._count + size)
        self._count += size
        hum = law.hum * np.sin(2.0 * math.pi * 50.0 * time + self._phase)
        return np.asarray(law.white * white + law.wander * wander + hum)
