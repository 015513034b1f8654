"""Congruency violation undone together with the plays, whose weights depend on the command."""

from __future__ import annotations

import numpy as np
from numba import njit

from baselines.inverses.turns import turns
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.effects import Effect
from rdpi_gym.plant.effects.congruency import congruency_block, congruency_polynomial_block
from rdpi_gym.support.arrays import Array

# Halvings of the command range: to a billionth of a millionth of it.
_HALVINGS = 50


UNDONE = (congruency_block, congruency_polynomial_block)
"""Kernels of the forms of congruency that are undone together with the plays."""


def growths(effect: Effect, ts_s: float, model: RDPI) -> Array:
    """Return g_k (1/V^k) of y = a_0 u + (1 + Σ g_k u^k) Σ a_i ξ_i, k = 1, 2, ...

    Parameters
    ----------
    effect
        Congruency in one of the forms :data:`UNDONE`.
    ts_s
        Sampling time (s).
    model
        The RDPI parameters.

    Examples
    --------
    >>> from rdpi_gym.plant.effects import load_effect
    >>> model = RDPI((1.0, 0.5), (1.0,), 0.0)
    >>> growths(load_effect("congruency")(coefficient=0.1, span_V=10.0), 1e-4, model).tolist()
    [0.0, 0.001]
    """
    column = np.array(effect.coefficients(ts_s, model))
    if type(effect).block is congruency_block:
        return np.array([0.0, column[1]])
    powers = np.arange(1, len(column) - 1)
    return np.asarray(column[2:] * column[1] ** powers, dtype=np.float64)


def rising_range(
    model: RDPI, growth: Array, command_range_V: tuple[float, float]
) -> tuple[float, float]:
    """Return the part of a command range (V) about zero over which the displacement rises.

    Parameters
    ----------
    model
        The RDPI parameters.
    growth
        As :func:`growths`. Where weights fall with the command the displacement may turn: with every
        play sticking where a_0 + S Σ k g_k u^k is zero, sliding where A + S Σ (k + 1) g_k u^k is.
    command_range_V
        Lowest and highest command (V).

    Examples
    --------
    >>> low, high = rising_range(
    ...     RDPI((1.0, 0.5), (1.0,), 0.0), np.array([0.0, -1e-4]), (-50.0, 200.0)
    ... )
    >>> low, round(high, 9)
    (-50.0, 100.0)
    """
    low, high = command_range_V
    largest, k = max(abs(low), abs(high)), np.arange(1, len(growth) + 1)
    for first, factors in ((model.a0, k), (model.A, k + 1)):
        below, above = turns(model.S * factors * growth * largest**k / first)
        low, high = max(low, largest * below), min(high, largest * above)
    return low, high


@njit(cache=True)
def _excess(
    u: float, y: float, shift: float, growth: Array, p: Array, state: Array, b: int
) -> float:
    """Displacement (µm) that a command would cause, over the wanted one."""
    n = (p.shape[0] - 4) // 2
    plays = 0.0
    for i in range(n):
        r = p[n + 1 + i, b] + shift
        plays += p[1 + i, b] * max(u - r, min(u + r, state[2 + i, b]))
    more = 0.0
    for k in range(len(growth) - 1, -1, -1):
        more = (more + growth[k]) * u
    excess: float = p[0, b] * u + (1.0 + more) * plays - y
    return excess


@njit(cache=True)
def congruent_inverse_block(
    y: Array, v: Array, growth: Array, p: Array, state: Array, low: float, high: float, u: Array
) -> None:
    """Solve y = a_0 u + (1 + Σ g_k u^k) Σ a_i ξ_i for each sample by bisection over the range.

    Parameters
    ----------
    y : float64[T, B]
        Wanted displacement (µm).
    v : float64[T, B]
        Rate that sets the thresholds (V/s).
    growth : float64[K]
        g_k (1/V^k), k = 1 ... K.
    p, state : float64[2n + 4, B], float64[n + 2, B]
        Parameters and state as :mod:`rdpi_gym.plant.cores.play` has them; the play states are moved on.
    low, high : float
        Range of the command (V); the nearer end where no command reaches y.
    u : float64[T, B]
        Filled with the command (V).
    """
    n = (p.shape[0] - 4) // 2
    for t in range(y.shape[0]):
        for b in range(y.shape[1]):
            shift = p[2 * n + 1, b] * abs(v[t, b])
            below, above = low, high
            if _excess(low, y[t, b], shift, growth, p, state, b) >= 0.0:
                above = low
            elif _excess(high, y[t, b], shift, growth, p, state, b) <= 0.0:
                below = high
            else:
                for _ in range(_HALVINGS):
                    middle = 0.5 * (below + above)
                    if _excess(middle, y[t, b], shift, growth, p, state, b) < 0.0:
                        below = middle
                    else:
                        above = middle
            command = 0.5 * (below + above)
            for i in range(n):
                r = p[n + 1 + i, b] + shift
                state[2 + i, b] = max(command - r, min(command + r, state[2 + i, b]))
            u[t, b] = command
