"""Standard errors of a fit, honest where the error is not white."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.identification.search import Point, normal_equations
from rdpi_gym.support.arrays import Array

# Normal quantile of a 95 % interval.
Z95 = 1.959964
# Longer correlations are summed by Fourier transform.
_DIRECT_LAGS = 128
# Information (scaled to unit diagonal) below this is rounding.
_SINGULAR = 1e-13


def correlation_length(error: Array, mask: NDArray[np.bool_]) -> float:
    """Number of samples that carry the information of one independent sample.

    One plus twice the sum of the autocorrelation, taken in pairs of lags up to the first pair
    that is not positive; at least 1, which is what white noise gives.

    Notes
    -----
    Geyer, Practical Markov chain Monte Carlo, Statistical Science 7 (1992): the initial positive
    sequence.
    """
    centred = np.where(mask, error - error[mask].mean(), 0.0)
    total, ended = _positive_pairs(centred, centred * centred, _DIRECT_LAGS)
    if not ended:  # a slow error: all lags at once, up to half the record
        lags = centred.size // 4 * 2
        spectrum = np.fft.rfft(centred, n=centred.size + lags)
        power = np.fft.irfft(spectrum.real**2 + spectrum.imag**2)[:lags]
        pairs = power.reshape(-1, 2).sum(axis=1) / power[0]
        not_positive = np.flatnonzero(pairs <= 0.0)
        total = float(pairs[: not_positive[0] if not_positive.size else pairs.size].sum())
    return max(1.0, 2.0 * float(total) - 1.0)


@njit(cache=True, fastmath={"reassoc", "contract"})
def _positive_pairs(centred: Array, squares: Array, lags: int) -> tuple[float, bool]:
    """Sum of the autocorrelation over pairs of lags, and whether a pair ended it within `lags`."""
    power, total = 0.0, 0.0
    for t in range(squares.shape[0]):
        power += squares[t]
    for lag in range(0, min(lags, centred.shape[0] - 1), 2):
        pair = 0.0
        for shift in range(lag, lag + 2):
            for t in range(centred.shape[0] - shift):
                pair += centred[t] * centred[t + shift]
        if not pair > 0.0:
            return total, True
        total += pair / power
    return total, centred.shape[0] <= lags


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Standard errors, infinite where the data say nothing."""

    theta: Array  # float64[2 + R]: of δ1 (V), δ2 (s) and each record's memory extremum (V)
    weights: Array  # float64[n + 1]: of a_0 ... a_n (µm/V).
    offsets: Array  # float64[R]: of each record's offset (µm)


def standard_errors(
    point: Point,
    counted: Sequence[int],
    variances: Sequence[float],
    lengths: Sequence[float],
    *,
    free_memory: bool,
) -> Uncertainty:
    """Standard errors from the Jacobian at the optimum.

    The covariance is that of least squares whose errors have, in record r, a variance and a
    correlation length of their own: (J'J)^-1 (Σ_r variance_r length_r J_r'J_r) (J'J)^-1.

    Notes
    -----
    Weights at their bound are held there for the others' errors; their own is what it would be if
    they were free.
    """
    records, k = len(counted), point.weights.size
    size = 2 + records + k
    free = np.concatenate([[True, True], np.full(records, free_memory), point.passive])
    samples = sum(counted)
    used = int(free.sum()) + records
    noise = np.array(variances) * np.array(lengths) * samples / max(samples - used, 1)

    information, scatter = np.zeros((size, size)), np.zeros((size, size))
    columns = np.empty((records, k + 3), dtype=np.int64)  # where tangents' columns stand in size
    for r in range(records):
        part, _ = normal_equations(point.tangents[r : r + 1], point.weights - point.expected)
        place = np.r_[0, 1, 2 + r, 2 + records : size]
        information[np.ix_(place, place)] += part
        scatter[np.ix_(place, place)] += noise[r] * part
        columns[r] = np.r_[place[3:], 0, 1, 2 + r]

    inverse = _inverse(information, free & (np.diag(information) > 0.0))
    covariance = inverse @ scatter @ inverse
    variance = np.diag(covariance)
    # below zero by rounding alone, where the data say nothing
    errors = np.sqrt(np.where(variance >= 0.0, variance, np.inf))
    own = np.diag(information)
    errors[free & (own == 0.0)] = np.inf
    alone = own - np.diag(information @ inverse @ information)  # what the free ones cannot do
    typical = float(np.average(noise, weights=counted))
    for p in np.flatnonzero(~point.passive) + 2 + records:
        told = alone[p] > _SINGULAR * own[p]
        errors[p] = np.sqrt(typical / alone[p]) if told else np.inf

    slopes = np.zeros((records, size))
    regressors = np.r_[:k, k + 1 : k + 4]  # the displacement's own column is left out
    for r in range(records):
        slopes[r, columns[r]] = point.means[r, regressors]
    offsets = np.sqrt(
        noise / np.array(counted) + np.einsum("rp,pq,rq->r", slopes, covariance, slopes)
    )
    return Uncertainty(errors[: 2 + records], errors[2 + records :], offsets)


def _inverse(information: Array, free: NDArray[np.bool_]) -> Array:
    """Inverse over the free parameters, zero elsewhere; what is undetermined gets a huge variance."""
    index = np.flatnonzero(free)
    scale = 1.0 / np.sqrt(np.diag(information)[index])
    values, vectors = np.linalg.eigh(information[np.ix_(index, index)] * np.outer(scale, scale))
    vectors *= scale[:, None]
    inverse = np.zeros_like(information)
    inverse[np.ix_(index, index)] = (vectors / np.maximum(values, _SINGULAR)) @ vectors.T
    return inverse
