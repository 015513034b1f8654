"""What has to be said of a data set before any diagnosis: too poor, or with its sign turned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rdpi_gym.diagnosis.features.half_cycles import half_cycles
from rdpi_gym.identification.plausibility import LITTLE, linear_share
from rdpi_gym.measurement import Dataset, Record

_FEWEST_SAMPLES = 500
# Fewer half cycles of another size or pace are how a record begins and ends.
_FEWEST_OTHERS = 3
TURNED = (
    "the displacement falls where the voltage rises: its sign was turned, the model describes -y"
)


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


def poverty(records: Sequence[Record], train: Sequence[Record]) -> str | None:
    """Say why records cannot decide on any effect, or None.

    Parameters
    ----------
    records
        All records that move.
    train
        Those to fit.
    """
    samples = sum(int(r.error_mask.sum()) for r in train)
    if samples < _FEWEST_SAMPLES:
        return f"The data are too short to decide: {samples} samples to fit, {_FEWEST_SAMPLES} are needed."
    follows = linear_share(train)
    if follows < LITTLE:
        return (
            f"The displacement hardly follows the voltage ({100 * max(follows, 0.0):.1f} % of its "
            "power): check the columns and the sensor."
        )
    cycles = [half_cycles(r.u_V, r.ts_s) for r in records]
    swings = np.concatenate([c.amplitude_V[c.whole] for c in cycles])
    paces = np.concatenate([c.frequency_hz[c.whole] for c in cycles])
    resting = sum(int((~c.whole[1:-1]).sum()) for c in cycles)
    if resting > 2:  # steps and holds are a kind of their own
        return None
    if len(swings) < 3:
        return "The data are too poor to decide: the command turns fewer than three times."
    others = [np.abs(x - np.median(x)) > 0.1 * np.median(x) for x in (swings, paces)]
    if all(int(other.sum()) < _FEWEST_OTHERS for other in others):
        return (
            "The data are too poor to decide: one amplitude at one frequency shows neither memory "
            "at several depths nor rate."
        )
    return None
