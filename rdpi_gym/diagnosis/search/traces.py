"""What the forms of an effect could take at most, by a linear look, before any of them is refitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import FirstSteps, kept_samples
from rdpi_gym.measurement import Record
from rdpi_gym.plant.effects.base import Effect, in_chain_order
from rdpi_gym.support.arrays import Array

# Of the largest singular value, what is no direction of its own.
_DEPENDENT = 1e-10


def taken_by(
    records: Sequence[Record], begun: FirstSteps, traces: Sequence[Effect], samples: int
) -> float:
    """Return the share of what a model leaves that a sum of small effects takes beside its weights.

    Parameters
    ----------
    records
        That the model was fitted to.
    begun
        The model, and its derivatives by the weights.
    traces
        The effects, as :meth:`~rdpi_gym.plant.effects.base.Effect.traces` returns them.
    samples
        As `begun` was made with.

    Returns
    -------
    float
        0 to 1, of the squares of the records to fit. The weights may turn negative here, and the
        effects of the model stay as they are.
    """
    beside = begun.columns[0].shape[1]
    products = np.zeros((beside + len(traces) + 1,) * 2)
    kept = kept_samples(records, samples)
    for record, index, columns, left in zip(
        records, kept, begun.columns, begun.left_um, strict=True
    ):
        answers = _answers(begun.variant, traces, record)[index]
        rows = np.hstack([columns, answers - answers.mean(axis=0), left[:, None]])
        products += rows.T @ rows
    whole = float(products[-1, -1])
    if whole <= 0.0:
        return 0.0
    return (_least(products, beside) - _least(products, beside + len(traces))) / whole


def _answers(variant: Variant, traces: Sequence[Effect], record: Record) -> Array:
    """Return by how much each of the effects moves the displacement (µm), ``[T, K]``."""
    without = simulate_effects([variant], record)
    columns = []
    for _, alike in groupby(traces, type):
        lanes = [
            replace(variant, effects=in_chain_order([*variant.effects, trace])) for trace in alike
        ]
        columns.append(simulate_effects(lanes, record) - without)
    return np.hstack(columns)


def _least(products: Array, count: int) -> float:
    """Return the least squares that the first columns leave of the last one."""
    spread = np.sqrt(np.maximum(np.diag(products)[:count], 1e-300))
    gram = products[:count, :count] / np.outer(spread, spread)
    rhs = products[:count, -1] / spread
    values, vectors = np.linalg.eigh(gram)
    own = values > _DEPENDENT * values[-1]
    part = vectors[:, own].T @ rhs
    return float(products[-1, -1] - np.sum(part**2 / values[own]))
