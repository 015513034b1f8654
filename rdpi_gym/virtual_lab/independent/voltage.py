"""From the command to the voltage at the stack: the amplifier as a circuit, on a fine grid."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from rdpi_gym.support.arrays import Array
from rdpi_gym.virtual_lab.independent.twin import Grid, Mechanism, Twin, carried


@njit(cache=True)
def _soften(u: Array, limit: float, centre: float) -> Array:
    out = np.empty_like(u)
    for k in range(len(u)):
        # Odd logistic curve with slope 1 in the middle.
        out[k] = centre + limit * (2.0 / (1.0 + math.exp(-2.0 * (u[k] - centre) / limit)) - 1.0)
    return out


@njit(cache=True)
def _charge_at_limited_current(u: Array, largest: float, state: Array) -> Array:
    """Follow u, linear between the grid's points, by `largest` a step; finer steps while apart.

    The state is the last u and the voltage.
    """
    parts = 64
    out = np.empty_like(u)
    last, voltage = state
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
    state[:] = (last, voltage)
    return out


@njit(cache=True)
def _relax(u: Array, step: float, tau: float, state: Array) -> Array:
    """Classical Runge-Kutta for τ x' = u - x, u linear between the grid's points; state: u and x."""
    parts = math.ceil(step / (0.1 * tau))
    h = step / parts / tau
    out = np.empty_like(u)
    last, x = state
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
    state[:] = (last, x)
    return out


def softening(grid: Grid, limit_V: float, centre_V: float) -> Mechanism:
    """Amplifier with an odd logistic characteristic: limit and centre (V)."""
    return lambda u: np.asarray(_soften(u, limit_V, centre_V))


def current_limit(grid: Grid, rate_V_s: float) -> Mechanism:
    """Amplifier that moves the voltage by `rate_V_s` times the grid's step (s) at most."""
    largest = rate_V_s * grid.step_s
    return carried(_held_twice, lambda u, state: _charge_at_limited_current(u, largest, state))


def first_order(grid: Grid, time_constant_s: float) -> Mechanism:
    """Differential equation τ x' = u - x, for the charging of the stack and for the sensor."""
    if time_constant_s == 0.0:
        return lambda u: u
    return carried(_held_twice, lambda u, state: _relax(u, grid.step_s, time_constant_s, state))


def _held_twice(u: Array) -> Array:
    return np.array([u[0], u[0]])


TWINS = (
    Twin("saturation", 7, -30, softening),
    Twin("slew_limit", 8, -20, current_limit),
    Twin("actuator_lag", 3, -10, first_order),
    Twin("sensor_lag", 4, 70, first_order),
)
"""Effects on the way to the stack, and the sensor that is such a first order too."""
