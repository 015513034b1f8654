"""Least squares with lower bounds on a Gram matrix: the weights of Eq. 10 for given thresholds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.support.arrays import Array

BoolArray = NDArray[np.bool_]
# A column this much dependent on the others (squared sine) adds nothing but rounding.
_DEPENDENT = 1e-13


@njit(cache=True)
def cholesky_solve(matrix: Array, rhs: Array) -> tuple[bool, Array]:
    """Solve a small symmetric system whose diagonal is one."""
    k = rhs.shape[0]
    low, x = np.zeros((k, k)), rhs.copy()
    for i in range(k):
        for j in range(i + 1):
            total = matrix[i, j]
            for m in range(j):
                total -= low[i, m] * low[j, m]
            if i == j:
                if total <= _DEPENDENT:
                    return False, x
                low[i, i] = np.sqrt(total)
            else:
                low[i, j] = total / low[j, j]
    for i in range(k):
        for m in range(i):
            x[i] -= low[i, m] * x[m]
        x[i] /= low[i, i]
    for i in range(k - 1, -1, -1):
        for m in range(i + 1, k):
            x[i] -= low[m, i] * x[m]
        x[i] /= low[i, i]
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
    size = np.max(np.abs(target))

    x = np.zeros(k)
    usable = allowed & (scale > 0.0)
    passive = usable & guess
    entering = -1
    for _ in range(10 * k):
        while True:
            index = np.flatnonzero(passive)
            solved, trial = _solve_passive(scaled, target, index)
            if not solved:
                if entering < 0:
                    passive[:] = False
                else:
                    passive[entering] = usable[entering] = False
                break
            step = 1.0
            for m in range(index.shape[0]):
                if trial[m] <= 0.0:
                    now = x[index[m]]
                    step = min(step, now / (now - trial[m]) if now > trial[m] else 0.0)
            for m in range(index.shape[0]):
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
    x *= scale
    x[0] += floor
    return x, passive


def signed_least_squares(
    gram: Array, rhs: Array, signed: Sequence[bool], allowed: BoolArray, floor: float
) -> Array:
    """Minimise x'Gx - 2b'x where only some x may be negative."""
    turned, n = np.flatnonzero(signed), len(rhs)
    if not turned.size:
        whole: Array = bounded_least_squares(
            np.ascontiguousarray(gram), rhs, allowed, floor, allowed
        )[0]
        return whole
    index = np.concatenate([np.arange(n), turned])
    signs = np.concatenate([np.ones(n), -np.ones(len(turned))])
    both = np.ascontiguousarray(gram[np.ix_(index, index)] * np.outer(signs, signs))
    may = allowed[index]
    found, _ = bounded_least_squares(both, rhs[index] * signs, may, floor, may)
    x: Array = found[:n].copy()
    x[turned] -= found[n:]
    return x
