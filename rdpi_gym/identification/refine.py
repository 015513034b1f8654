"""Variable projection: Levenberg-Marquardt over δ1, δ2 and memory, weights solved for inside."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from rdpi_gym.identification.bounds import Bounds
from rdpi_gym.identification.gram import gram_matrices, tangent_matrices
from rdpi_gym.identification.nonnegative import BoolArray, bounded_least_squares, cholesky_solve
from rdpi_gym.identification.stack import Stack
from rdpi_gym.support.arrays import Array


class Point(NamedTuple):
    """A place of the search.

    Parameters
    ----------
    theta : float64[2 + R]
        δ1 (V), δ2 (s), memory extremum of each record (V).
    weights : float64[n + 1]
        Best a_0 ... a_n (µm/V) there.
    passive : bool[n + 1]
        Weights off their bounds.
    cost : float
        Sum of squared errors (µm²).
    tangents, means : float64[R, n + 5, n + 5], float64[R, n + 5]
        From :func:`~rdpi_gym.identification.gram.tangent_matrices`, at the weights that were
        expected before these were known.
    """

    theta: Array
    weights: Array
    passive: BoolArray
    cost: float
    tangents: Array
    means: Array


@njit(cache=True)
def moving_plays(gram: Array, motion: float) -> BoolArray:
    """Say which regressors move by `motion` (rms, as a part of the command's) in some record."""
    moving = np.zeros(gram.shape[1] - 1, dtype=np.bool_)
    for r in range(gram.shape[0]):
        least = motion * motion * gram[r, 0, 0]
        for i in range(moving.shape[0]):
            moving[i] |= gram[r, i, i] >= least and gram[r, i, i] > 0.0
    return moving


@njit(cache=True)
def project(gram: Array, bounds: Bounds) -> tuple[Array, BoolArray, float]:
    """Best weights for the Gram matrices of the records, which of them are free, and the cost."""
    total = np.sum(gram, axis=0)
    k = total.shape[0] - 1
    allowed = moving_plays(gram, bounds.motion)
    weights, passive = bounded_least_squares(
        total[:k, :k].copy(), total[:k, k].copy(), allowed, bounds.a0, allowed
    )
    cost = total[k, k]
    for i in range(k):
        cost -= 2.0 * weights[i] * total[i, k]
        for j in range(k):
            cost += weights[i] * weights[j] * total[i, j]
    return weights, passive, max(cost, 0.0)


@njit(cache=True)
def evaluate(stack: Stack, theta: Array, expected: Array, bounds: Bounds) -> Point:
    """Solve for the weights at `theta`, with tangents at weights expected there (µm/V)."""
    tangents, means = tangent_matrices(stack, theta[0], theta[1], theta[2:], expected)
    k = expected.shape[0] + 1
    weights, passive, cost = project(tangents[:, :k, :k], bounds)
    return Point(theta, weights, passive, cost, tangents, means)


@njit(cache=True)
def begin(stack: Stack, n: int, theta: Array, bounds: Bounds) -> Point:
    """As :func:`evaluate`, where nothing is known of the weights."""
    gram, _ = gram_matrices(stack, n, theta[0], theta[1], theta[2:])
    weights, _, _ = project(gram, bounds)
    point: Point = evaluate(stack, theta, weights, bounds)
    return point


@njit(cache=True)
def normal_equations(tangents: Array, weights: Array) -> tuple[Array, Array]:
    """Normal matrix and gradient of Eq. 10 over (δ1, δ2, extrema, a_0 ... a_n), offsets taken out."""
    records, k = tangents.shape[0], weights.shape[0]
    size = 2 + records + k
    matrix, gradient = np.zeros((size, size)), np.zeros(size)
    place = np.empty(k + 3, dtype=np.int64)
    for i in range(k):
        place[i] = 2 + records + i
    place[k], place[k + 1] = 0, 1
    column = np.empty(k + 3, dtype=np.int64)
    for i in range(k):
        column[i] = i
    column[k], column[k + 1], column[k + 2] = k + 1, k + 2, k + 3
    for r in range(records):
        place[k + 2] = 2 + r
        for i in range(k + 3):
            row = tangents[r, column[i]]
            error = row[k]
            for m in range(k):
                error -= row[m] * weights[m]
            gradient[place[i]] += error
            for j in range(k + 3):
                matrix[place[i], place[j]] += row[column[j]]
    return matrix, gradient


@njit(cache=True)
def _step(matrix: Array, gradient: Array, free: BoolArray, nonlinear: int, damping: float) -> Array:
    """Gauss-Newton step over the free parameters; the first `nonlinear` of them are damped."""
    step = np.zeros(gradient.shape[0])
    index = np.flatnonzero(free & (np.diag(matrix) > 0.0))
    k = index.shape[0]
    scale, rhs, scaled = np.empty(k), np.empty(k), np.empty((k, k))
    for i in range(k):
        scale[i] = 1.0 / np.sqrt(matrix[index[i], index[i]])
    for i in range(k):
        rhs[i] = gradient[index[i]] * scale[i]
        for j in range(k):
            scaled[i, j] = matrix[index[i], index[j]] * scale[i] * scale[j]
        scaled[i, i] = 1.0 + (damping if index[i] < nonlinear else 0.0)
    solved, x = cholesky_solve(scaled, rhs)
    if solved:
        for i in range(k):
            step[index[i]] = x[i] * scale[i]
    return step


@njit(cache=True)
def refine(
    stack: Stack,
    start: Point,
    free_memory: bool,
    bounds: Bounds,
    budget: int,
    tolerance: float,
) -> tuple[Point, int]:
    """Walk downhill from a point: joint Gauss-Newton steps with damping, weights re-solved."""
    nonlinear = start.theta.shape[0]
    low, high = np.empty(nonlinear), np.empty(nonlinear)
    low[0], high[0] = bounds.delta1_V
    low[1], high[1] = bounds.delta2_s
    low[2:], high[2:] = -bounds.reach_V, bounds.reach_V
    best, damping, passes = start, 1e-3, 0
    while passes < budget:
        matrix, gradient = normal_equations(best.tangents, best.weights)
        before = best.cost
        while damping < 1e8 and passes < budget:
            free = np.ones(gradient.shape[0], dtype=np.bool_)
            free[nonlinear:] = best.passive
            free[2:nonlinear] = free_memory
            step = _step(matrix, gradient, free, nonlinear, damping)
            for p in range(nonlinear):
                at_low = best.theta[p] <= low[p] and step[p] < 0.0
                if at_low or (best.theta[p] >= high[p] and step[p] > 0.0):
                    free[p] = False
            step = _step(matrix, gradient, free, nonlinear, damping)
            theta = np.minimum(np.maximum(best.theta + step[:nonlinear], low), high)
            expected = np.maximum(best.weights + step[nonlinear:], 0.0)
            trial = evaluate(stack, theta, expected, bounds)
            passes += 1
            if trial.cost < best.cost:
                best = trial
                damping *= 0.1
                break
            damping = max(10.0 * damping, 1e-6)
        if before - best.cost <= tolerance * before:
            break
    return best, passes
