"""Thermal drift: frame and stack that warm up while the experiment goes on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.elementary import VECTOR_LANES, expm1_lanes
from rdpi_gym.plant.effects.base import (
    Clocked,
    DataScale,
    Effect,
    Extension,
    Look,
    Picture,
    parameter,
)
from rdpi_gym.plant.effects.knots import ByKnots, Smooth, along_curve, along_knots, at_knots
from rdpi_gym.support.arrays import Array


@njit(cache=True, error_model="numpy")
def _many_lanes(x: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    warming, warmed = np.empty(x.shape[1]), np.empty(x.shape[1])
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            warming[b] = -state[0, b] * ts / p[1, b]
            state[0, b] += 1.0
        expm1_lanes(warming, warmed)
        for b in range(x.shape[1]):
            y[t, b] = x[t, b] - p[0, b] * p[1, b] * warmed[b]


@njit(cache=True)
def thermal_drift_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: rate (µm/s), τ (s). Row of the state: samples since t = 0."""
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = 0.0
    if x.shape[1] >= VECTOR_LANES:
        _many_lanes(x, p, state, ts, y)
        return
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = x[t, b] - p[0, b] * p[1, b] * math.expm1(-state[0, b] * ts / p[1, b])
            state[0, b] += 1.0


@dataclass(frozen=True)
class ThermalDrift(Clocked):
    """Displacement added by warming: fast at t = 0 and settled after some time constants.

    Examples
    --------
    >>> ThermalDrift(rate_um_s=0.01, time_constant_s=100.0).run([0.0] * 3, 100.0).round(3).tolist()
    [0.0, 0.632, 0.865]
    """

    rate_um_s: float = parameter(
        5e-3, "µm/s", -1.0, 1.0, (2e-3, 2e-2), "drift d at t = 0", neutral=0.0
    )
    time_constant_s: float = parameter(
        200.0, "s", 1.0, 1e5, (50.0, 1e3), "time constant of the warming, τ"
    )

    name = "thermal_drift"
    slot = "output"
    order = 40
    equation = "y = y_m + d τ (1 - exp(-t / τ))"
    source = (
        "Expansion of the ceramic, -3.5e-6 to 11e-6 per kelvin (Physik Instrumente, piezo tutorial, "
        "temperature: physikinstrumente.com/tutorial/4_36.html), and of the frame; rate and time "
        "constant are estimates."
    )
    signature = (
        "A slow trend that follows the experiment's clock and neither the command nor the direction "
        "of the last step."
    )
    experiment = "A long record at constant command, with the temperature logged."
    cause = (
        "Frame, stack and sample expand while the room or the electronics warm up; the path "
        "between sensor and point of interest changes."
    )
    hardware = (
        "Every open frame of aluminium or steel, the first hour after switching on, stages next "
        "to motors and lamps."
    )
    magnitude = (
        "Ceramic -3.5e-6 to 11e-6 per kelvin (Physik Instrumente, piezo tutorial, temperature), "
        "aluminium 23e-6: 0.1 K on 100 mm of aluminium is 0.23 µm. Rates of 2 to 20 nm/s at the "
        "start are an estimate."
    )
    remedy = (
        "Hardware: invar, symmetric design, warm-up, a box around it. Compensation: subtract the "
        "predicted drift, which holds for the one warm-up it was fitted to; a sensor at the point "
        "of interest and feedback work without a model."
    )
    mistaken_for = ("creep", "gain_drift", "initial_memory")
    picture = Picture(
        {"rate_um_s": 0.02, "time_constant_s": 50.0},
        Look("response", "Five minutes at a constant command", "at-rest"),
        Look("left_over_time", "What a refit leaves of the stairs", "stairs"),
    )
    block = staticmethod(thermal_drift_block)

    @classmethod
    def traces(cls, scale: DataScale) -> tuple[Effect, ...]:
        """A smooth curve over the experiment, knot by knot."""
        return DriftByCurve.one_by_one(scale)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Warming that settles within the longest record, and one that does not."""
        return tuple(
            cls.within_bounds(
                rate_um_s=1e-3 * scale.stroke_um / scale.longest_s, time_constant_s=tau
            )
            for tau in (max(1.0, scale.longest_s), max(1.0, 10.0 * scale.longest_s))
        )


@njit(cache=True)
def two_warmings_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: rate (µm/s), τ (s), of each. Row of the state: samples since t = 0."""
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = 0.0
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            time = state[0, b] * ts
            first = x[t, b] - p[0, b] * p[1, b] * math.expm1(-time / p[1, b])
            y[t, b] = first - p[2, b] * p[3, b] * math.expm1(-time / p[3, b])
            state[0, b] += 1.0


