"""What has to be said of a data set before any diagnosis: too poor, or with its sign turned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rdpi_gym.identification.plausibility import LITTLE, linear_share
from rdpi_gym.measurement import Dataset, Record

TURNED = "the {output} falls where the {input} rises: its sign was turned, the model describes -y"


def falls(records: Sequence[Record]) -> bool:
    """Whether the displacement falls where the voltage rises."""
    moments = [
        np.mean((r.u_V - r.u_V.mean()) * (r.y_um - np.median(r.y_um)) * r.error_mask)
        for r in records
    ]
    return bool(np.sum(moments) < 0)


def turned(dataset: Dataset) -> Dataset:
    """Return the data set with the sign of every displacement turned."""
    records = tuple(replace(r, y_um=-r.y_um) for r in dataset.records)
    return replace(dataset, records=records)


def unrelated(train: Sequence[Record]) -> str | None:
    """Say that the displacement hardly follows the voltage, or None."""
    follows = linear_share(train)
    if follows >= LITTLE:
        return None
    return (
        f"The {{output}} hardly follows the {{input}} ({100 * max(follows, 0.0):.1f} % of its "
        "power): check the columns and the sensor."
    )
