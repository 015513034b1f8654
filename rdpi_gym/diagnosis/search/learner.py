"""Generic learners of a residual, each tried on blocks of data that it has not seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.diagnosis.features.memory import FAMILIES
from rdpi_gym.support.arrays import Array

_RIDGES = (1e-7, 1e-5, 1e-3, 3e-2)
_FOLDS = 8
_BLOCKS, _FEWEST_BLOCKS = 48, 16  # of all samples, and of those that are asked for
_GAP = 0.15  # of a block: so much on either side of what is held out is not learned from
_RARE = 1e-3  # share of residuals that are larger than a learner may predict


@dataclass(frozen=True)
class Part:
    """One record, some of its samples.

    Parameters
    ----------
    features : float64[N, K] by group
        Of the input's past, what follows the clock taken off.
    residual_um : float64[N]
        What is to be predicted, likewise.
    asked : bool[N]
        Samples on which a learner is tried; all are learned from where they are not held out.
    """

    features: Mapping[str, Array]
    residual_um: Array
    asked: NDArray[np.bool_]

    @cached_property
    def matrix(self) -> Array:
        """All features, side by side."""
        return np.column_stack(list(self.features.values()))


@dataclass(frozen=True)
class HeldOut:
    """Squared residuals of blocks that were held out, B of them.

    Parameters
    ----------
    before, after : float64[B]
        Sums of squares (µm²), without and with what the learner predicts.
    rows : list of slice
        Where each block stands: the part, and its samples there.
    """

    before: Array
    after: Array
    rows: tuple[tuple[int, slice], ...]


def learn_across(parts: Sequence[Part]) -> HeldOut:
    """Predict every block of the samples asked for from all other data, with gaps in between.

    Parameters
    ----------
    parts
        Records.

    Notes
    -----
    Ridge regressions, on several sets of features and with several strengths, and one learner that
    predicts nothing. The one that predicts a fold is chosen by its errors in the other folds, so
    that no block speaks for its own learner. Some of the features are a layer of random units: a
    small neural network whose last layer alone is fitted (Rahimi, Recht, "Weighted sums of random
    kitchen sinks", NIPS 2008). A learner predicts nothing larger than it has seen.
    """
    matrix = np.concatenate([part.matrix for part in parts])
    target = np.concatenate([part.residual_um for part in parts])
    size = np.sqrt(np.mean(matrix**2, axis=0))
    matrix /= np.where(size > 0.0, size, 1.0)
    labels = np.concatenate([[n] * x.shape[1] for n, x in parts[0].features.items()])
    sets = [np.flatnonzero(np.isin(labels, family)) for family in FAMILIES]
    blocks, starts = _blocks(parts)
    gram, rhs = matrix.T @ matrix, matrix.T @ target
    largest = float(np.quantile(np.abs(target), 1.0 - _RARE))
    after = np.empty((len(blocks), len(sets) * len(_RIDGES) + 1))
    spans = [slice(starts[k] + rows.start, starts[k] + rows.stop) for k, rows in blocks]
    before = np.array([float(target[span] @ target[span]) for span in spans])
    folds = np.arange(len(blocks)) % _FOLDS
    for fold in range(min(_FOLDS, len(blocks))):
        own = np.flatnonzero(folds == fold)
        out = _with_gaps([blocks[b] for b in own], parts, starts)
        lost = matrix[out]
        weights = _ridges(
            gram - lost.T @ lost, rhs - lost.T @ target[out], sets, len(target) - len(out)
        )
        for b in own:
            predicted = np.clip(matrix[spans[b]] @ weights, -largest, largest)
            after[b] = np.sum((target[spans[b], None] - predicted) ** 2, axis=0)
    chosen = np.empty(len(blocks), dtype=np.intp)
    for fold in range(_FOLDS):
        chosen[folds == fold] = np.argmin(after[folds != fold].sum(axis=0))
    return HeldOut(before, after[np.arange(len(blocks)), chosen], tuple(blocks))


def _blocks(parts: Sequence[Part]) -> tuple[list[tuple[int, slice]], list[int]]:
    """Blocks of neighbouring samples that are asked for; and where each part begins."""
    lengths = [len(part.residual_um) for part in parts]
    asked = sum(int(np.count_nonzero(part.asked)) for part in parts)
    longest = max(1, min(sum(lengths) // _BLOCKS, asked // _FEWEST_BLOCKS))
    blocks = []
    for k, part in enumerate(parts):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], part.asked, [False]])))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            pieces = max(1, round((last - first) / longest))
            cuts = np.linspace(first, last, pieces + 1).round().astype(int)
            blocks += [(k, slice(a, b)) for a, b in pairwise(cuts)]
    starts = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    return blocks, [int(start) for start in starts]


def _with_gaps(
    blocks: Sequence[tuple[int, slice]], parts: Sequence[Part], starts: Sequence[int]
) -> NDArray[np.intp]:
    """Rows of blocks and of the gaps beside them."""
    rows = []
    for k, block in blocks:
        gap = max(1, round(_GAP * (block.stop - block.start)))
        first = max(block.start - gap, 0)
        last = min(block.stop + gap, len(parts[k].residual_um))
        rows.append(starts[k] + np.arange(first, last))
    return np.unique(np.concatenate(rows))


def _ridges(gram: Array, rhs: Array, sets: Sequence[NDArray[np.intp]], rows: int) -> Array:
    """Weights of all learners, a column each, the last without any."""
    from scipy.linalg import cho_factor, cho_solve

    weights = np.zeros((len(rhs), len(sets) * len(_RIDGES) + 1))
    for i, own in enumerate(sets):
        part = gram[np.ix_(own, own)]
        for j, ridge in enumerate(_RIDGES):
            factor = cho_factor(part + ridge * rows * np.eye(len(own)), check_finite=False)
            weights[own, i * len(_RIDGES) + j] = cho_solve(factor, rhs[own], check_finite=False)
    return weights
