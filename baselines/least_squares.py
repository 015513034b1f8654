"""Recursive least squares with forgetting and a prior, lane by lane."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError

SOLVE_EVERY = 5
"""Samples between two solutions: the sums are kept at every sample, the equations solved at these."""
SWEEPS = 3
"""Sweeps over the coordinates at a solution within bounds."""


class ForgettingLeastSquares:
    """θ minimises Σ λ^(k-j) (z(j) - θ·φ(j))² + Σ_i (noise / spread_i)² (θ_i - prior_i)².

    The sums R = Σ λ^(k-j) φ φᵀ and b = Σ λ^(k-j) φ z are kept, and the prior is added as they are
    solved, so that it is never forgotten: what the data do not excite stays at the prior, and the
    estimate cannot wind up as a covariance with forgetting does (Ljung, System Identification,
    1999, 11.2).

    Examples
    --------
    >>> fit = ForgettingLeastSquares([0.0], [10.0], noise=0.01, memory_s=1.0, ts_s=0.1)
    >>> memory = fit.start(lanes=1)
    >>> for x in (1.0, -2.0, 3.0, 1.0, 2.0):
    ...     fit.learn(memory, np.array([[x]]), np.array([4.0 * x]), np.array([True]))
    >>> round(float(fit.theta(memory)[0, 0]), 3)
    4.0
    """

    def __init__(
        self,
        prior: ArrayLike,
        spread: ArrayLike,
        noise: float,
        memory_s: float,
        ts_s: float,
        least: ArrayLike | None = None,
    ) -> None:
        self.prior = np.asarray(prior, dtype=np.float64)
        deviation = np.asarray(spread, dtype=np.float64)
        if not (np.all(deviation > 0.0) and is_finite(noise) and noise > 0.0 and memory_s > 0.0):
            raise InputError(
                f"spreads {deviation.tolist()}, noise {noise} and memory {memory_s} s; give each above 0"
            )
        self.spread = deviation
        self._least = None if least is None else np.asarray(least, dtype=np.float64)
        self.kept = math.exp(-ts_s / memory_s)
        self.precision = (noise / deviation) ** 2
        self.pull = self.precision * self.prior
        self.size = len(self.prior)
        self.rows = 1 + self.size * (self.size + 1) // 2 + 2 * self.size

    def start(self, lanes: int) -> Array:
        """Return the memory of lanes that have seen nothing, float64[rows, lanes]."""
        memory = np.zeros((self.rows, lanes))
        memory[-self.size :] = self.prior[:, None]
        return memory

    def theta(self, memory: Array) -> Array:
        """Return the estimate, a view, float64[F, B]."""
        return memory[-self.size :]

    def learn(self, memory: Array, phi: Array, z: Array, counts: NDArray[np.bool_]) -> None:
        """Take one sample in, and solve where the turn has come."""
        due = _take_in(memory, phi, z, counts, self.kept)
        if not due.any():
            return
        if self._least is None:
            _solve(memory, due, self.precision, self.pull, self.size, self.theta(memory))
        else:
            _project(memory, due, self.precision, self.pull, self._least)

    def unlearn(self, memory: Array, share: Array) -> None:
        """Keep a share ``(B,)`` of what was learned and move θ to the prior alike, in place."""
        if (share == 1.0).all():
            return
        memory[1 : -self.size] *= share
        theta = self.theta(memory)
        theta *= share
        theta += (1.0 - share) * self.prior[:, None]


@njit(cache=True)
def _take_in(
    memory: Array, phi: Array, z: Array, counts: NDArray[np.bool_], kept: float
) -> NDArray[np.bool_]:
    """Move the sums of all lanes on by one sample; return where the turn to solve has come."""
    size, lanes = phi.shape
    forget, used = np.where(counts, kept, 1.0), np.where(counts, 1.0, 0.0)
    due = np.zeros(lanes, dtype=np.bool_)
    row = 1
    for i in range(size):
        for j in range(i + 1):
            for lane in range(lanes):
                memory[row, lane] = (
                    forget[lane] * memory[row, lane] + used[lane] * phi[i, lane] * phi[j, lane]
                )
            row += 1
    for i in range(size):
        for lane in range(lanes):
            memory[row, lane] = (
                forget[lane] * memory[row, lane] + used[lane] * phi[i, lane] * z[lane]
            )
        row += 1
    for lane in range(lanes):
        memory[0, lane] += used[lane]
        due[lane] = counts[lane] and memory[0, lane] % SOLVE_EVERY == 0.0
    return due


@njit(cache=True)
def _equations(
    memory: Array,
    lane: int,
    precision: Array,
    pull: Array,
    whole: int,
    left: Array,
    right: Array,
) -> None:
    """Write one lane's equations of the first coefficients among `whole`, the prior in them: both triangles, right side."""
    size = len(precision)
    row = 1
    for i in range(size):
        for j in range(i + 1):
            left[i, j] = left[j, i] = memory[row, lane]
            row += 1
        left[i, i] += precision[i]
    row = 1 + whole * (whole + 1) // 2
    for i in range(size):
        right[i] = memory[row + i, lane] + pull[i]


