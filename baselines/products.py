"""Products of matrices and columns of lanes, each sum taken in order: a lane is the same in any company."""

from __future__ import annotations

import numpy as np
from numba import njit

from rdpi_gym.support.arrays import Array


def product(matrix: Array, columns: Array) -> Array:
    """Return ``matrix @ columns``, terms added one after the other.

    A library's product takes them in an order that hangs on the number of lanes, so that what a
    controller does in one of them differs in the last digit.
    """
    if not matrix.size:  # a model without states
        return np.zeros((*matrix.shape[:-1], columns.shape[1]))
    # One layout, so that one compiled kernel serves all: two that are kept by two processes at once
    # may be mistaken for one another.
    rows = np.require(np.atleast_2d(matrix), np.float64, ["C", "W"])
    found: Array = _products(rows, np.ascontiguousarray(columns))
    return found[0] if matrix.ndim == 1 else found


@njit(cache=True)
def _products(matrix: Array, columns: Array) -> Array:
    rows, terms = matrix.shape
    out = np.zeros((rows, columns.shape[1]))
    for r in range(rows):
        for k in range(terms):
            for b in range(columns.shape[1]):
                out[r, b] += matrix[r, k] * columns[k, b]
    return out


@njit(cache=True)
def lane_products(one: Array, other: Array) -> Array:
    """Return Σ_k one[k] other[k] of every lane, terms added one after the other."""
    out = np.zeros(one.shape[1])
    for k in range(one.shape[0]):
        for b in range(one.shape[1]):
            out[b] += one[k, b] * other[k, b]
    return out
