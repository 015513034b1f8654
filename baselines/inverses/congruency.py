"""Congruency violation undone together with the plays, whose weights depend on the command."""

from __future__ import annotations

import math

from numba import njit

from rdpi_gym.plant import RDPI
from rdpi_gym.support.arrays import Array

# Halvings of the command range: to a billionth of a millionth of it.
_HALVINGS = 50


def rising_range(
    model: RDPI, growth: float, command_range_V: tuple[float, float]
) -> tuple[float, float]:
    """Return the part of a command range (V) over which the displacement rises.

    Parameters
    ----------
    model
        The RDPI parameters.
    growth
        c / U² (1/V²). Where it is below zero, weights that fall with the command let the
        displacement turn: with every play sticking at u² = a_0 / (2 |growth| S), sliding at
        A / (3 |growth| S).
    command_range_V
        Lowest and highest command (V).

    Examples
    --------
    >>> rising_range(RDPI((1.0, 0.5), (1.0,), 0.0), -1e-4, (-50.0, 200.0))
    (-50.0, 100.0)
    """
    low, high = command_range_V
    if growth >= 0.0 or model.S == 0.0:
        return low, high
    reach = math.sqrt(min(model.a0 / 2.0, model.A / 3.0) / (-growth * model.S))
    return max(low, -reach), min(high, reach)


@njit(cache=True)
def _excess(
    u: float, y: float, shift: float, growth: float, p: Array, state: Array, b: int
) -> float:
    """Displacement (µm) that a command would cause, over the wanted one."""
    n = (p.shape[0] - 4) // 2
    plays = 0.0
    for i in range(n):
        r = p[n + 1 + i, b] + shift
        plays += p[1 + i, b] * max(u - r, min(u + r, state[2 + i, b]))
    excess: float = p[0, b] * u + (1.0 + growth * u * u) * plays - y
    return excess


@njit(cache=True)
def congruent_inverse_block(
    y: Array, v: Array, growth: float, p: Array, state: Array, low: float, high: float, u: Array
) -> None:
    """Solve y = a_0 u + (1 + c u²/U²) Σ a_i ξ_i for each sample by bisection over the range.

    Parameters
    ----------
    y : float64[T, B]
        Wanted displacement (µm).
    v : float64[T, B]
        Rate that sets the thresholds (V/s).
    growth : float
        c / U² (1/V²).
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
