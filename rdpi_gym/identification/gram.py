"""Gram matrices of Eq. 10's regressors and of their tangents, record by record.

For given δ1, δ2 and initial memory the displacement is linear in a_0 ... a_n and in one offset a
record. The play outputs never leave a block of samples: a least-squares fit needs only the
products. Columns of a record, in the order of every matrix here:

====================  ======================================================
column                meaning
====================  ======================================================
0                     command u (V), the regressor of a_0
1 ... n               ξ_1 ... ξ_n (V), the regressors of a_1 ... a_n
n + 1                 displacement y (µm)
n + 2, n + 3, n + 4   derivative of the model's displacement by δ1, δ2 and
                      the record's memory extremum; only with tangents
====================  ======================================================

A play output is u(s) ± r_i(v(s)) of the last sample s at which it slid, or its initial value, so
it is piecewise linear in δ1, δ2 and the extremum; its derivatives are carried along exactly.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from rdpi_gym.identification.stack import Stack
from rdpi_gym.plant.cores.play import play
from rdpi_gym.support.arrays import Array

_FAST = {"reassoc", "contract"}
# Plays in a vector register.
_VECTOR = 4
# Rows of regressors that are multiplied at a time: they stay in the cache, and the product is too
# small for a linear algebra library to share it among threads, which costs more than it gains here.
_BLOCK, _PRODUCT = 512, 200_000


@njit(cache=True)
def _thresholds(delta1: float, n: int) -> Array:
    """r_i at rest (V), filled up to whole vectors with plays that never move."""
    rest = np.full(-(-n // _VECTOR) * _VECTOR, np.inf)
    rest[:n] = delta1 * np.arange(1, n + 1)
    return rest


@njit(cache=True)
def _initial_memory(rest: Array, extremum: float, xi: Array) -> None:
    """Play states after the way from rest to an extremum (V); 0 is the paper's condition."""
    for i in range(rest.shape[0]):
        if abs(extremum) > rest[i]:
            xi[i] = extremum - np.sign(extremum) * rest[i]
        else:
            xi[i] = 0.0


@njit(cache=True, fastmath=_FAST)
def _fill(
    stack: Stack, t: int, end: int, rest: Array, delta2: float, xi: Array, rows: Array
) -> tuple[int, int]:
    """Regressors of the samples from `t` on that count, as many as `rows` takes."""
    u, v, y, root = stack.u_V, stack.rate_V_s, stack.y_um, stack.root_weight
    n = rows.shape[1] - 3
    k = 0
    while t < end and k < rows.shape[0]:
        shift = delta2 * abs(v[t])
        for i in range(rest.shape[0]):
            r = rest[i] + shift  # Eq. 8
            xi[i] = play(xi[i], u[t] - r, u[t] + r)
        w = root[t]
        if w > 0.0:
            row = rows[k]
            row[0] = w
            row[1] = w * u[t]
            for i in range(n):
                row[2 + i] = w * xi[i]
            row[n + 2] = w * y[t]
            k += 1
        t += 1
    return t, k


