"""Gram matrices of Eq. 10's regressors and of their tangents, record by record.

For given δ1, δ2 and initial memory the displacement is linear in a_0 ... a_n and in one offset a
record. The play outputs never leave a block of samples: a least-squares fit needs only the
products. Columns of a record, in the order of every matrix here:

====================  ======================================================
column                meaning
====================  ======================================================
0                     command u (V), the regressor of a_0
1 ... n               ξ_1 ... ξ_n (V), the regressors of a_1 ... a_n
n + 1                 displacement y (µm), less what weights and offsets that
                      are expected make of the columns before
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


@njit(cache=True, fastmath=_FAST)
def _fill(
    u: Array,
    v: Array,
    y: Array,
    root: Array,
    t: int,
    end: int,
    rest: Array,
    delta2: float,
    xi: Array,
    rows: Array,
) -> tuple[int, int]:
    """Regressors of the samples from `t` on that count, as many as `rows` takes."""
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
    u: Array,
    v: Array,
    y: Array,
    root: Array,
    t: int,
    end: int,
    rest: Array,
    delta2: float,
    order: Array,
    offset: float,
    gain: float,
    weights: Array,
    xi: Array,
    by1: Array,
    by2: Array,
    by3: Array,
    rows: Array,
) -> tuple[int, int]:
    """As :func:`_fill`, with the tangents; `by1` ... `by3` hold dξ_i by δ1, δ2 and the extremum."""
    n = rows.shape[1] - 6
    remembers = True  # until no play stands where the extremum left it
    k = 0
    while t < end and k < rows.shape[0]:
        speed = abs(v[t])
        model, d1, d2, d3 = offset + gain * u[t], 0.0, 0.0, 0.0
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
            model += weights[i] * xi[i]
            d1 += weights[i] * by1[i]
            d2 += weights[i] * by2[i]
        w = root[t]
        if w > 0.0:
            row = rows[k]
            row[0] = w
            row[1] = w * u[t]
            for i in range(n):
                row[2 + i] = w * xi[i]
            row[n + 2] = w * (y[t] - model)
            row[n + 3], row[n + 4], row[n + 5] = w * d1, w * d2, w * d3
            k += 1
        t += 1
    return t, k


@njit(cache=True)
def _products(
    u: Array,
    v: Array,
    y: Array,
    root: Array,
    edges: NDArray[np.int64],
    delta1: float,
    delta2: float,
    extrema: Array,
    weights: Array,
    offsets: Array,
    plays: Array,
    rows: Array,
    moments: Array,
    gram: Array,
    means: Array,
) -> None:
    """Fill `gram` and `means` by record, with tangents where there are weights; the rest is room.

    One function, and room from outside: each function, slice and array of a kernel takes its time
    to compile.
    """
    order, rest, padded = plays[0], plays[1], plays[2]
    xi, by1, by2, by3 = plays[3], plays[4], plays[5], plays[6]
    n, total, part = rows.shape[1] - 3, moments[0], moments[1]
    if weights.shape[0] > 0:
        n = weights.shape[0] - 1
    for i in range(rest.shape[0]):
        order[i] = i + 1.0
        rest[i] = delta1 * (i + 1) if i < n else np.inf  # filled up with plays that never move
        padded[i] = weights[i + 1] if i + 1 < weights.shape[0] else 0.0
    for r in range(extrema.shape[0]):
        extremum = extrema[r]
        for i in range(rest.shape[0]):  # after the way from rest; 0 is the paper's condition
            xi[i] = extremum - np.sign(extremum) * rest[i] if abs(extremum) > rest[i] else 0.0
            by1[i] = -np.sign(xi[i]) * order[i]
            by2[i] = 0.0
            by3[i] = abs(np.sign(xi[i]))
        for i in range(total.shape[0]):
            for j in range(total.shape[1]):
                total[i, j] = 0.0
        t = edges[r]
        while t < edges[r + 1]:
            if weights.shape[0] > 0:
                t, k = _fill_tangents(
                    u, v, y, root, t, edges[r + 1], rest, delta2,
                    order, offsets[r], weights[0], padded, xi, by1, by2, by3, rows,
                )  # fmt: skip
            else:
                t, k = _fill(u, v, y, root, t, edges[r + 1], rest, delta2, xi, rows)
            np.dot(rows[:k].T, rows[:k], part)
            for i in range(total.shape[0]):
                for j in range(total.shape[1]):
                    total[i, j] += part[i, j]
        count = total[0, 0]
        if count > 0.0:
            for i in range(gram.shape[1]):
                means[r, i] = total[0, i + 1] / count
            for i in range(gram.shape[1]):
                for j in range(gram.shape[2]):
                    gram[r, i, j] = total[i + 1, j + 1] - means[r, i] * total[0, j + 1]


def _matrices(
    stack: Stack,
    n: int,
    delta1: float,
    delta2: float,
    extrema: Array,
    weights: Array,
    offsets: Array,
) -> tuple[Array, Array]:
    records, size = extrema.size, n + (5 if weights.size else 2)
    gram, means = np.zeros((records, size, size)), np.zeros((records, size))
    rows = np.empty((max(1, min(_BLOCK, _PRODUCT // (size + 1) ** 2)), size + 1))
    plays = np.empty((7, -(-n // _VECTOR) * _VECTOR))
    moments = np.empty((2, size + 1, size + 1))
    _products(*stack, delta1, delta2, extrema, weights, offsets, plays, rows, moments, gram, means)
    return gram, means


_NONE = np.empty(0)


def gram_matrices(
    stack: Stack, n: int, delta1: float, delta2: float, extrema: Array
) -> tuple[Array, Array]:
    """Products of the regressors of every record, each less its record's mean."""
    return _matrices(stack, n, delta1, delta2, extrema, _NONE, _NONE)


