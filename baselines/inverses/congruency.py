"""Congruency violation undone together with the plays, whose weights depend on the command."""

from __future__ import annotations

import numpy as np
from numba import njit

from baselines.inverses.base import turns
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.cores.play import play
from rdpi_gym.plant.effects import Effect
from rdpi_gym.plant.effects.congruency import congruency_block, congruency_polynomial_block
from rdpi_gym.support.arrays import Array

# Halvings of the command range: to a billionth of a millionth of it.
_HALVINGS = 50


UNDONE = (congruency_block, congruency_polynomial_block)
"""Kernels of the forms of congruency that are undone together with the plays."""


def growth(effect: Effect, ts_s: float, model: RDPI) -> Array:
    """Return g_k (1/V^k) of y = a_0 u + (Σ g_k u^k) Σ a_i ξ_i, k = 0, 1, ..."""
    _, first, *others = effect.coefficients(ts_s, model)
    if type(effect).block is congruency_block:
        (middle,) = others
        return np.array([1.0 + first * middle**2, 0.0 - 2.0 * first * middle, first])
    return np.array([1.0, *(c * first**k for k, c in enumerate(others, start=1))])


def rising_range(
    model: RDPI, powers: Array, command_range_V: tuple[float, float]
) -> tuple[float, float]:
    """Return the part of a command range (V) about zero over which the displacement rises."""
    low, high = command_range_V
    largest, k = max(abs(low), abs(high)), np.arange(1, len(powers))
    for first, factors in ((model.a0, k), (model.a0 + model.S * powers[0], k + 1)):
        below, above = turns(model.S * factors * powers[1:] * largest**k / first)
        low, high = max(low, largest * below), min(high, largest * above)
    return low, high


@njit(cache=True)
def _excess(
    u: float, y: float, shift: float, powers: Array, p: Array, state: Array, b: int
) -> float:
    """Displacement (µm) that a command would cause, over the wanted one."""
    n = (p.shape[0] - 4) // 2
    plays = 0.0
    for i in range(n):
        r = p[n + 1 + i, b] + shift
        plays += p[1 + i, b] * play(state[2 + i, b], u - r, u + r)
    weight = 0.0
    for k in range(len(powers) - 1, -1, -1):
        weight = weight * u + powers[k]
    excess: float = p[0, b] * u + weight * plays - y
    return excess


@njit(cache=True)
def congruent_inverse_block(
    y: Array, v: Array, powers: Array, p: Array, state: Array, low: float, high: float, u: Array
) -> None:
    """Solve y = a_0 u + (Σ g_k u^k) Σ a_i ξ_i for each sample by bisection over the range."""
    n = (p.shape[0] - 4) // 2
    for t in range(y.shape[0]):
        for b in range(y.shape[1]):
            shift = p[2 * n + 1, b] * abs(v[t, b])
            below, above = low, high
            if _excess(low, y[t, b], shift, powers, p, state, b) >= 0.0:
                above = low
            elif _excess(high, y[t, b], shift, powers, p, state, b) <= 0.0:
                below = high
            else:
                for _ in range(_HALVINGS):
                    middle = 0.5 * (below + above)
                    if _excess(middle, y[t, b], shift, powers, p, state, b) < 0.0:
                        below = middle
                    else:
                        above = middle
            command = 0.5 * (below + above)
            for i in range(n):
                r = p[n + 1 + i, b] + shift
                state[2 + i, b] = play(state[2 + i, b], command - r, command + r)
            u[t, b] = command