@dataclass(frozen=True)
class TwoWarmings(Clocked, Extension, of=ThermalDrift):
    """Displacement added by two parts that warm up at their own pace.

    Examples
    --------
    >>> TwoWarmings(0.01, 100.0, -0.001, 1000.0).run([0.0] * 3, 100.0).round(3).tolist()
    [0.0, 0.537, 0.683]
    """

    rate_um_s: float = 5e-3
    time_constant_s: float = 50.0
    second_rate_um_s: float = parameter(
        2e-3, "µm/s", -1.0, 1.0, (1e-3, 1e-2), "drift of the second at t = 0, d2", neutral=0.0
    )
    second_time_constant_s: float = parameter(
        500.0, "s", 1.0, 1e5, (300.0, 3e3), "its time constant, τ2"
    )

    form = "two time constants"
    equation = "y = y_m + d τ (1 - exp(-t / τ)) + d2 τ2 (1 - exp(-t / τ2))"
    cause = (
        "The stack warms up within a minute and the frame within an hour, each with an expansion "
        "of its own, which may oppose the other."
    )
    block = staticmethod(two_warmings_block)

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The same warming with a small one that is quicker, and one that is slower."""
        rate, tau = simpler.values["rate_um_s"], simpler.values["time_constant_s"]
        return tuple(
            cls.within_bounds(
                rate_um_s=rate, time_constant_s=tau,
                second_rate_um_s=0.1 * rate / ratio, second_time_constant_s=ratio * tau,
            )
            for ratio in (0.2, 5.0)
        )  # fmt: skip


@njit(cache=True)
def knots_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: time between knots (s), values at the knots after t = 0 (µm).

    Row of the state: samples since t = 0.
    """
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = 0.0
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = x[t, b] + along_knots(state[0, b] * ts, p, b)
            state[0, b] += 1.0


# Of the values at knots: suffix, unit, bounds, typical range and meaning.
_AT_KNOTS = ("_um", "µm", (-1e4, 1e4), (0.01, 0.1), "drift")


@dataclass(frozen=True)
class DriftByKnots(ByKnots, of=ThermalDrift):
    """Displacement added along straight lines between seven times, the first at t = 0.

    Examples
    --------
    >>> wander = DriftByKnots(duration_s=60.0, at_1_um=0.1, at_2_um=-0.1)
    >>> wander.run([0.0] * 5, 5.0).round(3).tolist()
    [0.0, 0.05, 0.1, 0.0, -0.1]
    """

    at_1_um: float = 0.02
    at_2_um: float = 0.04
    at_3_um: float = 0.05
    at_4_um: float = 0.06
    at_5_um: float = 0.06
    at_6_um: float = 0.07

    probe = 0.0
    parameters = at_knots(6, *_AT_KNOTS)
    equation = "y = y_m + z(t), z linear between z(k D / 6) = zk, z(0) = 0, constant from D on"
    cause = (
        "The room's temperature wanders: draughts, air conditioning, people. No law is behind it, "
        "so that only its pace is stated."
    )
    signature = "A slow wander that follows the experiment's clock and nothing else."
    remedy = (
        "Hardware: a box around it, invar, warm-up. Compensation: none beforehand, as it does not "
        "repeat; take it out of a record, or close the loop."
    )
    block = staticmethod(knots_block)


@njit(cache=True)
def curve_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: time between knots (s), four coefficients (µm) of each cubic.

    Row of the state: samples since t = 0.
    """
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = 0.0
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = x[t, b] + along_curve(state[0, b] * ts, p, b)
            state[0, b] += 1.0


@dataclass(frozen=True)
class DriftByCurve(Smooth, DriftByKnots, of=ThermalDrift):
    """Displacement added along a smooth curve through fifteen knots in time, the first at t = 0.

    Examples
    --------
    >>> line = {f"at_{k}_um": 0.1 * k for k in range(1, 15)}
    >>> DriftByCurve(duration_s=140.0, **line).run([0.0] * 5, 5.0).round(3).tolist()
    [0.0, 0.05, 0.1, 0.15, 0.2]
    """

    at_7_um: float = 0.07
    at_8_um: float = 0.08
    at_9_um: float = 0.08
    at_10_um: float = 0.09
    at_11_um: float = 0.09
    at_12_um: float = 0.09
    at_13_um: float = 0.08
    at_14_um: float = 0.08

    parameters = at_knots(14, *_AT_KNOTS)
    equation = (
        "y = y_m + z(t), z a natural cubic spline through z(k D / 14) = zk, z(0) = 0, constant from "
        "D on"
    )
    block = staticmethod(curve_block)
