"""Play operators and the RDPI sum: the kernels of Eq. 2 to 5 and 8 over (time, batch) blocks.

One lane is one plant. A lane's parameters are a column of ``p[P, B]``, its state a column of
``state[S, B]``; both layouts are written by :mod:`rdpi_gym.plant.cores.base`:

======================  ==================================================
row of ``p``            meaning
======================  ==================================================
0                       a_0 (µm/V)
1 ... n                 a_1 ... a_n (µm/V)
n + 1 ... 2n            thresholds at rest r_1 ... r_n (V)
2n + 1                  δ2 (s)
2n + 2                  pole of the low-pass on the rate, exp(-2π f_c Ts); 0: literal Eq. 5
2n + 3                  offset (µm)
======================  ==================================================

======================  ==================================================
row of ``state``        meaning
======================  ==================================================
0                       u(k-1) (V); NaN: no sample yet, v(0) = 0
1                       v(k-1), after the low-pass (V/s)
2 ... n + 1             play states ξ_1(k-1) ... ξ_n(k-1) (V)
======================  ==================================================
"""

from __future__ import annotations

import numpy as np
from numba import njit

from rdpi_gym.support.arrays import Array

# Sums over the plays may be reordered (vector units); nothing else of IEEE 754 is given up.
_FAST = {"reassoc", "contract"}
# Below this many lanes the vector units are better filled with the plays of one lane.
_VECTOR_LANES = 16


@njit(cache=True, forceinline=True)
def play(x: float, low: float, high: float) -> float:
    """Return the state `x` of a play whose gap now reaches from `low` to `high`, Eq. 4.

    Kernels of other files that call it are compiled anew where ``__pycache__`` is deleted: numba looks
    for changes in the file of each kernel alone.
    """
    x = x if x < high else high
    return x if x > low else low


@njit(cache=True, fastmath=_FAST, inline="never")
def _one_lane(
    u: Array,
    v: Array,
    weights: Array,
    rest: Array,
    delta2: float,
    offset: float,
    xi: Array,
    y: Array,
) -> None:
    n = rest.shape[0]
    a0 = weights[0]
    for t in range(u.shape[0]):
        shift = delta2 * abs(v[t])  # Eq. 8
        total = a0 * u[t] + offset
        for i in range(n):
            r = rest[i] + shift
            x = play(xi[i], u[t] - r, u[t] + r)
            xi[i] = x
            total += weights[i + 1] * x  # Eq. 3
        y[t] = total


@njit(cache=True, fastmath=_FAST)
def _many_lanes(u: Array, v: Array, p: Array, state: Array, y: Array) -> None:
    n = (p.shape[0] - 4) // 2
    lanes = u.shape[1]
    for t in range(u.shape[0]):
        for b in range(lanes):
            y[t, b] = p[0, b] * u[t, b] + p[2 * n + 3, b]
        for i in range(n):
            for b in range(lanes):
                r = p[n + 1 + i, b] + p[2 * n + 1, b] * abs(v[t, b])
                x = play(state[2 + i, b], u[t, b] - r, u[t, b] + r)
                state[2 + i, b] = x
                y[t, b] += p[1 + i, b] * x


@njit(cache=True)
def rate_block(u: Array, p: Array, state: Array, ts: float, v: Array) -> None:
    """Rate of the command, Eq. 5, low-passed where the plant's rate is band-limited.

    The command is linear between samples, so its rate is constant there and a first-order
    low-pass is discretised exactly by its pole.
    """
    pole_row = p.shape[0] - 2
    for b in range(u.shape[1]):
        pole = p[pole_row, b]
        last, rate = state[0, b], state[1, b]
        if np.isnan(last):  # a record begins here: v(0) = 0
            last = u[0, b]
        for t in range(u.shape[0]):
            rate = pole * rate + (1.0 - pole) * ((u[t, b] - last) / ts)
            last = u[t, b]
            v[t, b] = rate
        state[0, b], state[1, b] = last, rate


@njit(cache=True)
def given_rate_block(u: Array, v: Array, p: Array, state: Array, y: Array) -> None:
    """RDPI sum, Eq. 3, 4 and 8, with the thresholds given as functions of time through a rate."""
    if u.shape[1] >= _VECTOR_LANES:
        _many_lanes(u, v, p, state, y)
        return
    n = (p.shape[0] - 4) // 2
    for b in range(u.shape[1]):
        xi = state[2:, b].copy()
        _one_lane(
            u[:, b], v[:, b], p[: n + 1, b].copy(), p[n + 1 : 2 * n + 1, b].copy(),
            p[2 * n + 1, b], p[2 * n + 3, b], xi, y[:, b],
        )  # fmt: skip
        for i in range(xi.shape[0]):  # an assignment of slices takes two seconds more to compile
            state[2 + i, b] = xi[i]


@njit(cache=True)
def rdpi_block(u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """RDPI model, Eq. 2 to 5 and 8, with its own rate: the hysteresis stage of the chain."""
    v = np.empty_like(u)
    rate_block(u, p, state, ts, v)
    given_rate_block(u, v, p, state, y)


@njit(cache=True)
def play_columns(u: Array, v: Array, rest: Array, delta2: float, xi: Array, columns: Array) -> None:
    """Every play operator's output for itself: the regressors that Eq. 10 is linear in."""
    for i in range(rest.shape[0]):
        x = xi[i]
        for t in range(u.shape[0]):
            r = rest[i] + delta2 * abs(v[t])
            x = play(x, u[t] - r, u[t] + r)
            columns[i, t] = x
        xi[i] = x
