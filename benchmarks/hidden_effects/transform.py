"""The same measurement in other clothes: what must not change a diagnosis."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from rdpi_gym.measurement import Dataset, load, write_csv
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic

PLAIN = "plain"
VARIANTS = (PLAIN, "order shuffled", "sampling time halved", "other units", "sign reversed")
"""As simulated, and the four changes; the sampling time is changed before the simulation."""

_MILLIVOLTS, _METRES = 1e3, 1e-6


def transform(dataset: Dataset, variant: str, seed: int) -> Dataset:
    """Return the same data set with its records shuffled, in other units, or upside down."""
    if variant in (PLAIN, "sampling time halved"):
        return dataset
    if variant == "order shuffled":
        order = np.random.default_rng(seed).permutation(len(dataset.records))
        return replace(dataset, records=tuple(dataset.records[k] for k in order))
    if variant == "sign reversed":
        return replace(dataset, records=tuple(replace(r, y_um=-r.y_um) for r in dataset.records))
    if variant == "other units":
        return _through_files(dataset)
    raise InputError(f"no variant is named {variant!r}; give {', '.join(VARIANTS)}")


def _through_files(dataset: Dataset) -> Dataset:
    """Write y in metres and u in millivolts to files that say so, and read them."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for record in dataset.records:
            other = replace(record, u_V=_MILLIVOLTS * record.u_V, y_um=_METRES * record.y_um)
            write_csv(other, folder / f"{record.name}.csv")
        write_atomic(folder / "dataset.toml", '[units]\nu = "mV"\ny = "m"\n')
        return replace(load(folder), title=dataset.title)
