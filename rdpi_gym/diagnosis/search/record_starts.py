"""Records whose history nobody recorded: their beginnings are left out where they mislead a fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rdpi_gym.diagnosis.features.samples import BoolArray
from rdpi_gym.diagnosis.notices import Code, Notice, statement
from rdpi_gym.diagnosis.preprocessing.finding import Finding, joined_records
from rdpi_gym.diagnosis.search.candidates import Outcome, Setting, refit
from rdpi_gym.identification.jacobian import simulate_effects
from rdpi_gym.measurement import MIN_SAMPLES, Record
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.base import forms_of
from rdpi_gym.support.arrays import Array

# An opening misleads where a piece of it has this many times the mean square of the rest and of the
# noise, and more than any piece of the rest: a memory may spoil only a part of a long opening.
_WORSE, _NOISE, _STANDS_OUT = 3.0, 9.0, 1.5
_PIECES, _LEAST_PIECE = 8, 8
# Of the squares in the openings, what a memory that is right leaves at most.
_TAKEN = 0.2


def misleading(
    setting: Setting, outcome: Outcome, openings: Mapping[str, BoolArray], noise_um: float
) -> dict[str, BoolArray]:
    """Return the openings that a fit is better spared."""
    bad = missed(setting, outcome, openings, noise_um)
    if not bad:
        return {}
    assert outcome.fit is not None
    start = outcome.fit.variant
    others = tuple(effect for effect in start.effects if effect.name != "initial_memory")
    here = {type(effect) for effect in start.effects}
    bare = outcome if others == start.effects else refit(setting, start.hysteresis, others, None)
    if bare.fit is None:
        return bad
    most = _TAKEN * _opened(setting, bare, bad)
    if _opened(setting, outcome, bad) < most:
        return {}
    for kind in forms_of(CATALOGUE["initial_memory"]):
        if kind in here:  # it misses them as it is
            continue
        remembered = refit(setting, start.hysteresis, others, kind)
        if remembered.fit is None:
            continue
        if _opened(setting, remembered, bad) < most or not missed(
            setting, remembered, bad, noise_um
        ):
            return {}
    return bad


def leaving_out(setting: Setting, openings: Mapping[str, BoolArray]) -> Setting:
    """Return the data with some samples simulated and not scored."""
    return replace(
        setting,
        train=tuple(_spared(r, openings) for r in setting.train),
        validation=tuple(_spared(r, openings) for r in setting.validation),
    )


def unknown_past(openings: Mapping[str, BoolArray]) -> Finding:
    """Say which openings were left out, and why."""
    samples = sum(int(mask.sum()) for mask in openings.values())
    whole = sum(mask.size for mask in openings.values())
    names = list(openings)
    text = statement("unknown past", samples=samples, whole=whole, records=joined_records(names))
    name = names[0] if len(names) == 1 else ""
    return Finding("in motion", name, samples, text, Notice(Code.BEGIN_AFTER_CYCLE))


def outliers_left(name: str, mask: BoolArray) -> Finding:
    """Say how many samples of a record stand out from what a model leaves."""
    number = int(mask.sum())
    text = statement("more outliers", samples=number, record=name)
    return Finding("spikes", name, number, text, Notice(Code.CONTACTS))


def _spared(record: Record, openings: Mapping[str, BoolArray]) -> Record:
    if record.name not in openings:
        return record
    mask = record.error_mask & ~openings[record.name]
    return record if mask.sum() < MIN_SAMPLES else replace(record, error_mask=mask)


def missed(
    setting: Setting, outcome: Outcome, openings: Mapping[str, BoolArray], noise_um: float
) -> dict[str, BoolArray]:
    """Return the openings of which a model misses a piece by far more than the rest and the noise."""
    assert outcome.fit is not None
    found = {}
    for record in (*setting.train, *setting.validation):
        start = openings.get(record.name)
        if start is None or record.name in found:
            continue
        inside, rest = record.error_mask & start, record.error_mask & ~start
        if inside.sum() < 3 or rest.sum() < MIN_SAMPLES:
            continue
        error = record.y_um - simulate_effects([outcome.fit.variant], record)[:, 0]
        error -= error[rest].mean()
        opened, others = error[inside] ** 2, error[rest] ** 2
        size = max(_LEAST_PIECE, opened.size // _PIECES)
        usual = max(_WORSE * float(others.mean()), _STANDS_OUT * _worst(others, size))
        if _worst(opened, size) > max(usual, _NOISE * noise_um**2):
            found[record.name] = start
    return found


def _opened(setting: Setting, outcome: Outcome, openings: Mapping[str, BoolArray]) -> float:
    """Return the sum of a model's squares (µm²) in openings."""
    assert outcome.fit is not None
    total = 0.0
    for record in (*setting.train, *setting.validation):
        start = openings.get(record.name)
        if start is not None:
            error = record.y_um - simulate_effects([outcome.fit.variant], record)[:, 0]
            error -= error[record.error_mask & ~start].mean()
            total += float(np.sum(error[record.error_mask & start] ** 2))
    return total


def _worst(squares: Array, size: int) -> float:
    """Return the largest mean of pieces that have about `size` samples each."""
    pieces = np.array_split(squares, max(squares.size // size, 1))
    return max(float(piece.mean()) for piece in pieces)
