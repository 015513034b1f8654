"""Thermal drift: frame and stack that warm up while the experiment goes on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, Look, Parameter, Picture
from rdpi_gym.support.arrays import Array


@njit(cache=True)
def thermal_drift_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: rate (µm/s), τ (s). Row of the state: samples since t = 0."""
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = 0.0
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = x[t, b] - p[0, b] * p[1, b] * math.expm1(-state[0, b] * ts / p[1, b])
            state[0, b] += 1.0


@dataclass(frozen=True)
class ThermalDrift(Effect):
    """Displacement added by warming: fast at t = 0 and settled after some time constants.

    Examples
    --------
    >>> ThermalDrift(rate_um_s=0.01, time_constant_s=100.0).run([0.0] * 3, 100.0).round(3).tolist()
    [0.0, 0.632, 0.865]
    """

    rate_um_s: float = 5e-3
    time_constant_s: float = 200.0

    name = "thermal_drift"
    slot = "output"
    order = 40
    parameters = (
        Parameter(
            "rate_um_s", "µm/s", -1.0, 1.0, (2e-3, 2e-2), "drift d at t = 0", neutral=0.0
        ),
        Parameter("time_constant_s", "s", 1.0, 1e5, (50.0, 1e3), "time constant of the warming, τ"),
    )  # fmt: skip
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
    clocked = True

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Warming that settles within the longest record, and one that does not."""
        return tuple(
            cls.within_bounds(
                rate_um_s=1e-3 * scale.stroke_um / scale.longest_s, time_constant_s=tau
            )
            for tau in (max(1.0, scale.longest_s), max(1.0, 10.0 * scale.longest_s))
        )

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Rate (µm/s) and time constant (s)."""
        return [self.rate_um_s, self.time_constant_s]

    def state_rows(self, ts_s: float) -> int:
        """The clock."""
        return 1
