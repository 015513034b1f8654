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
# A record is held out whole where there are three of its role or more, else in as many pieces.
_PIECES = (4, 2)
_GAP = 0.15  # of what is held out: so much on either side of it is not learned from either
_FOLDS = 8  # at most
_BLOCKS = 24  # of all that is held out
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
    """Squared residuals of blocks of samples that were held out, B of them.

    Parameters
    ----------
    before, after : float64[B]
        Sums of squares (µm²), without and with what the learner predicts.
    blocks
        Where each stands: the part, and its samples there.
    """

    before: Array
    after: Array
    blocks: tuple[tuple[int, slice], ...]


def learn_across(parts: Sequence[Part]) -> HeldOut:
    """Predict the samples asked for, record after record, from all other data.

    Notes
    -----
    What is held out at a time is long, a record or a large piece of one with gaps beside it: across
    a short stretch a slow disturbance is known from either side, and features that are slow
    themselves would carry it over. The errors are summed over shorter blocks, which have a spread.

    Ridge regressions, on several sets of features and with several strengths, and one learner that
    predicts nothing. The one that predicts a fold is chosen by its errors in the other folds, so
    that no fold speaks for its own learner; the records that are not asked for choose too. Some of the features are a layer of random units: a
    small neural network whose last layer alone is fitted (Rahimi, Recht, "Weighted sums of random
    kitchen sinks", NIPS 2008). A learner predicts nothing larger than it has seen.
    """
    matrix = np.concatenate([part.matrix for part in parts])
    target = np.concatenate([part.residual_um for part in parts])
    size = np.sqrt(np.mean(matrix**2, axis=0))
    matrix /= np.where(size > 0.0, size, 1.0)
    labels = np.concatenate([[n] * x.shape[1] for n, x in parts[0].features.items()])
    sets = [np.flatnonzero(np.isin(labels, family)) for family in FAMILIES]
    starts = np.cumsum([0, *(len(part.residual_um) for part in parts)])
    folds = _folds(parts)
    longest = sum(int(np.count_nonzero(part.asked)) for part in parts) / _BLOCKS
    gram, rhs = matrix.T @ matrix, matrix.T @ target
    largest = float(np.quantile(np.abs(target), 1.0 - _RARE))
    blocks: list[tuple[int, slice]] = []
    owners, before, after = [], [], []
    for fold, held in enumerate(folds):
        out = np.concatenate([_with_gaps(rows, starts[k], starts[k + 1]) for k, rows in held])
        lost = matrix[out]
        weights = _ridges(
            gram - lost.T @ lost, rhs - lost.T @ target[out], sets, len(target) - len(out)
        )
        for k, rows in ((k, rows) for k, piece in held for rows in _cut(piece, longest)):
            span = slice(starts[k] + rows.start, starts[k] + rows.stop)
            predicted = np.clip(matrix[span] @ weights, -largest, largest)
            blocks.append((k, rows))
            owners.append(fold)
            before.append(float(target[span] @ target[span]))
            after.append(np.sum((target[span, None] - predicted) ** 2, axis=0))
    left, owner = np.array(after), np.array(owners)
    chosen = [int(np.argmin(left[owner != fold].sum(axis=0))) for fold in range(len(folds))]
    asked = [b for b, (k, rows) in enumerate(blocks) if parts[k].asked[rows.start]]
    return HeldOut(
        np.array(before)[asked],
        left[asked, np.array(chosen)[owner[asked]]],
        tuple(blocks[b] for b in asked),
    )


def _folds(parts: Sequence[Part]) -> list[list[tuple[int, slice]]]:
    """What is held out together: records, or pieces of them, those that are asked for spread out."""
    pieces: list[tuple[int, slice]] = []
    for asked in (True, False):
        runs = []
        for k, part in enumerate(parts):
            own = part.asked if asked else ~part.asked
            edges = np.flatnonzero(np.diff(np.concatenate([[False], own, [False]])))
            runs += [(k, slice(a, b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
        number = dict(enumerate(_PIECES, start=1)).get(len(runs), 1)
        pieces += [(k, x) for k, run in runs for x in _cut(run, (run.stop - run.start) / number)]
    return [pieces[fold::_FOLDS] for fold in range(min(_FOLDS, len(pieces)))]


def _with_gaps(rows: slice, start: int, end: int) -> NDArray[np.intp]:
    """Rows of a stretch and of the gaps beside it, in a record from `start` to `end`."""
    gap = round(_GAP * (rows.stop - rows.start))
    return np.arange(max(start + rows.start - gap, start), min(start + rows.stop + gap, end))


def _cut(rows: slice, longest: float) -> list[slice]:
    """Cut a stretch into equal pieces of about a length."""
    pieces = max(1, round((rows.stop - rows.start) / max(longest, 1.0)))
    cuts = np.linspace(rows.start, rows.stop, pieces + 1).round().astype(int)
    return [slice(int(a), int(b)) for a, b in pairwise(cuts)]


def _ridges(gram: Array, rhs: Array, sets: Sequence[NDArray[np.intp]], rows: int) -> Array:
    """Weights of all learners, a column each, the last without any."""
    from scipy.linalg import cho_factor, cho_solve

    weights = np.zeros((len(rhs), len(sets) * len(_RIDGES) + 1))
    for i, own in enumerate(sets):
        part = gram[np.ix_(own, own)]
        for j, ridge in enumerate(_RIDGES):
            try:
                factor = cho_factor(part + ridge * rows * np.eye(len(own)), check_finite=False)
            except np.linalg.LinAlgError:
                continue  # features that rounding makes alike: a stronger ridge will do
            weights[own, i * len(_RIDGES) + j] = cho_solve(factor, rhs[own], check_finite=False)
    return weights
