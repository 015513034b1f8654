"""Gain drift: a sensitivity that changes while the experiment goes on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit

from rdpi_gym.plant.effects.base import Clocked, DataScale, Effect, Look, Picture, parameter
from rdpi_gym.plant.effects.knots import ByKnots, Smooth, along_curve, along_knots, at_knots
from rdpi_gym.support.arrays import Array


@njit(cache=True)
def gain_drift_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; row of ``p``: relative rate (1/s). Row of the state: samples since t = 0."""
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = 0.0
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = x[t, b] + p[0, b] * (state[0, b] * ts) * x[t, b]
            state[0, b] += 1.0


@dataclass(frozen=True)
class GainDrift(Clocked):
    """Displacement multiplied by a gain that is linear in time.

    Examples
    --------
    >>> GainDrift(rate_per_s=0.001).run([10.0, 10.0, 10.0], 5.0).round(3).tolist()
    [10.0, 10.05, 10.1]
    """

    rate_per_s: float = parameter(
        1e-4, "1/s", -1e-2, 1e-2, (3e-5, 3e-4),
        "relative change of the gain a second, κ", neutral=0.0,
    )  # fmt: skip

    name = "gain_drift"
    slot = "output"
    order = 30
    equation = "y = (1 + κ t) y_m"
    source = (
        "Ageing by depolarisation is negligible in actuators, which repole (Physik Instrumente, "
        "piezo tutorial, ageing); the stroke rises with temperature (2008 Smart Mater. Struct. 17 "
        "015049). The rate is an estimate."
    )
    signature = "Residual proportional to the displacement, growing with the experiment's clock."
    experiment = "Repeat the first record at the end."
    cause = (
        "The stroke a volt changes with temperature, with poling and with the load, slowly "
        "against an experiment."
    )
    hardware = (
        "Stacks that warm up under fast motion, tubes after a large excursion, long measuring "
        "campaigns; sensors whose gain drifts look the same."
    )
    magnitude = (
        "Small about room temperature. Ageing by itself is negligible in actuators, which repole "
        "(Physik Instrumente, piezo tutorial, ageing); an uncooled stack at 10 kHz gained about "
        "15 % of stroke while it warmed up (doi 10.3390/act10110297)."
    )
    remedy = (
        "Hardware: let the stage warm up, hold its temperature. Compensation: divide by the gain "
        "that the model predicts; better, repeat one reference record and rescale, or close the "
        "loop, which takes a slow gain out."
    )
    mistaken_for = ("thermal_drift", "creep")
    picture = Picture(
        {"rate_per_s": 3e-4},
        Look(
            "repeats",
            "The first record once more, 85 s later",
            "triangle-slow",
            "triangle-slow-again",
        ),
        Look(
            "left_over_command",
            "What a refit leaves of both",
            "triangle-slow",
            "triangle-slow-again",
        ),
    )
    block = staticmethod(gain_drift_block)


@njit(cache=True)
def gain_to_limit_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: relative rate (1/s), τ (s). Row of the state: samples since t = 0."""
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = 0.0
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            grown = -p[0, b] * p[1, b] * math.expm1(-state[0, b] * ts / p[1, b])
            y[t, b] = x[t, b] + grown * x[t, b]
            state[0, b] += 1.0


@dataclass(frozen=True)
class GainDriftToLimit(Clocked, of=GainDrift):
    """Displacement multiplied by a gain that changes ever more slowly and settles.

    Examples
    --------
    >>> GainDriftToLimit(rate_per_s=0.001, time_constant_s=100.0).run([10.0] * 3, 100.0).round(3).tolist()
    [10.0, 10.632, 10.865]
    """

    rate_per_s: float = parameter(
        1e-4, "1/s", -1e-1, 1e-1, (3e-5, 3e-4), "relative change a second at t = 0, κ", neutral=0.0
    )
    time_constant_s: float = parameter(
        200.0, "s", 0.1, 1e7, (50.0, 1e3), "time constant of the change, τ"
    )

    form = "to a limit"
    equation = "y = (1 + κ τ (1 - exp(-t / τ))) y_m"
    cause = (
        "The stage warms up, or its poling settles after a large excursion, and comes to an end: "
        "the gain follows with that time constant."
    )
    signature = (
        "Residual proportional to the displacement, growing with the experiment's clock and less "
        "and less."
    )
    block = staticmethod(gain_to_limit_block)

    @classmethod
    def traces(cls, scale: DataScale) -> tuple[Effect, ...]:
        """A smooth curve over the experiment, knot by knot."""
        return GainByCurve.one_by_one(scale)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """A gain that settles within the experiment, and one that does not."""
        return tuple(
            cls.within_bounds(rate_per_s=1e-3 / tau, time_constant_s=tau)
            for tau in (scale.lasts_s / 5.0, scale.lasts_s)
        )

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The same change up to the end of the experiment, early or late in it."""
        end = simpler.values["rate_per_s"] * scale.lasts_s
        return tuple(
            cls.within_bounds(
                rate_per_s=-end / tau / math.expm1(-scale.lasts_s / tau), time_constant_s=tau
            )
            for tau in (scale.lasts_s / 5.0, scale.lasts_s)
        )


