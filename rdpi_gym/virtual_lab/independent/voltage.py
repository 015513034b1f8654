"""From the command to the voltage at the stack: the amplifier as a circuit, on a fine grid."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from rdpi_gym.support.arrays import Array
from rdpi_gym.virtual_lab.independent.twin import Twin


@njit(cache=True)
def _soften(u: Array, limit: float, centre: float) -> Array:
    out = np.empty_like(u)
    for k in range(len(u)):
        # Odd logistic curve with slope 1 in the middle.
        out[k] = centre + limit * (2.0 / (1.0 + math.exp(-2.0 * (u[k] - centre) / limit)) - 1.0)
    return out


@njit(cache=True)
def _charge_at_limited_current(u: Array, largest: float, last: float, start: float) -> Array:
    """Follow u, linear between the grid's points, by `largest` a step; finer steps while apart."""
    parts = 64
    out, voltage = np.empty_like(u), start
    for k in range(len(u)):
        change = u[k] - last
        if voltage == last and abs(change) <= largest:
            voltage = u[k]
        else:
            for i in range(1, parts + 1):
                missing = u[k] - change * (1.0 - i / parts) - voltage
                if abs(missing) > largest / parts:
                    missing = math.copysign(largest / parts, missing)
                voltage += missing
        last = u[k]
        out[k] = voltage
    return out


@njit(cache=True)
def _relax(u: Array, step: float, tau: float, last: float, start: float) -> Array:
    """Classical Runge-Kutta for τ x' = u - x, with u linear between the grid's points."""
    parts = math.ceil(step / (0.1 * tau))
    h = step / parts / tau
    out, x = np.empty_like(u), start
    for k in range(len(u)):
        slope = (u[k] - last) / parts
        for i in range(parts):
            begin = last + i * slope
            middle, end = begin + 0.5 * slope, begin + slope
            k1 = begin - x
            k2 = middle - (x + 0.5 * h * k1)
            k3 = middle - (x + 0.5 * h * k2)
            k4 = end - (x + h * k3)
            x += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        last = u[k]
        out[k] = x
    return out


class Softening:
    """Amplifier with an odd logistic characteristic: limit and centre (V)."""

    def __init__(self, limit_V: float, centre_V: float) -> None:
        self._limit, self._centre = limit_V, centre_V

    def __call__(self, u: Array) -> Array:
        """Voltage for the command `u`."""
        return np.asarray(_soften(u, self._limit, self._centre))


class CurrentLimit:
    """Amplifier that moves the voltage by `rate_V_s` times the grid's step (s) at most."""

    def __init__(self, rate_V_s: float, step_s: float) -> None:
        self._largest = rate_V_s * step_s
        self._last: float | None = None
        self._voltage = 0.0

    def __call__(self, u: Array) -> Array:
        """Voltage for the command `u`."""
        if self._last is None:
            self._last = self._voltage = float(u[0])
        out = np.asarray(_charge_at_limited_current(u, self._largest, self._last, self._voltage))
        self._last, self._voltage = float(u[-1]), float(out[-1])
        return out


class FirstOrder:
    """Differential equation τ x' = u - x, for the charging of the stack and for the sensor."""

    def __init__(self, time_constant_s: float, step_s: float) -> None:
        self._tau, self._step = time_constant_s, step_s
        self._last: float | None = None
        self._value = 0.0

    def __call__(self, u: Array) -> Array:
        """Value for the input `u`."""
        if self._tau == 0.0:
            return u
        if self._last is None:
            self._last = self._value = float(u[0])
        out = np.asarray(_relax(u, self._step, self._tau, self._last, self._value))
        self._last, self._value = float(u[-1]), float(out[-1])
        return out


TWINS = (
    Twin("saturation", 7, -30, lambda grid, **values: Softening(**values)),
    Twin("slew_limit", 8, -20, lambda grid, **values: CurrentLimit(**values, step_s=grid.step_s)),
    Twin("actuator_lag", 3, -10, lambda grid, **values: FirstOrder(**values, step_s=grid.step_s)),
    Twin("sensor_lag", 4, 70, lambda grid, **values: FirstOrder(**values, step_s=grid.step_s)),
)
"""Effects on the way to the stack, and the sensor that is such a first order too."""
