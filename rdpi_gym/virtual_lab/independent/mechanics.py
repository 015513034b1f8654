"""Mechanics on a fine grid: mass and spring, a gap, visco-elastic creep."""

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
    state[:] = (last, x, v)
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


TWINS = (
    Twin("creep", 1, 10, lambda grid, **values: Viscoelasticity(**values, step_s=grid.step_s)),
    Twin("resonance", 2, 20, lambda grid, **values: Vibration(**values, step_s=grid.step_s)),
    Twin("backlash", 12, 30, lambda grid, **values: Gap(**values)),
)
"""Effects of what the ceramic moves."""
