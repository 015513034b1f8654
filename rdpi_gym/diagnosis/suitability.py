"""Limits of records: what they cannot tell in principle, however good the model is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rdpi_gym.diagnosis.features.cycles import half_cycles, vary
from rdpi_gym.diagnosis.features.noise import repeat_noise
from rdpi_gym.diagnosis.features.rests import find_rests
from rdpi_gym.diagnosis.notices import Code, Notice
from rdpi_gym.diagnosis.words import template
from rdpi_gym.identification.plausibility import LITTLE, linear_share
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import RDPI

FEW_SAMPLES = 500
"""Fewer samples to fit than this, and small effects are lost in the freedom of the fit."""
_FEWEST_OTHERS = 3  # fewer are how a record begins and ends
_SMALL = 0.1  # of the widest swing
_LONG_S, _LONG = 0.05, 20.0  # a rest: seconds, or moves of a record


def limits(dataset: Dataset) -> tuple[Notice, ...]:
    """Return what these records cannot tell; nothing where they can tell everything."""
    records = [r for r in dataset.records if not r.is_quiet and r.role != "test"]
    if not records:
        return (Notice(Code.STILL),)
    found = []
    train = dataset.train
    samples = sum(int(r.error_mask.sum()) for r in train)
    if samples < FEW_SAMPLES:
        found.append(Notice(Code.FEW_SAMPLES, numbers=(samples, FEW_SAMPLES)))
    if train and (follows := linear_share(train)) < LITTLE:
        found.append(Notice(Code.UNRELATED, numbers=(max(follows, 0.0),)))
    if len(records) == 1:
        found.append(Notice(Code.ONE_RECORD))
    return (*found, *_of_commands(records))


def _of_commands(records: list[Record]) -> list[Notice]:
    cycles = [half_cycles(r.u_V, r.ts_s) for r in records]
    swings = np.concatenate([c.amplitude_V[c.whole] for c in cycles])
    paces = np.concatenate([c.frequency_hz[c.whole] for c in cycles])
    span_V = max(float(np.ptp(r.u_V)) for r in records)
    rests = any(
        rest.move_V and rest.duration_s > max(_LONG_S, _LONG * rest.record.ts_s)
        for r in records
        for rest in find_rests(r, span_V)
    )
    found = []
    if swings.size < _FEWEST_OTHERS and not rests:
        found.append(Notice(Code.FEW_HALF_CYCLES, numbers=(swings.size,)))
    elif swings.size:
        if not vary(paces):
            found.append(Notice(Code.ONE_FREQUENCY, numbers=(float(np.median(paces)),)))
        if not vary(swings):
            found.append(Notice(Code.ONE_AMPLITUDE))
    if not rests:
        found.append(Notice(Code.NO_REST))
    if min(float(np.ptp(r.u_V)) for r in records) > _SMALL * span_V:
        found.append(Notice(Code.NO_SMALL_SIGNALS))
    if all(repeat_noise(r) is None for r in records):
        found.append(Notice(Code.NO_REPETITION))
    return found


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
    return template("unrelated", percent=100 * max(follows, 0.0))


def one_size(records: Sequence[Record]) -> bool:
    """Whether loops of one size are all that records hold: they do not tell weights apart."""
    cycles = [half_cycles(r.u_V, r.ts_s) for r in records]
    sizes = np.concatenate([c.amplitude_V[c.whole] for c in cycles])
    return bool(sizes.size) and not vary(sizes)


def comb(records: Sequence[Record]) -> RDPI:
    """Return the RDPI model on the fine fixed comb of a search, to be fitted: convex in its weights."""
    return RDPI.comb(data_scale(records))