@njit(cache=True)
def gain_knots_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: time between knots (s), changes of the gain at the knots after t = 0.

    Row of the state: samples since t = 0.
    """
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = 0.0
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = x[t, b] + along_knots(state[0, b] * ts, p, b) * x[t, b]
            state[0, b] += 1.0


# Of the values at knots: suffix, unit, bounds, typical range and meaning.
_AT_KNOTS = ("", "1", (-0.9, 9.0), (0.001, 0.01), "relative change of the gain")


@dataclass(frozen=True)
class GainByKnots(ByKnots, of=GainDrift):
    """Displacement multiplied by a gain along straight lines between seven times, one at t = 0.

    Examples
    --------
    >>> wander = GainByKnots(duration_s=60.0, at_1=0.1, at_2=-0.1)
    >>> wander.run([10.0] * 5, 5.0).round(3).tolist()
    [10.0, 10.5, 11.0, 10.0, 9.0]
    """

    at_1: float = 0.002
    at_2: float = 0.004
    at_3: float = 0.005
    at_4: float = 0.006
    at_5: float = 0.006
    at_6: float = 0.007

    probe = 1.0
    parameters = at_knots(6, *_AT_KNOTS)
    equation = "y = (1 + z(t)) y_m, z linear between z(k D / 6) = zk, z(0) = 0, constant from D on"
    cause = (
        "Temperature, poling and load wander with the room and with what the stage did: no law is "
        "behind it, so that only its pace is stated."
    )
    signature = (
        "Residual proportional to the displacement, by a factor that wanders with the experiment's "
        "clock."
    )
    block = staticmethod(gain_knots_block)


@njit(cache=True)
def gain_curve_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: time between knots (s), four coefficients of each cubic.

    Row of the state: samples since t = 0.
    """
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = 0.0
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = x[t, b] + along_curve(state[0, b] * ts, p, b) * x[t, b]
            state[0, b] += 1.0


@dataclass(frozen=True)
class GainByCurve(Smooth, GainByKnots, of=GainDrift):
    """Displacement multiplied by a gain along a smooth curve through fifteen knots in time.

    Examples
    --------
    >>> line = {f"at_{k}": 0.1 * k for k in range(1, 15)}
    >>> GainByCurve(duration_s=140.0, **line).run([10.0] * 5, 5.0).round(3).tolist()
    [10.0, 10.5, 11.0, 11.5, 12.0]
    """

    at_7: float = 0.007
    at_8: float = 0.008
    at_9: float = 0.008
    at_10: float = 0.009
    at_11: float = 0.009
    at_12: float = 0.009
    at_13: float = 0.008
    at_14: float = 0.008

    parameters = at_knots(14, *_AT_KNOTS)
    equation = (
        "y = (1 + z(t)) y_m, z a natural cubic spline through z(k D / 14) = zk, z(0) = 0, constant "
        "from D on"
    )
    block = staticmethod(gain_curve_block)