@njit(cache=True)
def _solve(
    memory: Array,
    due: NDArray[np.bool_],
    precision: Array,
    pull: Array,
    whole: int,
    theta: Array,
) -> None:
    """Solve the equations of the lanes that are due: L D Lᵀ, L below the diagonal and D Lᵀ on and above."""
    size = len(precision)
    left, right = np.empty((size, size)), np.empty(size)
    for lane in np.flatnonzero(due):
        _equations(memory, lane, precision, pull, whole, left, right)
        for i in range(size):
            for j in range(i + 1):
                for k in range(j):
                    left[j, i] -= left[j, k] * left[k, i]
                if j < i:
                    left[i, j] = left[j, i] / left[j, j]
                    right[i] -= left[i, j] * right[j]
            # R has no negative eigenvalue, so a pivot is the prior's at least
            left[i, i] = max(left[i, i], precision[i])
        for i in range(size - 1, -1, -1):
            right[i] /= left[i, i]
            for k in range(i + 1, size):
                right[i] -= left[k, i] * right[k]
            theta[i, lane] = right[i]


@njit(cache=True)
def _project(
    memory: Array, due: NDArray[np.bool_], precision: Array, pull: Array, least: Array
) -> None:
    """Go on from θ towards the least sum of squares within the bounds, coordinate by coordinate.

    Each step is exact in its coordinate, so the sum falls with every one, and a few sweeps at every
    turn follow the minimum (Gauss and Seidel's iteration, projected).
    """
    size = len(precision)
    left, right = np.empty((size, size)), np.empty(size)
    theta = memory[len(memory) - size :]
    for lane in np.flatnonzero(due):
        _equations(memory, lane, precision, pull, size, left, right)
        for _ in range(SWEEPS):
            for i in range(size):
                slope = right[i]
                for k in range(size):
                    slope -= left[i, k] * theta[k, lane]
                theta[i, lane] = max(theta[i, lane] + slope / left[i, i], least[i])


JUDGED_S = 0.1
"""Time constant (s) over which a model's squared errors of prediction are averaged."""
LEAST_ERROR = 0.02
"""Error of prediction, over the noise, below which models are not told apart."""


