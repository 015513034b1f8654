"""Linear effects undone by a short filter that looks both ways along a known reference.

The sampled effect is H(z). Over a window of samples, weights w_j with Σ w_j e^{jθ} = 1 / H(e^θ) up
to some power of θ undo it exactly for references that are polynomials of that degree there. A first
lag becomes r + τ ṙ, a resonance r + 2ζ/ω0 ṙ + r̈/ω0², a delay T a shift r(t + T), each corrected for
a command that is linear between samples. Of all such weights those with the smallest sum of squares
are taken: they are least-squares polynomials through the window (Savitzky, Golay, Anal. Chem. 36,
1964), which pass on the least noise. An exact recursive inverse would ring, as H's zeros lie close
to z = -1 (lag) or outside the unit circle (resonance).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from baselines.inverses.base import Inverse
from rdpi_gym.support.arrays import Array


def powers_of_theta(polynomial: ArrayLike, order: int) -> Array:
    """Expand a polynomial in z, z = e^θ, in powers of θ."""
    p = np.asarray(polynomial, dtype=np.float64)
    i = np.arange(p.size, dtype=np.float64)
    return np.array([float(p @ i**q) / math.factorial(q) for q in range(order + 1)])


def power_ratio(numerator: Array, denominator: Array) -> Array:
    """Divide two power series of the same length."""
    ratio = np.zeros(len(numerator))
    for q in range(len(numerator)):
        known = ratio[:q] @ denominator[q:0:-1]
        ratio[q] = (numerator[q] - known) / denominator[0]
    return ratio


def inverse_series(column: Sequence[float], order: int) -> Array:
    """Expand 1 / H(e^θ) of a linear effect in powers of θ."""
    m = round(math.sqrt(len(column) + 3.0)) - 2
    p = np.asarray(column, dtype=np.float64)
    f = p[: m * m].reshape(m, m)
    g0, g1, c = (p[m * m + k * m : m * m + (k + 1) * m] for k in range(3))
    # x(k+1) = F x + G0 u(k) + G1 u(k+1) with the state x - G1 u
    b, d = f @ g1 + g0, c @ g1 + p[m * m + 3 * m]
    poles = np.poly(f)
    zeros = np.poly(f - np.outer(b, c)) + (d - 1.0) * poles
    return power_ratio(powers_of_theta(poles[::-1], order), powers_of_theta(zeros[::-1], order))


def preview_weights(series: Array, offsets: ArrayLike) -> Array:
    """Weights of the samples of a window with given powers of θ and the smallest sum of squares."""
    j = np.asarray(offsets, dtype=np.float64)
    rows = np.array([j**q / math.factorial(q) for q in range(len(series))])
    return np.asarray(np.linalg.pinv(rows) @ series, dtype=np.float64)


@njit(cache=True)
def filter_block(y: Array, weights: Array, state: Array, x: Array) -> None:
    """Weighted sum of the newest samples; the state holds those before the block, oldest first."""
    before = len(weights) - 1
    samples, lanes = y.shape
    for t in range(samples):
        for b in range(lanes):
            total = 0.0
            for j in range(before + 1):
                k = t + j - before
                total += weights[j] * (y[k, b] if k >= 0 else state[before + k, b])
            x[t, b] = total
    for j in range(before):
        k = samples + j - before
        for b in range(lanes):
            state[j, b] = y[k, b] if k >= 0 else state[before + k, b]


class PreviewFilter(Inverse):
    """An inverse that is a filter; a subclass sets `weights` and `rows` by :meth:`_set`."""

    weights: Array

    def _set(self, weights: Array) -> None:
        self.weights = weights
        self.rows = len(weights) - 1

    def start(self, y: Array) -> tuple[Array, Array]:
        """As if the output had been held for long; see :meth:`Inverse.start`."""
        return np.repeat(y[None], self.rows, axis=0), y.copy()

    def run(self, y: Array, state: Array) -> Array:
        """Filter; see :meth:`Inverse.run`."""
        x = np.empty_like(y)
        filter_block(y, self.weights, state, x)
        return x
