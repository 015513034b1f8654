"""The score: cross-fitted residuals in blocks, the logarithm of each block's mean square over the floor."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rdpi_gym.diagnosis.beam.constants import (
    BLOCK_LENGTHS,
    FEWEST_BLOCKS,
    FOLDS,
    MOST_BLOCKS,
    RIDGE,
)
from rdpi_gym.identification.least_squares import BoolArray
from rdpi_gym.support.arrays import Array

_SMALLEST = 1e-150  # Squares of what is no smaller, and of its inverse, are within the floats


def correlation_length(left: Array) -> float:
    """Integrated autocorrelation length of a residual (samples), 1 for white noise.

    Notes
    -----
    1 + 2 Σ ρ_k up to the first ρ_k that is not positive.
    """
    x = left - left.mean()
    size = 2 * x.size
    power = np.abs(np.fft.rfft(x, size)) ** 2
    covariance = np.fft.irfft(power, size)[: x.size]
    if covariance[0] <= 0.0:
        return 1.0
    rho = covariance / covariance[0]
    ends = np.flatnonzero(rho <= 0.0)
    return float(1.0 + 2.0 * rho[1 : int(ends[0]) if ends.size else x.size].sum())


def independent_share(left: Array) -> float:
    """Share of the values of a residual that are independent, 1 for white noise.

    Notes
    -----
    1 / Σ ρ_k² over all lags (Bartlett 1946), by the ordinates P of the periodogram: 2 mean(P)² /
    mean(P²), as those of white noise are exponential. A residual that repeats with the command is no
    more than one period of it.
    """
    power = np.abs(np.fft.rfft(left - left.mean())[1:]) ** 2
    mean_square = float(np.mean(power**2)) if power.size else 0.0
    return min(2.0 * float(np.mean(power)) ** 2 / mean_square, 1.0) if mean_square > 0.0 else 1.0


@dataclass(frozen=True)
class Blocks:
    """Division of the samples of all records into blocks that count as independent."""

    counts: tuple[int, ...]  # Blocks of each record

    @classmethod
    def of(cls, lefts: Sequence[Array]) -> Blocks:
        """Divide records by how long their residuals are correlated."""
        counts = []
        for left in lefts:
            wanted = left.size / (BLOCK_LENGTHS * correlation_length(left))
            most = min(MOST_BLOCKS, max(left.size // 2, 1))
            counts.append(int(min(max(wanted, min(FEWEST_BLOCKS, most)), most)))
        return cls(tuple(counts))

    def independent(self, lefts: Sequence[Array]) -> Array:
        """Return the share of each block's values that are independent, ``(B,)``: that of its record."""
        return np.repeat([independent_share(left) for left in lefts], self.counts)

    def mean_squares(self, lefts: Sequence[Array]) -> Array:
        """Return the mean square of each block (µm²), ``(B,)``."""
        found = []
        for left, count in zip(lefts, self.counts, strict=True):
            edges = np.linspace(0, left.size, count + 1).astype(np.intp)
            found.append(np.add.reduceat(left**2, edges[:-1]) / np.diff(edges))
        return np.concatenate(found)

    def scores(self, lefts: Sequence[Array], floors_um: Sequence[Array]) -> Array:
        """Return the score of each block (nats), ``(B,)``: zero at the floor of its samples and below."""
        return np.log(np.maximum(self.ratios(lefts, floors_um), 1.0))

    def of_noise(self, lefts: Sequence[Array]) -> Array:
        """Return the expected score of each block of white noise at its floor (nats), ``(B,)``.

        The logarithm of a mean square of n such samples is near Gaussian, of mean -1 / n and variance
        2 / n.
        """
        sizes = [left.size / count for left, count in zip(lefts, self.counts, strict=True)]
        expected = [1.0 / math.sqrt(math.pi * n) - 0.5 / n for n in sizes]
        return np.repeat(expected, self.counts)

    def ratios(self, lefts: Sequence[Array], floors_um: Sequence[Array]) -> Array:
        """Return the mean square of each block in units of the floor of each sample, ``(B,)``."""
        pairs = zip(lefts, floors_um, strict=True)
        parts = (left / np.maximum(floor, _SMALLEST) for left, floor in pairs)
        return self.mean_squares(
            [np.clip(each, -1.0 / _SMALLEST, 1.0 / _SMALLEST) for each in parts]
        )


def squares(lefts: Iterable[Array]) -> float:
    """Sum of squares of residuals (µm²); infinite where a fit has left the floats."""
    with np.errstate(over="ignore", invalid="ignore"):
        return sum(float(left @ left) for left in lefts)


