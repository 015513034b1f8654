"""Self-heating: losses warm the stack while it moves fast, and it grows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.plant import RDPI
from rdpi_gym.plant.effects import Effect, Parameter

Array = NDArray[np.float64]


@njit(cache=True)
def warm(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel. Rows of ``p``: rise per squared change of the command, decay of a sample."""
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):  # no sample yet: cold, and at rest
            state[0, b], state[1, b] = u[0, b], 0.0
        for t in range(x.shape[0]):
            state[1, b] += p[1, b] * (p[0, b] * (u[t, b] - state[0, b]) ** 2 - state[1, b])
            state[0, b], y[t, b] = u[t, b], x[t, b] + state[1, b]


@dataclass(frozen=True)
class SelfHeating(Effect):
    """Displacement added by a temperature that follows the squared rate of the command."""

    rise_um: float = 0.2
    time_constant_s: float = 1.0

    name = "self_heating"
    slot = "output"
    order = 25
    parameters = (
        Parameter("rise_um", "µm", -10.0, 10.0, (0.05, 0.5), "rise d at 1000 V/s", neutral=0.0),
        Parameter("time_constant_s", "s", 0.01, 1e4, (0.2, 5.0), "time constant τ"),
    )
    equation = "y = y_m + θ, τ dθ/dt + θ = d (u̇ / 1000 V/s)²"
    cause = "Dielectric losses in the ceramic: every loop of the hysteresis is an area, and it becomes heat."
    hardware = "Stacks that are driven fast and are not cooled."
    magnitude = "An example: estimated sizes."
    signature = "A drift in fast stretches alone, which dies away after them."
    experiment = "A fast burst in a slow sine, then none."
    remedy = "Cooling, smaller amplitudes, or the model's prediction subtracted from the reference."
    source = "An example: estimated sizes."
    mistaken_for = ("thermal_drift", "creep")
    block = staticmethod(warm)

    def coefficients(self, ts_s: float, hysteresis: RDPI) -> list[float]:
        """Rise per squared change of the command, decay of a sample."""
        return [self.rise_um / (1e3 * ts_s) ** 2, -np.expm1(-ts_s / self.time_constant_s)]

    def state_rows(self, ts_s: float) -> int:
        """Last command and temperature."""
        return 2
