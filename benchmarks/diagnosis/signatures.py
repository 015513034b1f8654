"""Signatures: what each effect of the catalogue changes in the displacement of a fitted model."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np

from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import first_steps, kept_samples
from rdpi_gym.measurement import Record
from rdpi_gym.plant.effects.base import DataScale, Effect, in_chain_order
from rdpi_gym.support.arrays import Array

SAMPLES = 4000
"""Samples of the records that enter a regression."""
_MODELS = 40  # resampled regressions
_RIDGE = 1e-3  # of the rows

Library = Sequence[tuple[str, Effect]]
"""Effects at the values that a search begins from, with their names."""


def library_of(catalogue: Mapping[str, type[Effect]], scale: DataScale) -> Library:
    """Return every effect at each of the starts that a search refits it from."""
    return [
        (name, effect)
        for name, kind in catalogue.items()
        for effect in (*kind.starts(scale), *kind.traces(scale))
    ]


def changes(variant: Variant[Any], library: Library, record: Record) -> Array:
    """Return what each effect changes in the displacement (µm) over a record, ``[T, effects]``."""
    without, own = simulate_effects([variant], record), []
    for _, alike in groupby((effect for _, effect in library), type):
        lanes = [
            Variant(variant.hysteresis, in_chain_order([*variant.effects, effect]))
            for effect in alike
        ]
        own.append(simulate_effects(lanes, record) - without)
    return np.hstack(own)


def signature_rows(
    variant: Variant[Any], library: Library, records: Sequence[Record]
) -> tuple[Array, Array]:
    """Return signatures and residual (µm), both beside what the weights of the model can take up."""
    begun = first_steps(records, variant.hysteresis, variant.effects, 0, samples=SAMPLES)
    columns = []
    for record, kept in zip(records, kept_samples(records, SAMPLES), strict=True):
        found = changes(variant, library, record)[kept]
        columns.append(found - found.mean(axis=0))
    basis, _ = np.linalg.qr(np.concatenate(begun.columns))
    rows, left = np.concatenate(columns), np.concatenate(begun.left_um)
    return rows - basis @ (basis.T @ rows), left - basis @ (basis.T @ left)


def nearest_places(library: Library, rows: Array, left: Array, least_um: float) -> list[int]:
    """Return of each effect the place whose signature is most like the residual; those that move."""
    size = np.sqrt(np.mean(rows**2, axis=0))
    likeness = np.abs(left @ rows) / np.maximum(size, least_um)
    names = [name for name, _ in library]
    nearest = [
        max((k for k, other in enumerate(names) if other == name), key=lambda k: likeness[k])
        for name in dict.fromkeys(names)
    ]
    return [k for k in nearest if size[k] > least_um]


def sparse_models(x: Array, y: Array, least: float, seed: int) -> Array:
    """Return the coefficients of sparse regressions on resampled rows, ``[models, columns]``."""
    from pysindy import STLSQ, EnsembleOptimizer

    np.random.seed(seed)  # noqa: NPY002  PySINDy draws from it
    sparse = STLSQ(threshold=least, alpha=_RIDGE * len(x))
    ensemble = EnsembleOptimizer(sparse, bagging=True, n_models=_MODELS)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # where no column is left
        ensemble.fit(x, y[:, None])
    return np.array([np.ravel(model) for model in ensemble.coef_list])


def best_sparse_models(
    x: Array, y: Array, held_x: Array, held_y: Array, noise_um: float, seed: int
) -> Array:
    """Return the sparse models whose least coefficient serves held-out rows best; zeros where none does."""
    best: tuple[float, Array] = (float(np.mean(held_y**2)), np.zeros((1, x.shape[1])))
    for least in LEAST:
        models = sparse_models(x, y, least * noise_um, seed)
        left = float(np.mean((held_y - held_x @ np.median(models, axis=0)) ** 2))
        if left < best[0]:
            best = (left, models)
    return best[1]


LEAST = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
"""Least coefficients that are tried, in noise floors of what a column changes."""
