"""The test bench around a stage: converter period, sensor resolution and noise (Section IV-A)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite, shown
from rdpi_gym.support.errors import InputError

_LONGEST = 2**62
"""Samples of a period that no record ends; more are no machine's whole number."""


@dataclass(frozen=True)
class Sensor:
    """A displacement sensor: white noise, then rounding to its resolution.

    Parameters
    ----------
    resolution_um
        Smallest step of the reading (µm); 0 is a continuous reading.
    noise_um
        Standard deviation of the noise (µm).

    Raises
    ------
    InputError
        A value is negative or not finite.

    Examples
    --------
    >>> float(Sensor(resolution_um=0.01).read(np.array([1.2345]), np.random.default_rng(0))[0])
    1.23
    """

    resolution_um: float = 0.0
    noise_um: float = 0.0

    def __post_init__(self) -> None:
        for name in ("resolution_um", "noise_um"):
            value = getattr(self, name)
            if not (is_finite(value) and value >= 0):
                raise InputError(
                    f"sensor {name} is {shown(value)}; give a finite value of 0 µm or above"
                )

    def read(self, y_um: Array, rng: np.random.Generator) -> Array:
        """Return what the sensor shows of displacements `y_um` (µm, any shape)."""
        shown = y_um + self.noise_um * rng.standard_normal(y_um.shape) if self.noise_um else y_um
        if self.resolution_um:
            shown = np.round(shown / self.resolution_um) * self.resolution_um
        return np.asarray(shown, dtype=np.float64)


@dataclass(frozen=True)
class Converter:
    """A digital-to-analogue converter that holds its output for a period.

    Parameters
    ----------
    period_s
        Refresh period (s); 0 is none. It shows where the plant runs at a shorter Ts.

    Raises
    ------
    InputError
        The period is negative or not finite.

    Examples
    --------
    >>> Converter(period_s=5e-5).samples(1e-5)
    5
    """

    period_s: float = 0.0

    def __post_init__(self) -> None:
        if not (is_finite(self.period_s) and self.period_s >= 0):
            raise InputError(f"converter period_s is {shown(self.period_s)}; give 0 s or above")

    def samples(self, ts_s: float) -> int:
        """Samples of length `ts_s` (s) that one period holds: 1 where Ts is the period or longer.

        Raises
        ------
        InputError
            Ts is shorter than the period and does not divide it.
        """
        ratio = self.period_s / ts_s
        if ratio <= 1.0:
            return 1
        if abs(ratio - round(ratio)) > 1e-6 * ratio:
            raise InputError(
                f"ts_s = {ts_s} does not divide the converter period of {self.period_s} s; "
                f"take {self.period_s / math.ceil(ratio):.9g}"
            )
        return min(round(ratio), _LONGEST)


# KEYENCE LC2420: 10 nm resolution; its 100 nm precision is read as three standard deviations.
PAPER_SENSOR = Sensor(resolution_um=0.010, noise_um=0.1 / 3.0)
# dSPACE board: 50 µs refresh time.
PAPER_CONVERTER = Converter(period_s=5e-5)