class NestedLeastSquares(ForgettingLeastSquares):
    """Estimates of nested models on the same sums, weighed by how well each predicts.

    Model m has the first of the coefficients, with spreads of its own; its others are zero. It predicts
    each sample before it is taken in; its weight is one over the fourth power of the mean square of
    what it misses. Where a small model is enough, what a large one makes of noise has no weight.

    Examples
    --------
    >>> fit = NestedLeastSquares([0.0, 0.0], [[1.0], [1.0, 1.0]], 0.01, memory_s=1.0, ts_s=0.01)
    >>> memory, rng = fit.start(lanes=1), np.random.default_rng(0)
    >>> for x in rng.normal(size=(100, 2, 1)):
    ...     fit.learn(memory, x, 2.0 * x[0] - x[1], np.array([True]))
    >>> fit.theta(memory)[:, 0].round(2).tolist()
    [2.0, -1.0]
    """

    def __init__(
        self,
        prior: ArrayLike,
        spreads: Sequence[ArrayLike],
        noise: float,
        memory_s: float,
        ts_s: float,
    ) -> None:
        super().__init__(prior, spreads[-1], noise, memory_s, ts_s)
        self._precisions = [(noise / np.asarray(each, dtype=np.float64)) ** 2 for each in spreads]
        self._pulls = [each * self.prior[: len(each)] for each in self._precisions]
        self._first = 1 + self.size * (self.size + 1) // 2 + self.size
        self._end = self._first + len(spreads) * self.size
        self._share, self._least_um2 = -math.expm1(-ts_s / JUDGED_S), (LEAST_ERROR * noise) ** 2
        self.rows = self._end + len(spreads) + self.size

    def start(self, lanes: int) -> Array:
        """Return the memory of lanes that have seen nothing, float64[rows, lanes]."""
        memory = super().start(lanes)
        for i, precision in enumerate(self._precisions):
            self._of(memory, i)[: len(precision)] = self.prior[: len(precision), None]
        return memory

    def _of(self, memory: Array, model: int) -> Array:
        return memory[self._first + model * self.size : self._first + (model + 1) * self.size]

    def learn(self, memory: Array, phi: Array, z: Array, counts: NDArray[np.bool_]) -> None:
        """Judge the models by one sample, take it in, and solve where the turn has come."""
        estimates, errors = memory[self._first : self._end], memory[self._end : -self.size]
        _judge(estimates, phi, z, counts, self._share, errors)
        due = _take_in(memory, phi, z, counts, self.kept)
        for i, (precision, pull) in enumerate(zip(self._precisions, self._pulls, strict=True)):
            own = self._of(memory, i)[: len(precision)]
            _solve(memory, due, precision, pull, self.size, own)
        _weigh(estimates, errors, self._least_um2, self.theta(memory))

    def unlearn(self, memory: Array, share: Array) -> None:
        """Keep a share ``(B,)`` of what was learned and move every estimate to the prior alike, in place."""
        if (share == 1.0).all():
            return
        memory[1 : self._end] *= share
        for i, precision in enumerate(self._precisions):
            own = self._of(memory, i)[: len(precision)]
            own += (1.0 - share) * self.prior[: len(precision), None]
        theta = self.theta(memory)
        theta *= share
        theta += (1.0 - share) * self.prior[:, None]


@njit(cache=True)
def _judge(
    estimates: Array,
    phi: Array,
    z: Array,
    counts: NDArray[np.bool_],
    share: float,
    errors: Array,
) -> None:
    """Move the mean squares of what the models miss on by one sample."""
    size = phi.shape[0]
    for m in range(errors.shape[0]):
        for lane in range(phi.shape[1]):
            missed = z[lane]
            for i in range(size):
                missed -= estimates[m * size + i, lane] * phi[i, lane]
            if counts[lane]:
                errors[m, lane] += share * (missed * missed - errors[m, lane])


@njit(cache=True)
def _weigh(estimates: Array, errors: Array, least: float, theta: Array) -> None:
    """Fill the mean of the estimates, each weighed by one over the fourth power of its mean square."""
    size, models = theta.shape[0], errors.shape[0]
    for lane in range(theta.shape[1]):
        total = 0.0
        for i in range(size):
            theta[i, lane] = 0.0
        for m in range(models):
            weight = 1.0 / (errors[m, lane] + least)
            weight *= weight
            weight *= weight
            total += weight
            for i in range(size):
                theta[i, lane] += weight * estimates[m * size + i, lane]
        for i in range(size):
            theta[i, lane] /= total
