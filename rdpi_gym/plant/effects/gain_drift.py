"""Gain drift: a sensitivity that changes while the experiment goes on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Effect, Look, Parameter, Picture
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
class GainDrift(Effect):
    """Displacement multiplied by a gain that is linear in time.

    Examples
    --------
    >>> GainDrift(rate_per_s=0.001).run([10.0, 10.0, 10.0], 5.0).round(3).tolist()
    [10.0, 10.05, 10.1]
    """

    rate_per_s: float = 1e-4

    name = "gain_drift"
    slot = "output"
    order = 30
    parameters = (
        Parameter(
            "rate_per_s", "1/s", -1e-2, 1e-2, (3e-5, 3e-4), "relative change of the gain a second, κ",
            neutral=0.0,
        ),
    )  # fmt: skip
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
    clocked = True

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Relative rate (1/s)."""
        return [self.rate_per_s]

    def state_rows(self, ts_s: float) -> int:
        """The clock."""
        return 1
