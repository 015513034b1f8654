"""Recursive least squares with forgetting and a prior, lane by lane."""

from __future__ import annotations

import math

import numpy as np
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

    Parameters
    ----------
    prior, spread
        Expected parameters and their standard deviations, each ``(F,)``.
    noise
        Standard deviation of z - θ·φ, in the unit of z.
    memory_s
        Time constant of the forgetting (s).
    ts_s
        Sampling time (s).
    least
        Lower bounds of the parameters, ``(F,)``, -inf where there is none: θ then minimises the sum
        within them. None: no bounds.

    Raises
    ------
    InputError
        A spread, the noise or the memory is not above zero.

    Attributes
    ----------
    rows : int
        Rows of its memory: the count of samples, R, b and θ.

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
        self._least = None if least is None else np.asarray(least, dtype=np.float64)
        self._kept = math.exp(-ts_s / memory_s)
        self._precision = np.diag((noise / deviation) ** 2)
        self._pull = self._precision @ self.prior
        self.size = len(self.prior)
        self.rows = 1 + self.size * self.size + 2 * self.size

    def start(self, lanes: int) -> Array:
        """Return the memory of lanes that have seen nothing, float64[rows, lanes]."""
        memory = np.zeros((self.rows, lanes))
        memory[-self.size :] = self.prior[:, None]
        return memory

    def theta(self, memory: Array) -> Array:
        """Return the estimate, a view, float64[F, B]."""
        return memory[-self.size :]

    def learn(self, memory: Array, phi: Array, z: Array, counts: NDArray[np.bool_]) -> None:
        """Take one sample in, and solve where the turn has come.

        Parameters
        ----------
        memory
            ``float64[rows, B]``, moved on in place.
        phi, z
            ``(F, B)`` and ``(B,)``.
        counts
            ``(B,)``: where false the lane learns nothing, and forgets nothing.
        """
        size, lanes = self.size, memory.shape[1]
        products = memory[1 : 1 + size * size].reshape(size, size, lanes)
        moments = memory[1 + size * size : 1 + size * size + size]
        kept = np.where(counts, self._kept, 1.0)
        products *= kept
        moments *= kept
        counted = phi * counts
        products += counted[:, None] * phi
        moments += counted * z
        memory[0] += counts
        due = counts & (memory[0] % SOLVE_EVERY == 0.0)
        if due.any():
            left = np.moveaxis(products[:, :, due], 2, 0) + self._precision
            right = moments[:, due].T + self._pull
            if self._least is None:
                self.theta(memory)[:, due] = np.linalg.solve(left, right[:, :, None])[:, :, 0].T
            else:
                self.theta(memory)[:, due] = self._projected(
                    left, right, self.theta(memory)[:, due]
                )

    def _projected(self, left: Array, right: Array, theta: Array) -> Array:
        """Go on from θ towards the least sum of squares within the bounds, coordinate by coordinate.

        Each step is exact in its coordinate, so the sum falls with every one, and a few sweeps at
        every turn follow the minimum (Gauss and Seidel's iteration, projected).
        """
        assert self._least is not None
        for _ in range(SWEEPS):
            for i in range(self.size):
                slope = right[:, i] - np.einsum("bf,fb->b", left[:, i], theta)
                theta[i] = np.maximum(theta[i] + slope / left[:, i, i], self._least[i])
        return theta

    def unlearn(self, memory: Array, share: Array) -> None:
        """Keep a share ``(B,)`` of what was learned and move θ to the prior alike, in place."""
        memory[1 : -self.size] *= share
        theta = self.theta(memory)
        theta *= share
        theta += (1.0 - share) * self.prior[:, None]
