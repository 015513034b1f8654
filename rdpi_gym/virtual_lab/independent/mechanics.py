"""Mechanisms on a fine grid, from the amplifier as a circuit to vibration, gap, creep, drifts, delay and hum."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from rdpi_gym.support.arrays import Array
from rdpi_gym.virtual_lab.independent.twin import Grid, Mechanism, Twin, carried, times


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


"""Effects on the way to the stack, and the sensor that is such a first order too."""


# Creep lives on time constants of 10^-2.25 to 10^3.25 s, with the same density everywhere.
_FASTEST, _SLOWEST, _NODES = -2.25, 3.25, 40


@njit(cache=True)
def _vibrated(
    x: float, v: float, force: float, change: float, step: float, w: float, damping: float
) -> tuple[float, float]:
    """Classical Runge-Kutta for x'' = w² (force - x) - 2 ζ w x' over a step, the force linear in it."""
    parts = math.ceil(w * step / 0.05)
    h, slope = step / parts, change / parts
    for i in range(parts):
        begin = force + i * slope
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
    return x, v


@njit(cache=True)
def _vibrate(force: Array, step: float, w: float, damping: float, state: Array) -> Array:
    """Vibrate over all steps, each the same linear map of x and v, the force and its change."""
    of_x = _vibrated(1.0, 0.0, 0.0, 0.0, step, w, damping)
    of_v = _vibrated(0.0, 1.0, 0.0, 0.0, step, w, damping)
    of_force = _vibrated(0.0, 0.0, 1.0, 0.0, step, w, damping)
    of_change = _vibrated(0.0, 0.0, 0.0, 1.0, step, w, damping)
    out = np.empty_like(force)
    last, x, v = state
    for k in range(len(force)):
        change = force[k] - last
        x, v = (
            of_x[0] * x + of_v[0] * v + of_force[0] * last + of_change[0] * change,
            of_x[1] * x + of_v[1] * v + of_force[1] * last + of_change[1] * change,
        )
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
def _creep(x: Array, decay: Array, share: Array, state: Array) -> Array:
    out = np.empty_like(x)
    elements, last = state[:-1], state[-1]
    for k in range(len(x)):
        middle = 0.5 * (last + x[k])
        last = x[k]
        total = x[k]
        for i in range(len(elements)):
            elements[i] = middle + decay[i] * (elements[i] - middle)
            total += share[i] * elements[i]
        out[k] = total
    state[-1] = last
    return out


def vibration(grid: Grid, f0_hz: float, damping: float) -> Mechanism:
    """Mass on a spring, at rest at the first sample; input in µm of static displacement."""
    w = 2.0 * math.pi * f0_hz
    return carried(
        lambda x: np.array([x[0], x[0], 0.0]),
        lambda x, state: _vibrate(x, grid.step_s, w, damping, state),
    )


def gap(grid: Grid, half_width_um: float) -> Mechanism:
    """Load that sits in the middle of a gap at the first sample."""
    return carried(
        lambda x: np.array([x[0], 0.0, x[0]]), lambda x, state: _drag(x, half_width_um, state)
    )


def viscoelasticity(grid: Grid, gain_per_decade: float) -> Mechanism:
    """Continuous spectrum of Kelvin-Voigt elements, by Gauss-Legendre quadrature over log τ."""
    abscissae, weights = np.polynomial.legendre.leggauss(_NODES)
    decades = 0.5 * (_SLOWEST - _FASTEST)
    tau = 10.0 ** (_FASTEST + decades * (abscissae + 1.0))
    decay, share = np.exp(-grid.step_s / tau), gain_per_decade * decades * weights
    return carried(
        lambda x: np.full(_NODES + 1, x[0]), lambda x, state: _creep(x, decay, share, state)
    )


def ageing(grid: Grid, rate_per_s: float) -> Mechanism:
    """Gain that grows by `rate_per_s` of its first value a second."""
    clock = times(grid)
    return lambda x: x * (1.0 + rate_per_s * clock(x))


def warming(grid: Grid, rate_um_s: float, time_constant_s: float) -> Mechanism:
    """Expansion that begins at `rate_um_s` and settles with a time constant (s)."""
    clock, final = times(grid), rate_um_s * time_constant_s
    return lambda x: x + final * (1.0 - np.exp(-clock(x) / time_constant_s))


def hum(grid: Grid, amplitude_um: float, frequency_hz: float, phase_rad: float) -> Mechanism:
    """Line of the mains, as the imaginary part of a turning pointer."""
    pointer = amplitude_um * complex(math.cos(phase_rad), math.sin(phase_rad))
    clock, turn = times(grid), 2j * math.pi * frequency_hz
    return lambda x: np.asarray(x + (pointer * np.exp(turn * clock(x))).imag)


def line(grid: Grid, delay_s: float) -> Mechanism:
    """Line that holds the past, linear between two points of the grid."""
    samples = delay_s / grid.step_s
    kept = math.ceil(samples) + 1
    whole, part = divmod(samples, 1.0)

    def shift(x: Array, past: Array) -> Array:
        held = np.concatenate([past, x])
        past[:] = held[-kept:]
        end = len(held) - int(whole)
        newer, older = held[end - len(x) : end], held[end - len(x) - 1 : end - 1]
        return np.asarray(newer + part * (older - newer), dtype=np.float64)

    return carried(lambda x: np.full(kept, x[0]), shift)


TWINS = (
    Twin("saturation", 7, -30, softening),
    Twin("slew_limit", 8, -20, current_limit),
    Twin("actuator_lag", 3, -10, first_order),
    Twin("sensor_lag", 4, 70, first_order),
    Twin("creep", 1, 10, viscoelasticity),
    Twin("resonance", 2, 20, vibration),
    Twin("backlash", 12, 30, gap),
    Twin("gain_drift", 10, 40, ageing),
    Twin("thermal_drift", 9, 50, warming),
    Twin("delay", 5, 60, line),
    Twin("mains_hum", 13, 80, hum),
)
"""Effects behind the ceramic."""
