"""Creep: a displacement that goes on for as long again as it has taken so far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Effect, Look, Parameter, Picture
from rdpi_gym.plant.effects.linear import lag_step
from rdpi_gym.support.arrays import Array

PER_DECADE = 2
TIME_CONSTANTS_S = tuple(
    10.0 ** (k / PER_DECADE) for k in range(-2 * PER_DECADE, 3 * PER_DECADE + 1)
)
"""Elements of the ladder (s). One a decade leaves a ripple of 2 % of the creep of a decade on the
step and of 4 % on the frequency response, two leave 0.02 and 0.05 %."""

# Below this many lanes the vector units are better filled with the elements of one lane.
_VECTOR_LANES = 32


@njit(cache=True, fastmath={"reassoc", "contract"}, inline="never")
def _one_lane(x: Array, steps: Array, gain: float, last: float, z: Array, y: Array) -> None:
    decay, before, after = steps[:, 0].copy(), steps[:, 1].copy(), steps[:, 2].copy()
    for t in range(len(x)):
        total = 0.0
        for k in range(len(z)):
            value = decay[k] * z[k] + before[k] * last + after[k] * x[t]
            z[k] = value
            total += value
        last = x[t]
        y[t] = last + gain * total


@njit(cache=True)
def _many_lanes(x: Array, p: Array, state: Array, y: Array) -> None:
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = 0.0
        for k in range((p.shape[0] - 1) // 3):
            for b in range(x.shape[1]):
                z = p[1 + 3 * k, b] * state[1 + k, b]
                z += p[2 + 3 * k, b] * state[0, b] + p[3 + 3 * k, b] * x[t, b]
                state[1 + k, b] = z
                y[t, b] += z
        for b in range(x.shape[1]):
            state[0, b] = x[t, b]
            y[t, b] = x[t, b] + p[0, b] * y[t, b]


@njit(cache=True)
def creep_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel, exact for an input linear between samples.

    Rows of ``p``: gain of an element; F, G0, G1 of each. Rows of the state: last input, elements.
    """
    elements = (p.shape[0] - 1) // 3
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[: elements + 1, b] = x[0, b]
    if x.shape[1] >= _VECTOR_LANES:
        _many_lanes(x, p, state, y)
        return
    for b in range(x.shape[1]):
        z = state[1 : elements + 1, b].copy()
        steps = p[1:, b].copy().reshape(elements, 3)
        _one_lane(x[:, b], steps, p[0, b], state[0, b], z, y[:, b])
        state[1 : elements + 1, b] = z
        state[0, b] = x[-1, b]


@dataclass(frozen=True)
class Creep(Effect):
    """Spectrum of Kelvin-Voigt elements from 0.01 to 1000 s, in equilibrium at the first sample.

    Examples
    --------
    >>> stretch = Creep(gain_per_decade=0.02).run([0.0] + [50.0] * 1000, 0.1)
    >>> float((stretch[1000] - stretch[100]).round(2))  # from 10 to 100 s: 2 % of 50 µm
    0.98
    """

    gain_per_decade: float = 0.015

    name = "creep"
    slot = "hysteresis"
    order = 30
    parameters = (
        Parameter(
            "gain_per_decade", "1", 0.0, 0.1, (0.01, 0.02),
            "displacement gained in a decade of time, γ", neutral=0.0,
        ),
    )  # fmt: skip
    equation = (
        "y = y_h + (γ / m) Σ_k z_k, τ_k dz_k/dt + z_k = y_h, m = 2 a decade, τ_k = 0.01 ... 1000 s"
    )
    source = (
        "Physik Instrumente, piezo tutorial, creep (physikinstrumente.com/tutorial/4_21.html): "
        "ΔL (1 + γ lg(t / 0.1 s)), γ of the order of 0.01 to 0.02. It starts well below 1 s "
        "(doi 10.1155/2013/187262)."
    )
    signature = (
        "In a hold y drifts in the direction of the last step, with a constant slope over log t; "
        "the gain falls by γ a decade of frequency."
    )
    experiment = "Stairs of steps up and down with holds from 0.05 to 50 s."
    cause = (
        "After a step most domains switch at once and the rest go on switching ever more slowly: "
        "the remanent polarisation keeps changing under constant voltage."
    )
    hardware = (
        "Every voltage-driven piezo actuator without position feedback: tubes of scanning probe "
        "microscopes, stacks, benders. Charge drives and closed loops hardly show it."
    )
    magnitude = (
        "1 to 2 % of the last step a decade of time, counted from 0.1 s (Physik Instrumente, "
        "piezo tutorial, creep); a few per cent after some hours."
    )
    remedy = (
        "Hardware: a position sensor and an integral in the loop, or a charge drive. "
        "Compensation: subtract what the model predicts, element by element; the inverse is "
        "stable and needs no preview. Waiting helps slowly: each further decade costs as much."
    )
    mistaken_for = ("thermal_drift", "gain_drift", "initial_memory")
    picture = Picture(
        {"gain_per_decade": 0.02},
        Look("onward", "A hold of 30 s", "stairs", 23.85, 53.8),
        Look("left_over_time", "What a refit leaves of the stairs", "stairs"),
    )
    block = staticmethod(creep_block)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Gain of an element, then F, G0, G1 of each."""
        steps = [value for tau in TIME_CONSTANTS_S for value in lag_step(tau, ts_s)]
        return [self.gain_per_decade / PER_DECADE, *steps]

    def state_rows(self, ts_s: float) -> int:
        """Last input and one row for each element."""
        return 1 + len(TIME_CONSTANTS_S)
