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
from numpy.typing import NDArray

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
    rest = np.empty(-(-n // _VECTOR) * _VECTOR)
    for i in range(rest.shape[0]):
        rest[i] = delta1 * (i + 1) if i < n else np.inf
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
    order = np.empty(rest.shape[0])
    for i in range(rest.shape[0]):
        order[i] = i + 1.0
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
def _add(sums: Array, part: Array) -> None:
    for i in range(sums.shape[0]):
        for j in range(sums.shape[1]):
            sums[i, j] += part[i, j]


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
            _add(moments, np.dot(rows[:k].T, rows[:k]))
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
    for i in range(n):
        padded[i] = weights[i + 1]
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
            _add(moments, np.dot(rows[:k].T, rows[:k]))
        _centre(moments, gram[r], means[r])
    return gram, means


BoolArray = NDArray[np.bool_]
# A column this much dependent on the others (squared sine) adds nothing but rounding.
_DEPENDENT = 1e-13


@njit(cache=True)
def cholesky_solve(matrix: Array, rhs: Array) -> tuple[bool, Array]:
    """Solve a small symmetric system whose diagonal is one."""
    k = rhs.shape[0]
    upper, x = np.empty((k, k)), rhs.copy()
    for j in range(k):
        for i in range(j, k):
            upper[j, i] = matrix[i, j]
        m = 0
        while m + 4 <= j:  # four earlier rows at a time, along the row
            f0, f1, f2, f3 = upper[m, j], upper[m + 1, j], upper[m + 2, j], upper[m + 3, j]
            for i in range(j, k):
                left = upper[j, i] - upper[m, i] * f0 - upper[m + 1, i] * f1
                upper[j, i] = left - upper[m + 2, i] * f2 - upper[m + 3, i] * f3
            m += 4
        while m < j:
            f0 = upper[m, j]
            for i in range(j, k):
                upper[j, i] -= upper[m, i] * f0
            m += 1
        if upper[j, j] <= _DEPENDENT:
            return False, rhs.copy()
        upper[j, j] = np.sqrt(upper[j, j])
        for i in range(j + 1, k):
            upper[j, i] /= upper[j, j]
        x[j] /= upper[j, j]
        for i in range(j + 1, k):
            x[i] -= upper[j, i] * x[j]
    for i in range(k - 1, -1, -1):
        for m in range(i + 1, k):
            x[i] -= upper[i, m] * x[m]
        x[i] /= upper[i, i]
    return True, x


@njit(cache=True)
def _solve_passive(gram: Array, rhs: Array, index: NDArray[np.int64]) -> tuple[bool, Array]:
    k = index.shape[0]
    matrix, part = np.empty((k, k)), np.empty(k)
    for i in range(k):
        part[i] = rhs[index[i]]
        for j in range(k):
            matrix[i, j] = gram[index[i], index[j]]
    solved, x = cholesky_solve(matrix, part)
    return solved, x


@njit(cache=True)
def bounded_least_squares(
    gram: Array, rhs: Array, allowed: BoolArray, floor: float, guess: BoolArray
) -> tuple[Array, BoolArray]:
    """Minimise x'Gx - 2b'x for x >= 0 and x_0 >= floor (Lawson and Hanson's active set).

    Notes
    -----
    Lawson, Hanson, Solving Least Squares Problems, chapter 23; on the Gram matrix as Bro, de Jong,
    J. Chemometrics 11 (1997). Columns are scaled to unit length first.
    """
    k = rhs.shape[0]
    scale = np.zeros(k)
    for i in range(k):
        if gram[i, i] > 0.0:
            scale[i] = 1.0 / np.sqrt(gram[i, i])
    scaled = np.empty((k, k))
    target = np.empty(k)
    for i in range(k):
        for j in range(k):
            scaled[i, j] = gram[i, j] * scale[i] * scale[j]
        target[i] = (rhs[i] - gram[i, 0] * floor) * scale[i]
    size = 0.0
    x, index = np.zeros(k), np.empty(k, dtype=np.int64)
    usable, passive = np.empty(k, dtype=np.bool_), np.empty(k, dtype=np.bool_)
    for i in range(k):
        size = max(size, abs(target[i]))
        usable[i] = allowed[i] and scale[i] > 0.0
        passive[i] = usable[i] and guess[i]
    entering = -1
    for _ in range(10 * k):
        while True:
            free = 0
            for i in range(k):
                if passive[i]:
                    index[free] = i
                    free += 1
            solved, trial = _solve_passive(scaled, target, index[:free])
            if not solved:
                if entering < 0:
                    for i in range(k):
                        passive[i] = False
                else:
                    passive[entering] = usable[entering] = False
                break
            step = 1.0
            for m in range(free):
                if trial[m] <= 0.0:
                    now = x[index[m]]
                    step = min(step, now / (now - trial[m]) if now > trial[m] else 0.0)
            for m in range(free):
                i = index[m]
                x[i] += step * (trial[m] - x[i])
                if trial[m] <= 0.0 and x[i] <= 1e-15 * size:
                    x[i] = 0.0
                    passive[i] = False
            if step == 1.0:
                break
            if entering >= 0 and not passive[entering]:
                usable[entering] = False  # rounding alone said that it could leave its bound
                break
        best, entering = 1e-13 * size, -1
        for i in range(k):
            if usable[i] and not passive[i]:
                slope = target[i]
                for j in range(k):
                    slope -= scaled[i, j] * x[j]
                if slope > best:
                    best, entering = slope, i
        if entering < 0:
            break
        passive[entering] = True
    for i in range(k):
        x[i] *= scale[i]
    x[0] += floor
    return x, passive


@njit(cache=True)
def signed_least_squares(
    gram: Array,
    rhs: Array,
    turned: NDArray[np.intp],
    allowed: BoolArray,
    floor: float,
    guess: BoolArray,
) -> Array:
    """Minimise x'Gx - 2b'x where only the `turned` x may be negative.

    `allowed` and `guess` hold a value for every x, then one for the negative part of each turned x.
    """
    n, k = rhs.shape[0], allowed.shape[0]
    both, right = np.empty((k, k)), np.empty(k)
    for i in range(k):
        a, sign = (i, 1.0) if i < n else (turned[i - n], -1.0)
        right[i] = sign * rhs[a]
        for j in range(n):
            both[i, j] = sign * gram[a, j]
        for j in range(n, k):
            both[i, j] = -sign * gram[a, turned[j - n]]
    found, _ = bounded_least_squares(both, right, allowed, floor, guess)
    x: Array = found[:n].copy()
    for i in range(n, k):
        x[turned[i - n]] -= found[i]
    return x
