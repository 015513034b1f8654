"""From the voltage to the displacement of the ceramic: plays as stop operators, on a fine grid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from rdpi_gym.support.arrays import Array
from rdpi_gym.virtual_lab.independent.twin import MaterialTwin


@njit(cache=True)
def _deform(
    u: Array, parts: int, step: float, weights: Array, rest: Array, delta2: float,
    bandwidth: float, exponent: float, reference_rate: float, growth: float, square: float,
    stops: Array, memory: Array,
) -> Array:  # fmt: skip
    """Stress-like stops s_i' = u' within |s_i| <= r_i(t); a play is u - s_i.

    `u` holds whole sampling intervals of `parts` steps. The rate is the difference over an interval,
    Eq. 5, or its low-passed slope; the thresholds are linear in time over the interval.
    """
    out = np.empty_like(u)
    last, rate, growth_before = memory
    half = math.pi * bandwidth * step
    for begin in range(0, len(u), parts):
        if bandwidth > 0.0:
            before = last
            for k in range(begin, begin + parts):
                slope = (u[k] - before) / step
                rate = ((1.0 - half) * rate + 2.0 * half * slope) / (1.0 + half)
                before = u[k]
        else:
            rate = (u[begin + parts - 1] - last) / (parts * step)
        speed = abs(rate)
        if exponent != 1.0 and speed > 0.0:
            speed = reference_rate * math.exp(exponent * math.log(speed / reference_rate))
        growth_now = delta2 * speed
        for k in range(begin, begin + parts):
            share = (k - begin + 1) / parts
            wider = growth_before + share * (growth_now - growth_before)
            plays = 0.0
            for i in range(len(rest)):
                s = stops[i] + (u[k] - last)
                if abs(s) > rest[i] + wider:
                    s = math.copysign(rest[i] + wider, s)
                stops[i] = s
                plays += weights[i + 1] * (u[k] - s)
            last = u[k]
            strain = weights[0] * u[k] + plays * (1.0 + growth * u[k] ** 2)
            out[k] = strain * (1.0 + square * strain)
        growth_before = growth_now
    memory[:] = (last, rate, growth_before)
    return out


@dataclass(frozen=True)
class Ceramic:
    """Numbers of the material.

    Parameters
    ----------
    weights, thresholds_V, delta2_s, rate_bandwidth_hz
        The RDPI model's, as plain numbers.
    exponent, reference_rate_V_s
        Thresholds grow with v0 (|v| / v0)^p.
    extremum_V
        Where the voltage turned before the record.
    growth_per_V2
        Growth of the plays' weights with the square of the voltage.
    square_per_um
        Coefficient of the squared strain.
    """

    weights: Sequence[float]
    thresholds_V: Sequence[float]
    delta2_s: float
    rate_bandwidth_hz: float | None = None
    exponent: float = 1.0
    reference_rate_V_s: float = 1.0
    extremum_V: float = 0.0
    growth_per_V2: float = 0.0
    square_per_um: float = 0.0


class Deformation:
    """Displacement of the ceramic over the voltage, with the memory of its stops."""

    def __init__(self, ceramic: Ceramic, step_s: float, parts: int) -> None:
        self._ceramic, self._step, self._parts = ceramic, step_s, parts
        self._weights = np.array(ceramic.weights, dtype=np.float64)
        self._rest = np.array(ceramic.thresholds_V, dtype=np.float64)
        self._stops: Array | None = None
        self._memory = np.zeros(3)

    def __call__(self, u: Array) -> Array:
        """Displacement (µm) for the voltage `u` at the stack."""
        c = self._ceramic
        if self._stops is None:
            turned = np.clip(c.extremum_V, -self._rest, self._rest)
            self._stops = np.clip(turned + u[0] - c.extremum_V, -self._rest, self._rest)
            self._memory[0] = u[0]
        parts = min(self._parts, len(u))
        return np.asarray(
            _deform(
                u, parts, self._step, self._weights, self._rest, c.delta2_s, c.rate_bandwidth_hz or 0.0,
                c.exponent, c.reference_rate_V_s, c.growth_per_V2, c.square_per_um,
                self._stops, self._memory,
            )
        )  # fmt: skip


TWINS = (
    MaterialTwin(
        "asymmetry", 6, lambda coefficient, span_um: {"square_per_um": coefficient / span_um}
    ),
    MaterialTwin(
        "rate_law",
        11,
        lambda exponent, reference_rate_V_s: {
            "exponent": exponent,
            "reference_rate_V_s": reference_rate_V_s,
        },
    ),
    MaterialTwin(
        "congruency", 14, lambda coefficient, span_V: {"growth_per_V2": coefficient / span_V**2}
    ),
    MaterialTwin("initial_memory", 15, lambda extremum_V: {"extremum_V": extremum_V}),
)
"""Effects that lie in the ceramic."""
