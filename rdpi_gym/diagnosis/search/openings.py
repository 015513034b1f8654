"""Records whose history nobody recorded: their beginnings are left out where they mislead a fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rdpi_gym.diagnosis.hygiene.finding import BoolArray, Finding, joined_records
from rdpi_gym.diagnosis.search.candidates import Outcome, Setting, refit
from rdpi_gym.identification.jacobian import simulate_effects
from rdpi_gym.measurement import MIN_SAMPLES, Record
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.base import forms_of

# An opening misleads where its mean square is this many times that of the rest and of the noise.
_WORSE, _NOISE = 3.0, 9.0


def misleading(
    setting: Setting, outcome: Outcome, openings: Mapping[str, BoolArray], noise_um: float
) -> dict[str, BoolArray]:
    """Return the openings that a fit is better spared.

    Parameters
    ----------
    setting
        The data.
    outcome
        A refit of the base model.
    openings
        Samples at the beginning of records, by record.
    noise_um
        Noise floor (µm rms).

    Returns
    -------
    dict of str, bool[N]
        Of the records whose beginning the model misses, where no initial memory that all records
        share removes that.
    """
    bad = missed(setting, outcome, openings, noise_um)
    if not bad:
        return {}
    assert outcome.fit is not None
    start = outcome.fit.variant
    if not any(effect.name == "initial_memory" for effect in start.effects):
        for kind in forms_of(CATALOGUE["initial_memory"]):
            remembered = refit(setting, start.hysteresis, start.effects, kind)
            if remembered.fit is not None and not missed(setting, remembered, bad, noise_um):
                return {}
    return bad


def without_openings(setting: Setting, openings: Mapping[str, BoolArray]) -> Setting:
    """Return the data with the openings simulated and not scored.

    Parameters
    ----------
    setting
        The data.
    openings
        As :func:`misleading` returns them.
    """
    return replace(
        setting,
        train=tuple(_spared(r, openings) for r in setting.train),
        validation=tuple(_spared(r, openings) for r in setting.validation),
    )


def unknown_past(openings: Mapping[str, BoolArray]) -> Finding:
    """Say which openings were left out, and why.

    Parameters
    ----------
    openings
        As :func:`misleading` returns them.

    Examples
    --------
    >>> unknown_past({"run": np.arange(9) < 4}).sentence
    '4 samples at the beginning of run left out: they hang on a history that nobody recorded.'
    """
    samples = sum(int(mask.sum()) for mask in openings.values())
    sentence = (
        f"{samples} samples at the beginning of {joined_records(list(openings))} left out: they "
        "hang on a history that nobody recorded."
    )
    step = "Begin each record at rest, after one full cycle."
    name = next(iter(openings)) if len(openings) == 1 else ""
    return Finding("in motion", name, samples, sentence, step)


def outliers_left(name: str, mask: BoolArray) -> Finding:
    """Say how many samples of a record stand out from what a model leaves.

    Parameters
    ----------
    name, mask
        The record, and where they are.

    Examples
    --------
    >>> outliers_left("run", np.arange(9) == 4).sentence
    '1 more of run stand alone beside what the model leaves: outliers, left out.'
    """
    number = int(mask.sum())
    sentence = (
        f"{number} more of {name} stand alone beside what the model leaves: outliers, left out."
    )
    return Finding("spikes", name, number, sentence, "Look for loose contacts and switching.")


def _spared(record: Record, openings: Mapping[str, BoolArray]) -> Record:
    if record.name not in openings:
        return record
    mask = record.error_mask & ~openings[record.name]
    return record if mask.sum() < MIN_SAMPLES else replace(record, error_mask=mask)


def missed(
    setting: Setting, outcome: Outcome, openings: Mapping[str, BoolArray], noise_um: float
) -> dict[str, BoolArray]:
    """Return the openings that a model misses by far more than the rest and the noise.

    Parameters
    ----------
    setting, outcome, openings, noise_um
        As :func:`misleading`.
    """
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
        opened = float(np.mean(error[inside] ** 2))
        if opened > max(_WORSE * float(np.mean(error[rest] ** 2)), _NOISE * noise_um**2):
            found[record.name] = start
    return found
