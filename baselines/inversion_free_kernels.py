"""The inversion-free compensator, Eq. 6 and 7, over (time, batch) blocks.

Parameters and state are laid out as the plant's own (:mod:`rdpi_gym.plant.cores.play`): the compensator
is the model restructured, so it runs on the parameters that :func:`rdpi_gym.plant.pack` returns.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from baselines.limits import limited
from rdpi_gym.plant.cores.play import play
from rdpi_gym.support.arrays import Array


@njit(cache=True)
def _command(y_r: float, b: int, p: Array, state: Array) -> float:
    n = (p.shape[0] - 4) // 2
    omega = 0.0
    for i in range(n):
        omega += p[1 + i, b] * state[2 + i, b]  # Eq. 7, one sample old
    return float((y_r - p[2 * n + 3, b] - omega) / p[0, b])  # Eq. 6


@njit(cache=True)
def _slide(u: float, v: float, b: int, p: Array, state: Array) -> None:
    n = (p.shape[0] - 4) // 2
    for i in range(n):
        r = p[n + 1 + i, b] + p[2 * n + 1, b] * abs(v)
        state[2 + i, b] = play(state[2 + i, b], u - r, u + r)


@njit(cache=True)
def inversion_free_own_rate(
    y_r: Array,
    p: Array,
    state: Array,
    ts: float,
    u: Array,
    low: float = -np.inf,
    high: float = np.inf,
    step: float = np.inf,
) -> None:
    """Eq. 6 with the rate of its own command: literal, or low-passed where `p` says so."""
    pole_row = p.shape[0] - 2
    for t in range(y_r.shape[0]):
        for b in range(y_r.shape[1]):
            command = limited(_command(y_r[t, b], b, p, state), state[0, b], low, high, step)
            last = command if np.isnan(state[0, b]) else state[0, b]
            pole = p[pole_row, b]
            v = pole * state[1, b] + (1.0 - pole) * ((command - last) / ts)
            state[0, b], state[1, b] = command, v
            _slide(command, v, b, p, state)
            u[t, b] = command


@njit(cache=True)
def inversion_free_given_rate(
    y_r: Array,
    v: Array,
    p: Array,
    state: Array,
    u: Array,
    low: float = -np.inf,
    high: float = np.inf,
    step: float = np.inf,
) -> None:
    """Eq. 6 with thresholds given through a rate."""
    for t in range(y_r.shape[0]):
        for b in range(y_r.shape[1]):
            command = limited(_command(y_r[t, b], b, p, state), state[0, b], low, high, step)
            state[0, b] = u[t, b] = command
            _slide(command, v[t, b], b, p, state)
