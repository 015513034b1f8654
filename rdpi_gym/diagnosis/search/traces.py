"""What the forms of an effect could take at most, by a linear look, before any of them is refitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import FirstSteps, kept_samples
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Effect, in_chain_order
from rdpi_gym.support.arrays import Array

# Of the largest singular value, what is no direction of its own.
_DEPENDENT = 1e-10


def taken_by(
    records: Sequence[Record], begun: FirstSteps, traces: Sequence[Effect], samples: int
) -> float:
    """Return the share of what a model leaves that a sum of small effects takes beside its weights."""
    products = _products(records, begun, traces, samples)
    beside = len(products) - len(traces) - 1
    whole = float(products[-1, -1])
    every = list(range(len(products) - 1))
    return (_least(products, every[:beside]) - _least(products, every)) / max(whole, 1e-300)


def nearest(
    records: Sequence[Record],
    begun: FirstSteps,
    places: Sequence[Effect],
    samples: int,
    count: int,
) -> list[Effect]:
    """Return the starts of an effect that leave least beside the weights.

    Half of them as they are; the others with their response by any factor, as the right place may
    still have a wrong size.
    """
    products = _products(records, begun, places, samples)
    beside = list(range(len(products) - len(places) - 1))
    own, scaled = [], []
    for k in range(len(places)):
        mine = len(beside) + k
        scaled.append(_least(products, [*beside, mine]))
        # the response taken off what is left, in place of what is left
        taken = products.copy()
        taken[:, -1] -= products[:, mine]
        taken[-1, -1] = products[-1, -1] - 2.0 * products[-1, mine] + products[mine, mine]
        own.append(_least(taken, beside))
    first = np.argsort(own, kind="stable")[: count - count // 2].tolist()
    others = [k for k in np.argsort(scaled, kind="stable").tolist() if k not in first]
    return [places[k] for k in (*first, *others[: count // 2])]


def _products(
    records: Sequence[Record], begun: FirstSteps, traces: Sequence[Effect], samples: int
) -> Array:
    """Return the products of the weights' columns, of the responses and of what is left."""
    moving = np.array(begun.variant.hysteresis.gains) != 0.0
    products = np.zeros((int(moving.sum()) + len(traces) + 1,) * 2)
    kept = kept_samples(records, samples)
    for record, index, columns, left in zip(
        records, kept, begun.columns, begun.left_um, strict=True
    ):
        answers = _answers(begun.variant, traces, record)[index]
        rows = np.hstack([columns[:, moving], answers - answers.mean(axis=0), left[:, None]])
        products += rows.T @ rows
    return products


def _answers(variant: Variant[Core], traces: Sequence[Effect], record: Record) -> Array:
    """Return by how much each of the effects moves the displacement (µm), ``[T, K]``."""
    without = simulate_effects([variant], record)
    columns = []
    for _, alike in groupby(traces, type):
        lanes = [
            replace(variant, effects=in_chain_order([*variant.effects, trace])) for trace in alike
        ]
        columns.append(simulate_effects(lanes, record) - without)
    return np.hstack(columns)


def _least(products: Array, columns: Sequence[int]) -> float:
    """Return the least squares that some columns leave of the last one."""
    spread = np.sqrt(np.maximum(np.diag(products)[columns], 1e-300))
    gram = products[np.ix_(columns, columns)] / np.outer(spread, spread)
    rhs = products[columns, -1] / spread
    values, vectors = np.linalg.eigh(gram)
    own = values > _DEPENDENT * values[-1]
    part = vectors[:, own].T @ rhs
    return float(products[-1, -1] - np.sum(part**2 / values[own]))
