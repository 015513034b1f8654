"""Recursive least squares with forgetting and a prior, lane by lane."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from baselines.base import Rows
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


LEAST_ERROR = 0.02
"""Error of prediction, over the noise, below which models are not told apart."""
CORRELATED = 7
"""Samples of which one tells something new: errors of prediction follow one another."""


class NestedLeastSquares(ForgettingLeastSquares):
    """Least squares of nested models by one triangular factor, weighed by how well each predicts.

    θ minimises what :class:`ForgettingLeastSquares` does, but its sums are never squared: the factor
    D, R of R' D R, R unit triangular, takes a sample in by rotations without square roots, so it
    keeps the digits that normal equations lose. Forgetting leads back to the prior: as D decays by λ,
    a row of the prior is taken in at every sample, each in turn.

    Model m has the first of the coefficients in `order`, `sizes[m]` of them; its others are zero.
    Rotations pass its error of predicting the sample on the way. Its weight is one over the fourth
    power of Akaike's final prediction error: exp(2 p / n) times the mean square of these over the
    memory, with p coefficients and n independent samples in memory. Where a small model is enough, what a large one
    makes of noise has no weight.

    Examples
    --------
    >>> fit = NestedLeastSquares([0.0, 0.0], [1.0, 1.0], [1, 2], 0.01, memory_s=1.0, ts_s=0.01)
    >>> memory, rng = fit.start(lanes=1), np.random.default_rng(0)
    >>> for x in rng.normal(size=(100, 2, 1)):
    ...     fit.learn(memory, x, 2.0 * x[0] - x[1], np.array([True]))
    >>> fit.theta(memory)[:, 0].round(2).tolist()
    [2.0, -1.0]

    Notes
    -----
    Gentleman, J. Inst. Maths Applics 12, 1973; Miller, Applied Statistics AS 274, 1992; Akaike, Ann.
    Inst. Statist. Math. 21, 1969.
    """

    def __init__(
        self,
        prior: ArrayLike,
        spread: ArrayLike,
        sizes: Sequence[int],
        noise: float,
        memory_s: float,
        ts_s: float,
        order: Sequence[int] | None = None,
    ) -> None:
        super().__init__(prior, spread, noise, memory_s, ts_s)
        size = self.size
        self._order = np.arange(size) if order is None else np.asarray(order)
        self._place = np.argsort(self._order)
        self.sizes = tuple(sizes)
        self._prior = self.prior[self._order][:, None]
        self._precision = self.precision[self._order][:, None]
        independent = memory_s / (ts_s * CORRELATED)
        self._plain = np.exp([[-2.0 * count / independent] for count in sizes])
        self._share, self._least_um2 = 1.0 - self.kept, (LEAST_ERROR * noise) ** 2
        self._of = Rows(count=2, factor=size * (size + 3) // 2, errors=len(sizes), theta=size)
        self.rows = self._of.total

    def start(self, lanes: int) -> Array:
        """Return the memory of lanes that have seen nothing, float64[rows, lanes]."""
        memory = np.zeros((self.rows, lanes))
        factor = self._of.of(memory, "factor")
        factor[: self.size] = self._precision
        factor[self.size : 2 * self.size] = self._prior
        self._of.of(memory, "theta")[:] = self._prior
        return memory

    def theta(self, memory: Array) -> Array:
        """Return the estimate, float64[F, B]."""
        found: Array = self._of.of(memory, "theta")[self._place]
        return found

    def learn(self, memory: Array, phi: Array, z: Array, counts: NDArray[np.bool_]) -> None:
        """Judge the models by one sample, take it in, and solve where the turn has come."""
        count, factor, errors, theta = (
            self._of.of(memory, name) for name in ("count", "factor", "errors", "theta")
        )
        self.unlearn(memory, np.where(counts, self.kept, 1.0))
        missed = phi[self._order]
        _rotate(factor, missed, z.copy(), np.where(counts, 1.0, 0.0))
        _judge(errors, missed, self.sizes, counts, self._share)
        due = _due(count[1], counts)
        if not due.any():
            return
        weights = self._plain / (errors + self._least_um2)
        weights *= weights
        weights *= weights
        weights /= weights.sum(axis=0)
        theta[:] = np.where(due, 0.0, theta)
        for m, size in enumerate(self.sizes):
            _add_solution(factor, due, weights[m], size, theta)

    def unlearn(self, memory: Array, share: Array) -> None:
        """Keep a share ``(B,)`` of what was learned, and as much less of the prior in turn, in place."""
        count, factor = self._of.of(memory, "count"), self._of.of(memory, "factor")
        _forget(factor, share, self._precision, self._prior, count)


@njit(cache=True)
def _row(size: int, i: int) -> int:
    """Row of a factor in which r_ik stands, less k."""
    return 2 * size + i * (2 * size - i - 1) // 2 - i - 1


@njit(cache=True)
def _rotate(factor: Array, x: Array, z: Array, weight: Array) -> None:
    """Take a row of equations and its right side in; what of the right side each column leaves stays in x."""
    size, lanes = x.shape
    gain, own = np.empty(lanes), np.empty(lanes)
    for i in range(size):
        moves = False
        for b in range(lanes):
            own[b] = x[i, b]
            pivot = factor[i, b] + weight[b] * x[i, b] * x[i, b]
            gain[b] = weight[b] * x[i, b] / pivot
            weight[b] *= factor[i, b] / pivot
            factor[i, b] = pivot
            z[b] -= x[i, b] * factor[size + i, b]
            factor[size + i, b] += gain[b] * z[b]
            moves = moves or x[i, b] != 0.0
        if moves:
            row = _row(size, i)
            for k in range(i + 1, size):
                for b in range(lanes):
                    x[k, b] -= own[b] * factor[row + k, b]
                    factor[row + k, b] += gain[b] * x[k, b]
        for b in range(lanes):
            x[i, b] = z[b]


@njit(cache=True)
def _forget(factor: Array, kept: Array, precision: Array, prior: Array, count: Array) -> None:
    """Keep a share of what is known, and take in the row of the prior whose turn it is."""
    size, lanes = precision.shape[0], factor.shape[1]
    x, z, weight = np.zeros((size, lanes)), np.zeros(lanes), np.zeros(lanes)
    moves = False
    for b in range(lanes):
        if kept[b] < 1.0:
            moves = True
            turn = int(count[0, b])
            share = max(kept[b], 1.0 - 1.0 / size)
            for i in range(size):
                factor[i, b] *= share
            x[turn, b], z[b] = 1.0, prior[turn, 0]
            weight[b] = size * (1.0 - share) * precision[turn, 0]
            count[0, b] = (turn + 1) % size
    if moves:
        _rotate(factor, x, z, weight)


@njit(cache=True)
def _judge(
    mean_squares: Array,
    missed: Array,
    sizes: tuple[int, ...],
    counts: NDArray[np.bool_],
    share: float,
) -> None:
    """Move the mean square errors of the models on by one sample."""
    for m in range(len(sizes)):
        for b in range(len(counts)):
            taken = share if counts[b] else 0.0
            error = missed[sizes[m] - 1, b]
            mean_squares[m, b] += taken * (error * error - mean_squares[m, b])


@njit(cache=True)
def _due(count: Array, counts: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Count samples from one turn to the next; return where the turn to solve has come."""
    due = np.zeros(len(counts), dtype=np.bool_)
    for b in range(len(counts)):
        count[b] += 1.0 if counts[b] else 0.0
        due[b] = count[b] >= SOLVE_EVERY
        count[b] = 0.0 if due[b] else count[b]
    return due


@njit(cache=True)
def _add_solution(
    factor: Array, due: NDArray[np.bool_], weight: Array, last: int, theta: Array
) -> None:
    """Add the weighed solution of the first coefficients to the lanes that are due."""
    size = theta.shape[0]
    solved = np.empty(size)
    for b in np.flatnonzero(due):
        for i in range(last - 1, -1, -1):
            row = _row(size, i)
            found = factor[size + i, b]
            for k in range(i + 1, last):
                found -= factor[row + k, b] * solved[k]
            solved[i] = found
            theta[i, b] += weight[b] * found