def tangent_matrices(
    stack: Stack, delta1: float, delta2: float, extrema: Array, weights: Array, offsets: Array
) -> tuple[Array, Array]:
    """As :func:`gram_matrices`, with tangents at weights a_0 ... a_n (µm/V) and offsets (µm).

    What these leave of the displacement stands in its place: a small error as a difference of large
    squares would be rounding.
    """
    return _matrices(stack, weights.size - 1, delta1, delta2, extrema, weights, offsets)


BoolArray = NDArray[np.bool_]
# A column this much dependent on the others (squared sine) adds nothing but rounding.
_DEPENDENT = 1e-13


@njit(cache=True)
def cholesky_solve(upper: Array, x: Array, k: int) -> bool:
    """Solve the system of the first `k` rows in place, given its upper half; its diagonal is one."""
    for j in range(k):
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
            return False
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
    return True


@njit(cache=True)
def weights_of_records(
    grams: Array,
    expected: Array,
    motion: float,
    floor: float,
    allowed: BoolArray,
    passive: BoolArray,
) -> tuple[Array, float]:
    """Minimise the sum of the records' d'Gd - 2b'd + c, d = x - expected, for x >= 0 and x_0 >= floor.

    Return x and the minimum. The first rows and columns of a record's matrix are G, then b and c.
    Fills `allowed` with what also moves by `motion` (rms, as a part of the first column's) in some
    record, and `passive`, at first a guess, with what is off its bound.

    Notes
    -----
    Lawson, Hanson, Solving Least Squares Problems, chapter 23 (the active set); on the Gram matrix
    as Bro, de Jong, J. Chemometrics 11 (1997). Columns are scaled to unit length first.
    """
    k = allowed.shape[0]
    gram, scaled, upper = np.empty((k, k)), np.empty((k, k)), np.empty((k, k))
    rhs, target, trial = np.empty(k), np.empty(k), np.empty(k)
    x, scale, index = np.empty(k), np.empty(k), np.empty(k, dtype=np.int64)
    cost = 0.0
    for r in range(grams.shape[0]):
        cost += grams[r, k, k]
    for i in range(k):
        moving, x[i], rhs[i] = False, 0.0, 0.0
        for j in range(k):
            gram[i, j] = 0.0
        for r in range(grams.shape[0]):
            rhs[i] += grams[r, i, k]
            for j in range(k):
                gram[i, j] += grams[r, i, j]
            own = grams[r, i, i]
            moving |= own >= motion * motion * grams[r, 0, 0] and own > 0.0
        allowed[i] &= moving and gram[i, i] > 0.0
        passive[i] &= allowed[i]
        scale[i] = 1.0 / np.sqrt(gram[i, i]) if gram[i, i] > 0.0 else 0.0
    for i in range(k):
        for j in range(k):
            scaled[i, j] = gram[i, j] * scale[i] * scale[j]
        target[i] = rhs[i] - gram[i, 0] * floor
        for j in range(k):
            target[i] += gram[i, j] * expected[j]
        target[i] *= scale[i]
    size, entering = 0.0, -1
    for i in range(k):
        size = max(size, abs(target[i]))
    for _ in range(10 * k):
        while True:
            free = np.int64(0)  # a literal would compile the solver twice
            for i in range(k):
                if passive[i]:
                    index[free] = i
                    free += 1
            for m in range(free):
                trial[m] = target[index[m]]
                for j in range(m + 1):
                    upper[j, m] = scaled[index[m], index[j]]
            if not cholesky_solve(upper, trial, free):
                if entering < 0:
                    for i in range(k):
                        passive[i] = False
                else:
                    passive[entering] = allowed[entering] = False
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
                allowed[entering] = False  # rounding alone said that it could leave its bound
                break
        best, entering = 1e-13 * size, -1
        for i in range(k):
            if allowed[i] and not passive[i]:
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
    for i in range(k):
        trial[i] = x[i] - expected[i]
    for i in range(k):
        cost -= 2.0 * trial[i] * rhs[i]
        for j in range(k):
            cost += trial[i] * trial[j] * gram[i, j]
    return x, max(cost, 0.0)


def bounded_least_squares(
    gram: Array, rhs: Array, allowed: BoolArray, floor: float, guess: BoolArray
) -> tuple[Array, BoolArray]:
    """Minimise x'Gx - 2b'x for x >= 0 and x_0 >= floor; say which x are off their bounds."""
    bordered, passive = np.zeros((1, rhs.size + 1, rhs.size + 1)), guess.copy()
    bordered[0, :-1, :-1], bordered[0, :-1, -1] = gram, rhs
    x, _ = weights_of_records(bordered, np.zeros(rhs.size), 0.0, floor, allowed.copy(), passive)
    return x, passive


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
    n = rhs.size
    index = np.concatenate([np.arange(n), turned])
    sign = np.where(np.arange(index.size) < n, 1.0, -1.0)
    both = gram[np.ix_(index, index)] * np.outer(sign, sign)
    found, _ = bounded_least_squares(both, sign * rhs[index], allowed, floor, guess)
    x: Array = found[:n].copy()
    x[turned] -= found[n:]
    return x
