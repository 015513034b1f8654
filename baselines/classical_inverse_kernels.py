"""The classical inverse of the RDPI model: itself a weighted sum of plays, with b_i and s_i.

Its parameters are packed as the plant's (:mod:`rdpi_gym.plant.cores.play`), so with a given rate it runs
on the plant's own kernel :func:`rdpi_gym.plant.cores.play.given_rate_block`, from µm to V.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from baselines.limits import limited
from rdpi_gym.plant.cores.play import play
from rdpi_gym.plant.cores.rdpi import RDPI
from rdpi_gym.support.arrays import Array


def pack_inverse(models: Sequence[RDPI], ts_s: float) -> Array:
    """Pack the inverse's parameters: 1/a_0, b_i, thresholds at rest s_i (µm), a_0 δ2, rate pole.

    Notes
    -----
    c_i = a_0 + ... + a_i, b_i = -a_i / (c_i c_{i-1}), s_i = Σ_{j<i} c_j (r_{j+1} - r_j); with Eq. 8
    the gaps do not depend on the rate, so it enters every s_i as a_0 δ2 |v| and the inverse exists.
    """
    columns = []
    for model in models:
        c = np.cumsum(model.weights)
        b = -np.asarray(model.weights[1:]) / (c[1:] * c[:-1])
        s = np.cumsum(c[:-1] * np.diff([0.0, *model.thresholds_V]))
        columns.append([1.0 / c[0], *b, *s, c[0] * model.delta2_s, model.rate_pole(ts_s), 0.0])
    return np.ascontiguousarray(np.array(columns, dtype=np.float64).T)


def inverse_memory(model: RDPI, memory_V: ArrayLike) -> Array:
    """State of the inverse that belongs to the plant's play states."""
    xi = np.asarray(memory_V, dtype=np.float64)
    a = np.asarray(model.weights[1:])
    c = np.cumsum(model.weights)[1:]
    behind = np.cumsum((a * xi)[::-1])[::-1] - a * xi
    return np.asarray(c * xi + behind, dtype=np.float64)


@njit(cache=True)
def classical_own_rate(
    y_r: Array,
    p: Array,
    state: Array,
    ts: float,
    u: Array,
    low: float = -np.inf,
    high: float = np.inf,
    step: float = np.inf,
) -> None:
    """Inverse at the rate of its own command, one sample old, literal or low-passed as `p` says."""
    n = (p.shape[0] - 4) // 2
    for t in range(y_r.shape[0]):
        for b in range(y_r.shape[1]):
            shift = p[2 * n + 1, b] * abs(state[1, b])
            command = p[0, b] * y_r[t, b]
            for i in range(n):
                s = p[n + 1 + i, b] + shift
                eta = play(state[2 + i, b], y_r[t, b] - s, y_r[t, b] + s)
                state[2 + i, b] = eta
                command += p[1 + i, b] * eta
            command = limited(command, state[0, b], low, high, step)
            last = command if np.isnan(state[0, b]) else state[0, b]
            pole = p[2 * n + 2, b]
            state[1, b] = pole * state[1, b] + (1.0 - pole) * ((command - last) / ts)
            state[0, b] = command
            u[t, b] = command