@njit(cache=True, fastmath=_FAST)
def _fill_tangents(
    stack: Stack,
    t: int,
    end: int,
    rest: Array,
    delta2: float,
    weights: Array,
    xi: Array,
    by: tuple[Array, Array, Array],
    rows: Array,
) -> tuple[int, int]:
    """As :func:`_fill`, with the tangents; `by` holds dξ_i by δ1, δ2 and the extremum."""
    u, v, y, root = stack.u_V, stack.rate_V_s, stack.y_um, stack.root_weight
    by1, by2, by3 = by
    n = rows.shape[1] - 6
    order = np.arange(1.0, rest.shape[0] + 1.0)
    remembers = True  # until no play stands where the extremum left it
    k = 0
    while t < end and k < rows.shape[0]:
        speed = abs(v[t])
        d1, d2, d3 = 0.0, 0.0, 0.0
        if remembers:
            remembers = False
            for i in range(n):
                if abs(xi[i] - u[t]) > rest[i] + delta2 * speed:
                    by3[i] = 0.0
                d3 += weights[i] * by3[i]
                remembers |= by3[i] != 0.0
        for i in range(rest.shape[0]):  # without branches, for the vector units
            r = rest[i] + delta2 * speed
            low, high = u[t] - r, u[t] + r
            x = xi[i]
            sign = (1.0 if x > high else 0.0) - (1.0 if x < low else 0.0)
            sticks = 1.0 - abs(sign)
            xi[i] = play(x, low, high)
            by1[i] = sticks * by1[i] + sign * order[i]
            by2[i] = sticks * by2[i] + sign * speed
            d1 += weights[i] * by1[i]
            d2 += weights[i] * by2[i]
        w = root[t]
        if w > 0.0:
            row = rows[k]
            row[0] = w
            row[1] = w * u[t]
            for i in range(n):
                row[2 + i] = w * xi[i]
            row[n + 2] = w * y[t]
            row[n + 3], row[n + 4], row[n + 5] = w * d1, w * d2, w * d3
            k += 1
        t += 1
    return t, k


@njit(cache=True)
def _rows(columns: int) -> Array:
    return np.empty((max(1, min(_BLOCK, _PRODUCT // columns**2)), columns))


@njit(cache=True)
def _centre(moments: Array, gram: Array, means: Array) -> None:
    count = moments[0, 0]
    if count <= 0.0:
        return
    for i in range(gram.shape[0]):
        means[i] = moments[0, i + 1] / count
    for i in range(gram.shape[0]):
        for j in range(gram.shape[1]):
            gram[i, j] = moments[i + 1, j + 1] - means[i] * moments[0, j + 1]


@njit(cache=True)
def gram_matrices(
    stack: Stack, n: int, delta1: float, delta2: float, extrema: Array
) -> tuple[Array, Array]:
    """Products of the regressors of every record, each less its record's mean."""
    records = extrema.shape[0]
    gram, means = np.zeros((records, n + 2, n + 2)), np.zeros((records, n + 2))
    rest, rows = _thresholds(delta1, n), _rows(n + 3)
    xi = np.empty_like(rest)
    for r in range(records):
        _initial_memory(rest, extrema[r], xi)
        moments = np.zeros((n + 3, n + 3))
        t = stack.edges[r]
        while t < stack.edges[r + 1]:
            t, k = _fill(stack, t, stack.edges[r + 1], rest, delta2, xi, rows)
            moments += np.dot(rows[:k].T, rows[:k])
        _centre(moments, gram[r], means[r])
    return gram, means


@njit(cache=True)
def tangent_matrices(
    stack: Stack, delta1: float, delta2: float, extrema: Array, weights: Array
) -> tuple[Array, Array]:
    """As :func:`gram_matrices`, with the columns of the tangents at weights a_0 ... a_n (µm/V)."""
    records, n = extrema.shape[0], weights.shape[0] - 1
    gram, means = np.zeros((records, n + 5, n + 5)), np.zeros((records, n + 5))
    rest, rows = _thresholds(delta1, n), _rows(n + 6)
    xi, padded = np.empty_like(rest), np.zeros_like(rest)
    padded[:n] = weights[1:]
    by = (np.zeros_like(rest), np.zeros_like(rest), np.zeros_like(rest))
    for r in range(records):
        _initial_memory(rest, extrema[r], xi)
        for i in range(n):
            by[0][i] = -np.sign(xi[i]) * (i + 1)
            by[1][i] = 0.0
            by[2][i] = abs(np.sign(xi[i]))
        moments = np.zeros((n + 6, n + 6))
        t = stack.edges[r]
        while t < stack.edges[r + 1]:
            t, k = _fill_tangents(stack, t, stack.edges[r + 1], rest, delta2, padded, xi, by, rows)
            moments += np.dot(rows[:k].T, rows[:k])
        _centre(moments, gram[r], means[r])
    return gram, means
