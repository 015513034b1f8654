"""Search over δ1 and δ2: a grid on thinned records, then Gauss-Newton steps on all samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.identification.least_squares import (
    BoolArray,
    cholesky_solve,
    gram_matrices,
    tangent_matrices,
    weights_of_records,
)
from rdpi_gym.identification.scale import Bounds, data_scales
from rdpi_gym.identification.stack import Stack, thin
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.progress import Progress


class Point(NamedTuple):
    """A place of the search."""

    theta: Array  # float64[2 + R]: δ1 (V), δ2 (s), memory extremum of each record (V)
    weights: Array  # float64[n + 1]: Best a_0 ... a_n (µm/V) there.
    offsets: Array  # float64[R]: Best offsets (µm) there
    passive: BoolArray  # bool[n + 1]: Weights off their bounds
    cost: float  # Sum of squared errors (µm²)
    # float64[R, n + 5, n + 5], float64[R, n + 5]: From
    # :func:`~rdpi_gym.identification.least_squares.tangent_matrices`, at the weights and offsets
    # that were expected before these were known
    tangents: Array
    means: Array
    expected: Array  # float64[n + 1]: Those weights (µm/V)


def moving_plays(gram: Array, motion: float) -> BoolArray:
    """Say which regressors move by `motion` (rms, as a part of the command's) in some record."""
    squares = gram.diagonal(axis1=1, axis2=2)[:, :-1]
    moving = (squares >= motion * motion * squares[:, :1]) & (squares > 0.0)
    return np.asarray(moving.any(axis=0))


def project(gram: Array, expected: Array, bounds: Bounds) -> tuple[Array, BoolArray, float]:
    """Best weights for the Gram matrices of the records, which of them are free, and the cost."""
    allowed, passive = np.ones((2, expected.size), dtype=np.bool_)
    weights, cost = weights_of_records(gram, expected, bounds.motion, bounds.a0, allowed, passive)
    return weights, passive, cost


def evaluate(stack: Stack, theta: Array, expected: Array, offsets: Array, bounds: Bounds) -> Point:
    """Solve for weights and offsets at `theta`, with tangents at those expected (µm/V, µm)."""
    tangents, means = tangent_matrices(stack, theta[0], theta[1], theta[2:], expected, offsets)
    weights, passive, cost = project(tangents, expected, bounds)
    offsets = offsets + _offsets(means, weights - expected)
    return Point(theta, weights, offsets, passive, cost, tangents, means, expected)


def _offsets(means: Array, weights: Array) -> Array:
    """Mean displacement of each record less that of a model with some weights (µm)."""
    left: Array = means[:, weights.size] - means[:, : weights.size] @ weights
    return left


def begin(stack: Stack, n: int, theta: Array, bounds: Bounds) -> Point:
    """As :func:`evaluate`, where nothing is known of the weights."""
    gram, means = gram_matrices(stack, n, theta[0], theta[1], theta[2:])
    weights, _, _ = project(gram, np.zeros(n + 1), bounds)
    return evaluate(stack, theta, weights, _offsets(means, weights), bounds)


@njit(cache=True)
def normal_equations(tangents: Array, change: Array) -> tuple[Array, Array]:
    """Normal matrix and gradient of Eq. 10 over (δ1, δ2, extrema, a_0 ... a_n), offsets taken out.

    `change` is that of the weights from those expected.
    """
    records, k = tangents.shape[0], change.shape[0]
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
                error -= row[m] * change[m]
            gradient[place[i]] += error
            for j in range(k + 3):
                matrix[place[i], place[j]] += row[column[j]]
    return matrix, gradient


@njit(cache=True)
def _step(
    matrix: Array,
    gradient: Array,
    theta: Array,
    weights: Array,
    passive: BoolArray,
    low: Array,
    high: Array,
    free_memory: bool,
    damping: float,
) -> tuple[Array, Array]:
    """Where a Gauss-Newton step over the free parameters leads, `theta` damped and within bounds."""
    nonlinear, size = theta.shape[0], gradient.shape[0]
    step, scale, rhs = np.empty(size), np.empty(size), np.empty(size)
    index, upper = np.empty(size, dtype=np.int64), np.empty((size, size))
    free = np.empty(size, dtype=np.bool_)
    for i in range(size):
        free[i] = passive[i - nonlinear] if i >= nonlinear else free_memory or i < 2
    left, again = True, False
    while left:
        k = np.int64(0)  # a literal would compile the solver twice
        for i in range(size):
            step[i] = 0.0
            if free[i] and matrix[i, i] > 0.0:
                index[k] = i
                scale[k] = 1.0 / np.sqrt(matrix[i, i])
                k += 1
        for i in range(k):
            rhs[i] = gradient[index[i]] * scale[i]
            for j in range(i):
                upper[j, i] = matrix[index[i], index[j]] * scale[i] * scale[j]
            upper[i, i] = 1.0 + (damping if index[i] < nonlinear else 0.0)
        if cholesky_solve(upper, rhs, k):
            for i in range(k):
                step[index[i]] = rhs[i] * scale[i]
        left = False
        for p in range(0 if again else nonlinear):
            at_low = theta[p] <= low[p] and step[p] < 0.0
            if at_low or (theta[p] >= high[p] and step[p] > 0.0):
                free[p], left = False, True
        again = True  # without those that would leave their bounds
    place, expected = np.empty(nonlinear), np.empty(size - nonlinear)
    for p in range(nonlinear):
        place[p] = min(max(theta[p] + step[p], low[p]), high[p])
    for i in range(size - nonlinear):
        expected[i] = max(weights[i] + step[nonlinear + i], 0.0)
    return place, expected


def refine(
    stack: Stack,
    start: Point,
    free_memory: bool,
    bounds: Bounds,
    budget: int,
    tolerance: float,
) -> tuple[Point, int]:
    """Walk downhill from a point: joint Gauss-Newton steps with damping, weights re-solved."""
    high = np.full(start.theta.size, bounds.reach_V)
    low = -high
    low[:2], high[:2] = zip(bounds.delta1_V, bounds.delta2_s, strict=True)
    best, damping, passes = start, 1e-3, 0
    while passes < budget:
        matrix, gradient = normal_equations(best.tangents, best.weights - best.expected)
        before = best.cost
        while damping < 1e8 and passes < budget:
            theta, expected = _step(
                matrix, gradient, best.theta, best.weights, best.passive, low, high,
                free_memory, damping,
            )  # fmt: skip
            trial = evaluate(stack, theta, expected, best.offsets, bounds)
            passes += 1
            if trial.cost < best.cost:
                best = trial
                damping *= 0.1
                break
            damping = max(10.0 * damping, 1e-6)
        if before - best.cost <= tolerance * before:
            break
    return best, passes


# The error has many valleys along δ1 (ways in which a comb of thresholds meets the weights), which
# a fine grid finds once δ2 is about right; along δ2 it has few.
_COARSE, _FINE = 8, 40
# Smallest δ1 of the grids: the whole comb within this part of the excursion.
_LOWEST_COMB = 0.05
# Thresholds grow by these parts of the excursion at the rms rate of the fastest record.
_DELTA2_PARTS = (0.02, 0.1, 0.5)
# Valleys of the fine grid to descend into, and passes over thinned data for each.
_STARTS, _THIN_BUDGET = 2, 8
# Thinned data have at least so many samples; the search is repeated on more of them where their
# error is this much larger than that of all samples.
_THIN_SAMPLES, _FAITHFUL = 400, 4.0
# Passes over all samples; a ripple of the error can be as wide as this factor of δ1 and as high as
# this factor of the error, and two passes tell whether a valley behind it is lower.
_FULL_BUDGET = 40
_AHEAD, _NEAR, _LOOK_BUDGET = 1.06, 1.01, 2
# Grid of memory extrema.
_EXTREMA = 41


def search(
    stack: Stack, n: int, *, free_memory: bool, bounds: Bounds, progress: Progress
) -> tuple[Point, int]:
    """Find the parameters of least squared error, Eq. 10."""
    samples, best, evaluations = _THIN_SAMPLES, None, 0
    while True:
        coarse = thin(stack, samples)
        start, passes = _look_around(coarse, n, free_memory, bounds, progress)
        evaluations += passes
        end, passes = _settle(stack, start, free_memory, bounds)
        evaluations += passes
        best = end if best is None or end.cost < best.cost else best
        # thinning that left more error than the whole data have may have hidden the right valley
        if coarse is stack or start.cost < _FAITHFUL * end.cost:
            progress("fitting", 100, 100)
            return best, evaluations
        samples *= 4


def _look_around(
    stack: Stack, n: int, free_memory: bool, bounds: Bounds, progress: Progress
) -> tuple[Point, int]:
    """Best valley of a coarse grid over δ1 and δ2, then of a fine one over δ1."""
    unmoved = np.zeros(stack.edges.size - 1)
    scales = data_scales(stack)
    lowest = _LOWEST_COMB * scales.excursion_V / n
    deltas1 = np.geomspace(lowest, scales.excursion_V, _COARSE)
    deltas2 = np.array(_DELTA2_PARTS) * scales.excursion_V / scales.fastest_V_s
    grid = np.empty((deltas2.size, deltas1.size))
    for k, delta2 in enumerate(deltas2):
        grid[k] = grid_costs(stack, n, deltas1, delta2, unmoved, bounds)
        progress("fitting", round(30 * (k + 1) / deltas2.size), 100)
    place = np.unravel_index(grid.argmin(), grid.shape)
    theta = np.concatenate([[deltas1[place[1]], deltas2[place[0]]], unmoved])
    first, passes = _descend(
        stack, begin(stack, n, theta, bounds), free_memory, bounds, _THIN_BUDGET
    )
    evaluations = grid.size + passes + 2

    deltas1 = np.geomspace(lowest, bounds.delta1_V[1], _FINE)
    costs = np.array(grid_costs(stack, n, deltas1, first.theta[1], first.theta[2:], bounds))
    evaluations += _FINE
    progress("fitting", 60, 100)
    ends = [first]
    for i in _valleys(costs)[:_STARTS]:
        theta = np.concatenate([[deltas1[i]], first.theta[1:]])
        end, passes = _descend(
            stack, begin(stack, n, theta, bounds), free_memory, bounds, _THIN_BUDGET
        )
        ends.append(end)
        evaluations += passes + 2
    progress("fitting", 80, 100)
    return min(ends, key=lambda point: point.cost), evaluations


def _settle(stack: Stack, start: Point, free_memory: bool, bounds: Bounds) -> tuple[Point, int]:
    """Walk down on all samples, then look ahead in δ1 for a lower valley behind a ripple."""
    near = evaluate(stack, start.theta, start.weights, start.offsets, bounds)
    best, passes = _descend(stack, near, free_memory, bounds, _FULL_BUDGET)
    ahead = best.theta.copy()
    ahead[0] *= _AHEAD if best.theta[0] > start.theta[0] else 1 / _AHEAD
    ahead[0] = np.clip(ahead[0], *bounds.delta1_V)
    other = evaluate(stack, ahead, best.weights, best.offsets, bounds)
    evaluations = passes + 2
    if other.cost < _NEAR * best.cost:
        other, passes = _descend(stack, other, free_memory, bounds, _LOOK_BUDGET)
        evaluations += passes
        if other.cost * _NEAR < best.cost:
            other, passes = _descend(stack, other, free_memory, bounds, _FULL_BUDGET)
            evaluations += passes
        best = min(best, other, key=lambda point: point.cost)
    return best, evaluations


def grid_costs(
    stack: Stack, n: int, deltas1: Array, delta2: float, extrema: Array, bounds: Bounds
) -> list[float]:
    """Squared error (µm²) at each δ1 (V), the rest as given."""
    return [
        project(gram_matrices(stack, n, delta1, delta2, extrema)[0], np.zeros(n + 1), bounds)[2]
        for delta1 in deltas1
    ]


def _valleys(costs: Array) -> NDArray[np.intp]:
    """Indices of the values no higher than their neighbours, lowest first."""
    padded = np.concatenate([[np.inf], costs, [np.inf]])
    lowest = np.flatnonzero((costs <= padded[:-2]) & (costs <= padded[2:]))
    return lowest[np.argsort(costs[lowest])]


def _descend(
    stack: Stack, start: Point, free_memory: bool, bounds: Bounds, budget: int
) -> tuple[Point, int]:
    # of N samples, a hundredth of one sample's share of the cost
    tolerance = 1e-2 / stack.u_V.size
    point, passes = refine(stack, start, False, bounds, budget, tolerance)
    for _ in range(2 if free_memory else 0):
        remembered = scan_memory(stack, point, bounds)
        point, more = refine(stack, remembered, True, bounds, budget, tolerance)
        passes += more + _EXTREMA
    return point, passes


def scan_memory(stack: Stack, point: Point, bounds: Bounds) -> Point:
    """Choose each record's memory extremum on a grid, weights refitted, δ1 and δ2 as they are."""
    n, records = point.weights.size - 1, stack.edges.size - 1
    extrema = np.linspace(-bounds.reach_V, bounds.reach_V, _EXTREMA)
    delta1, delta2 = point.theta[:2]
    grams = np.stack(
        [gram_matrices(stack, n, delta1, delta2, np.full(records, e))[0] for e in extrema]
    )
    weights = point.weights
    for _ in range(3):
        signed = np.concatenate([-weights, [1.0]])
        costs = np.einsum("i,erij,j->er", signed, grams, signed)
        choice = costs.argmin(axis=0)
        weights, _, _ = project(grams[choice, np.arange(records)], np.zeros(n + 1), bounds)
    theta = np.concatenate([point.theta[:2], extrema[choice]])
    found = begin(stack, n, theta, bounds)
    return found if found.cost < point.cost else point
