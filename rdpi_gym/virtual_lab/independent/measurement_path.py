"""Between mechanics and measurement, on a fine grid: slow changes, delay, hum."""

from __future__ import annotations

import math

import numpy as np

from rdpi_gym.support.arrays import Array
from rdpi_gym.virtual_lab.independent.twin import Twin


class _Clocked:
    """Something that knows the time of its samples: `start_s` and the grid's step (s)."""

    def __init__(self, start_s: float, step_s: float) -> None:
        self._start, self._step, self._count = start_s, step_s, 0

    def _times(self, x: Array) -> Array:
        times = self._start + np.arange(self._count, self._count + len(x)) * self._step
        self._count += len(x)
        return np.asarray(times, dtype=np.float64)


class Ageing(_Clocked):
    """Gain that grows by `rate_per_s` of its first value a second."""

    def __init__(self, rate_per_s: float, start_s: float, step_s: float) -> None:
        super().__init__(start_s, step_s)
        self._rate = rate_per_s

    def __call__(self, x: Array) -> Array:
        """Displacement with the gain of its time."""
        return x * (1.0 + self._rate * self._times(x))


class Warming(_Clocked):
    """Expansion that begins at `rate_um_s` and settles with a time constant (s)."""

    def __init__(
        self, rate_um_s: float, time_constant_s: float, start_s: float, step_s: float
    ) -> None:
        super().__init__(start_s, step_s)
        self._final, self._tau = rate_um_s * time_constant_s, time_constant_s

    def __call__(self, x: Array) -> Array:
        """Displacement with the expansion of its time."""
        return x + self._final * (1.0 - np.exp(-self._times(x) / self._tau))


class Hum(_Clocked):
    """Line of the mains, as the imaginary part of a turning pointer."""

    def __init__(
        self, amplitude_um: float, frequency_hz: float, phase_rad: float, start_s: float, step_s: float
    ) -> None:  # fmt: skip
        super().__init__(start_s, step_s)
        self._pointer = amplitude_um * complex(math.cos(phase_rad), math.sin(phase_rad))
        self._turn = 2j * math.pi * frequency_hz

    def __call__(self, x: Array) -> Array:
        """Measurement with the line."""
        return np.asarray(x + (self._pointer * np.exp(self._turn * self._times(x))).imag)


class Line:
    """Line that holds the past: what comes out went in `delay_s` ago."""

    def __init__(self, delay_s: float, step_s: float) -> None:
        self._samples = delay_s / step_s
        self._past: Array | None = None

    def __call__(self, x: Array) -> Array:
        """What leaves the line; between two points of the grid it is linear."""
        kept = math.ceil(self._samples) + 1
        if self._past is None:
            self._past = np.full(kept, x[0])
        line = np.concatenate([self._past, x])
        self._past = line[-kept:].copy()
        whole, part = divmod(self._samples, 1.0)
        end = len(line) - int(whole)
        newer, older = line[end - len(x) : end], line[end - len(x) - 1 : end - 1]
        return np.asarray(newer + part * (older - newer), dtype=np.float64)


TWINS = (
    Twin("gain_drift", 10, 40, lambda grid, **values: Ageing(**values, **vars(grid))),
    Twin("thermal_drift", 9, 50, lambda grid, **values: Warming(**values, **vars(grid))),
    Twin("delay", 5, 60, lambda grid, **values: Line(**values, step_s=grid.step_s)),
    Twin("mains_hum", 13, 80, lambda grid, **values: Hum(**values, **vars(grid))),
)
"""Effects between the mechanics and the record."""
