"""Mechanics and measurement path on a fine grid: vibration, gap, visco-elastic creep, drifts, delay, hum."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from rdpi_gym.support.arrays import Array
from rdpi_gym.virtual_lab.independent.twin import Twin

# Creep lives on time constants of 10^-2.25 to 10^3.25 s, with the same density everywhere.
_FASTEST, _SLOWEST = -2.25, 3.25


@njit(cache=True)
def _vibrate(force: Array, step: float, w: float, damping: float, state: Array) -> Array:
    """Classical Runge-Kutta for x'' = w² (force - x) - 2 ζ w x'."""
    parts = math.ceil(w * step / 0.05)
    h = step / parts
    out = np.empty_like(force)
    last, x, v = state
    for k in range(len(force)):
        slope = (force[k] - last) / parts
        for i in range(parts):
            begin = last + i * slope
            middle, end = begin + 0.5 * slope, begin + slope
            a1 = w * w * (begin - x) - 2.0 * damping * w * v
            v2 = v + 0.5 * h * a1
            a2 = w * w * (middle - x - 0.5 * h * v) - 2.0 * damping * w * v2
            v3 = v + 0.5 * h * a2
            a3 = w * w * (middle - x - 0.5 * h * v2) - 2.0 * damping * w * v3
            v4 = v + h * a3
            a4 = w * w * (end - x - h * v3) - 2.0 * damping * w * v4
            x += h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
            v += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        last = force[k]
        out[k] = x
    state[0], state[1], state[2] = last, x, v
    return out


@njit(cache=True)
def _drag(x: Array, half_width: float, state: Array) -> Array:
    """Carry a load in a gap: it is moved by what the gap cannot take."""
    out = np.empty_like(x)
    for k in range(len(x)):
        gap = state[1] + (x[k] - state[0])
        kept = min(max(gap, -half_width), half_width)
        state[2] += gap - kept
        state[0], state[1] = x[k], kept
        out[k] = state[2]
    return out


@njit(cache=True)
def _creep(x: Array, decay: Array, share: Array, elements: Array, last: float) -> Array:
    out = np.empty_like(x)
    for k in range(len(x)):
        middle = 0.5 * (last + x[k])
        last = x[k]
        total = x[k]
        for i in range(len(elements)):
            elements[i] = middle + decay[i] * (elements[i] - middle)
            total += share[i] * elements[i]
        out[k] = total
    return out


class Vibration:
    """Mass on a spring, at rest at the first sample."""

    def __init__(self, f0_hz: float, damping: float, step_s: float) -> None:
        self._w, self._damping, self._step = 2.0 * math.pi * f0_hz, damping, step_s
        self._state: Array | None = None

    def __call__(self, x: Array) -> Array:
        """Displacement for the force `x`, in µm of static displacement."""
        if self._state is None:
            self._state = np.array([x[0], x[0], 0.0])
        return np.asarray(_vibrate(x, self._step, self._w, self._damping, self._state))


class Gap:
    """Load that sits in the middle of a gap at the first sample."""

    def __init__(self, half_width_um: float) -> None:
        self._half_width = half_width_um
        self._state: Array | None = None

    def __call__(self, x: Array) -> Array:
        """Displacement of the load."""
        if self._state is None:
            self._state = np.array([x[0], 0.0, x[0]])
        return np.asarray(_drag(x, self._half_width, self._state))


class Viscoelasticity:
    """Continuous spectrum of Kelvin-Voigt elements, by Gauss-Legendre quadrature over log τ."""

    def __init__(self, gain_per_decade: float, step_s: float, nodes: int = 40) -> None:
        abscissae, weights = np.polynomial.legendre.leggauss(nodes)
        decades = 0.5 * (_SLOWEST - _FASTEST)
        tau = 10.0 ** (_FASTEST + decades * (abscissae + 1.0))
        self._decay = np.exp(-step_s / tau)
        self._share = gain_per_decade * decades * weights
        self._elements: Array | None = None
        self._last = 0.0

    def __call__(self, x: Array) -> Array:
        """Displacement with what has crept so far."""
        if self._elements is None:
            self._elements, self._last = np.full(len(self._share), x[0]), float(x[0])
        out = np.asarray(_creep(x, self._decay, self._share, self._elements, self._last))
        self._last = float(x[-1])
        return out


class _Clocked:
    """Mechanism with a clock: `start_s` and the grid's step (s)."""

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
        """Output of the line; between two points of the grid it is linear."""
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
    Twin("creep", 1, 10, lambda grid, **values: Viscoelasticity(**values, step_s=grid.step_s)),
    Twin("resonance", 2, 20, lambda grid, **values: Vibration(**values, step_s=grid.step_s)),
    Twin("backlash", 12, 30, lambda grid, **values: Gap(**values)),
    Twin("gain_drift", 10, 40, lambda grid, **values: Ageing(**values, **vars(grid))),
    Twin("thermal_drift", 9, 50, lambda grid, **values: Warming(**values, **vars(grid))),
    Twin("delay", 5, 60, lambda grid, **values: Line(**values, step_s=grid.step_s)),
    Twin("mains_hum", 13, 80, lambda grid, **values: Hum(**values, **vars(grid))),
)
"""Effects behind the ceramic."""