def cross_fitted(
    rows: Sequence[Array],
    moves: BoolArray,
    validation: Sequence[Array] = (),
    own: BoolArray | None = None,
) -> list[Array]:
    """Return what a linearised model leaves of stretches to which it was not fitted (µm), by record.

    Parameters
    ----------
    rows
        By record that is fitted: derivatives by each number, and the residual, ``(N, P + 1)``.
    moves
        Which of the numbers may move, ``(P,)``.
    validation
        The same of records that are never fitted.
    own
        Which of the numbers tell of the experiment and not of the plant, ``(P,)``: these are fitted to
        the other stretches of the records to judge by as well.

    Notes
    -----
    One Gauss-Newton step from the fit to all other stretches, for each stretch: leave-one-out of
    blocks in closed form, at the price of one fit (the approximate cross-validation of Beirami et
    al. 2017 and Giordano et al. 2019).
    """
    columns = np.flatnonzero(moves)
    pairs = [(each[:, columns], each[:, -1]) for each in rows]
    gram = np.sum([x.T @ x for x, _ in pairs], axis=0)
    pull = np.sum([x.T @ left for x, left in pairs], axis=0)
    ridge = np.diag(RIDGE * np.diag(gram) + 1e-300)
    found = [_left_out(x, left, gram + ridge, pull) for x, left in pairs]
    step = _solved(gram + ridge, pull)
    judged = [np.column_stack([v[:, :-1], v[:, -1] - v[:, columns] @ step]) for v in validation]
    return [*found, *gone_on(rows, np.zeros_like(moves) if own is None else moves & own, judged)]


def gone_on(rows: Sequence[Array], own: BoolArray, validation: Sequence[Array]) -> list[Array]:
    """Return what is left of records to judge by where some numbers go on from the fit to these."""
    local = np.flatnonzero(own)
    told = np.sum([x[:, local].T @ x[:, local] for x in rows], axis=0)
    return within([(each[:, local], each[:, -1]) for each in validation], told)


def within(pairs: Sequence[tuple[Array, Array]], told: Array | float = 0.0) -> list[Array]:
    """Return what is left of stretches of records after a step of some numbers to all other stretches.

    Parameters
    ----------
    pairs
        By record, derivatives by these numbers, ``(N, Q)``, and the residual.
    told
        Products of their derivatives on other records that they were fitted to, ``(Q, Q)``.
    """
    if not any(x.size for x, _ in pairs):
        return [left for _, left in pairs]
    gram = told + np.sum([x.T @ x for x, _ in pairs], axis=0)
    pull = np.sum([x.T @ left for x, left in pairs], axis=0)
    ridge = np.diag(RIDGE * np.diag(gram) + 1e-300)
    return [_left_out(x, left, gram + ridge, pull) for x, left in pairs]


def further_step(pairs: Sequence[tuple[Array, Array]]) -> Array:
    """Return the step of some numbers to all stretches, as :func:`within` has these."""
    gram = np.sum([x.T @ x for x, _ in pairs], axis=0)
    pull = np.sum([x.T @ left for x, left in pairs], axis=0)
    return _solved(gram + np.diag(RIDGE * np.diag(gram) + 1e-300), pull)


def _left_out(x: Array, left: Array, gram: Array, pull: Array) -> Array:
    """Leave out each stretch of a record in turn, and return what the step to the rest leaves of it."""
    out = left.copy()
    for part in _stretches(left.size):
        own, own_left = x[part], left[part]
        out[part] = own_left - own @ _solved(gram - own.T @ own, pull - own.T @ own_left)
    return out


def whole_step(rows: Sequence[Array], moves: BoolArray) -> Array:
    """Return the Gauss-Newton step of the numbers that may move, to all records."""
    columns = np.flatnonzero(moves)
    gram = np.sum([x[:, columns].T @ x[:, columns] for x in rows], axis=0)
    pull = np.sum([x[:, columns].T @ x[:, -1] for x in rows], axis=0)
    return _solved(gram + np.diag(RIDGE * np.diag(gram) + 1e-300), pull)


def _solved(gram: Array, pull: Array) -> Array:
    if not pull.size:
        return pull
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    step: Array = np.linalg.solve(gram / np.outer(size, size), pull / size) / size
    return step


def _stretches(samples: int) -> list[slice]:
    edges = np.linspace(0, samples, min(FOLDS, samples) + 1).astype(np.intp)
    return [slice(int(a), int(b)) for a, b in pairwise(edges)]


def orthogonal(columns: Sequence[Array], to: Sequence[Array]) -> list[Array]:
    """Return columns (by record) less what others of the same records explain of them."""
    ours, theirs = np.concatenate(columns), np.concatenate(to)
    ours = ours - theirs @ np.linalg.lstsq(theirs, ours, rcond=RIDGE)[0]
    return np.split(ours, np.cumsum([len(each) for each in columns])[:-1])
