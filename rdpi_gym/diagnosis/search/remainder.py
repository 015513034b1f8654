"""Whether what is left follows from the command."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rdpi_gym.diagnosis.features.memory import FAMILIES, memory_features
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.measurement import Record
from rdpi_gym.plant.effects.base import DataScale
from rdpi_gym.support.arrays import Array

# Samples that are learned from: an effect of the input is as plain on every fourth sample.
_MOST_ROWS = 24_000
_RIDGES = (1e-9, 1e-7, 1e-5, 1e-3, 1e-1)
# With fewer records to validate on, each is cut into pieces.
_FEWEST_RECORDS, _PIECES = 3, 8
# Shares of the excess over the noise: from the first on it is a function of u, below the second it
# is none. Hysteresis of other kinds lies far above both, a force at zero (test_remainder.py).
FOLLOWS, IN_PART = 0.3, 0.15


@dataclass(frozen=True)
class Remainder:
    """Whether the remainder follows from the command.

    Parameters
    ----------
    predicted_share
        Share of its excess over the noise that a learner with memory predicts on held-out records;
        negative where it predicts worse than nothing does.
    sentence
        In words.
    """

    predicted_share: float
    sentence: str


@dataclass(frozen=True)
class _Rows:
    """Features of a record, their mean taken off, by group; and the residual (µm)."""

    groups: dict[str, Array]
    residual_um: Array

    @property
    def matrix(self) -> Array:
        return np.column_stack(list(self.groups.values()))


def remainder(
    variant: Variant,
    train: Sequence[Record],
    validation: Sequence[Record],
    scale: DataScale,
    noise_um: float,
) -> Remainder:
    """Fit generic learners with memory to the residual and try them on held-out records.

    Parameters
    ----------
    variant
        The final model.
    train, validation
        Records.
    scale
        Size of the data.
    noise_um
        Noise floor (µm rms).

    Notes
    -----
    Ridge regressions on :func:`~rdpi_gym.diagnosis.features.memory.memory_features`, one for each
    set of features and strength, and one that predicts nothing. All learn from the records to fit;
    what predicts a validation record is chosen by the other validation records alone, so that no
    record speaks for its own learner. A learner predicts nothing larger than it has seen. A
    resonance that rings longer than a few periods, or a limit that only validation records reach,
    is a function of the input that they do not find.
    """
    samples = sum(int(np.count_nonzero(r.error_mask)) for r in train)
    step = max(1, -(-samples // _MOST_ROWS))
    weights, largest_um = _learn([_rows(variant, r, scale, step) for r in train])
    before, after, rows = [], [], 0
    pieces = 1 if len(validation) >= _FEWEST_RECORDS else _PIECES
    for record in validation:
        part = _rows(variant, record, scale, step)
        predicted = np.clip(part.matrix @ weights, -largest_um, largest_um)
        left = part.residual_um[:, None] - (predicted - predicted.mean(axis=0))
        before += [float(x @ x) for x in np.array_split(part.residual_um, pieces)]
        after += [np.sum(x**2, axis=0) for x in np.array_split(left, pieces)]
        rows += len(left)
    excess = sum(before) / rows - noise_um**2
    share = (sum(before) - _left_by_choice(np.array(after))) / rows / excess if excess > 0 else 0.0
    return Remainder(share, _sentence(share, excess, noise_um))


def _rows(variant: Variant, record: Record, scale: DataScale, step: int) -> _Rows:
    output_um = simulate_effects([variant], record)[:, 0]
    rows = np.flatnonzero(record.error_mask)[::step]
    groups = memory_features(record, output_um, scale, rows)
    residual_um = (record.y_um - output_um)[rows]
    centred = {name: columns - columns.mean(axis=0) for name, columns in groups.items()}
    return _Rows(centred, residual_um - residual_um.mean())


def _learn(parts: Sequence[_Rows]) -> tuple[Array, float]:
    """Weights of all learners, a column each, the last without any; and the largest residual."""
    from scipy.linalg import cho_factor, cho_solve

    labels = np.concatenate([[n] * x.shape[1] for n, x in parts[0].groups.items()])
    gram, rhs = np.zeros((len(labels), len(labels))), np.zeros(len(labels))
    for part in parts:
        matrix = part.matrix
        gram += matrix.T @ matrix
        rhs += matrix.T @ part.residual_um
    largest_um = max(float(np.max(np.abs(part.residual_um))) for part in parts)
    size = np.sqrt(np.diag(gram))
    size[size == 0.0] = 1.0
    gram, rhs = gram / np.outer(size, size), rhs / size
    weights = np.zeros((len(size), len(FAMILIES) * len(_RIDGES) + 1))
    for i, family in enumerate(FAMILIES):
        own = np.flatnonzero(np.isin(labels, family))
        for j, ridge in enumerate(_RIDGES):
            factor = cho_factor(gram[np.ix_(own, own)] + ridge * np.eye(len(own)))
            weights[own, i * len(_RIDGES) + j] = cho_solve(factor, rhs[own]) / size[own]
    return weights, largest_um


def _left_by_choice(after: Array) -> float:
    """Squared error ``(parts, learners)`` where each part's learner is chosen by the others."""
    chosen = np.argmin(after.sum(axis=0) - after, axis=1)
    return float(np.sum(after[np.arange(len(after)), chosen]))


def _sentence(share: float, excess: float, noise_um: float) -> str:
    if excess <= 0.33 * noise_um**2:
        return "What is left is the noise."
    left = f"What is left ({math.sqrt(excess):.3g} µm rms over the noise)"
    learned = (
        f"a learner with memory predicts {100 * max(share, 0.0):.0f} % of it on held-out records"
    )
    if share >= FOLLOWS:
        return (
            f"{left} follows from the command: {learned}. So the model lacks an effect that the "
            "catalogue does not hold, or has one or the hysteresis in another form."
        )
    if share >= IN_PART:
        return f"{left} follows from the command in part: {learned}. The cause of the rest is not known."
    return (
        f"{left} does not follow from the command, as far as could be tested: {learned}. Its cause "
        "is not known; record what else acts on the stage, such as temperature or load."
    )
