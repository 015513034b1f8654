"""Data that all refits of one search share, and the errors of a refit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rdpi_gym.diagnosis.beam.constants import PASSES
from rdpi_gym.diagnosis.beam.score import within
from rdpi_gym.diagnosis.results import Candidate, Errors
from rdpi_gym.diagnosis.words import template
from rdpi_gym.identification.joint import JointFit, refit_experiment
from rdpi_gym.identification.residuals import centred_residual, pieces_of, rms_over
from rdpi_gym.measurement import Record
from rdpi_gym.measurement.quantities import template_of
from rdpi_gym.plant.effects.base import DataScale, Effect
from rdpi_gym.support.arrays import Array


@dataclass(frozen=True)
class Outcome:
    """A refit and its squared errors."""

    effect: str  # name of the candidate; empty for a refit without one
    fit: JointFit
    errors: Errors  # of the refit
    # float64[R, PIECES]: mean squared error (µm²) of the pieces of each validation record, offset
    # free
    pieces: Array
    form: str = ""  # of the candidate; empty for its simplest

    @property
    def mean_square(self) -> float:
        """Mean squared validation error (µm²)."""
        return self.errors.validation_rmse_um**2

    @property
    def fitted(self) -> Effect:
        """The candidate, as it was fitted."""
        return next(e for e in self.fit.variant.effects if e.name == self.effect)


@dataclass(frozen=True)
class Setting:
    """Data and settings that all refits of one data set share."""

    # Records to fit and to judge by
    train: tuple[Record, ...]
    validation: tuple[Record, ...]
    scale: DataScale  # size of the data

    def exchanged(self) -> Setting:
        """Return the same data, fitted where they were judged and judged where they were fitted."""
        return replace(self, train=self.validation, validation=self.train)


def assess(setting: Setting, name: str, fit: JointFit) -> Outcome:
    """Simulate a model as it is over all records."""
    every = (*setting.train, *setting.validation)
    return _outcome(setting, name, fit, [centred_residual(fit.variant, r) for r in every])


def assess_refit(
    setting: Setting, name: str, fit: JointFit, held: frozenset[str] = frozenset()
) -> Outcome:
    """Simulate a refit to the records to fit over all.

    What goes by the clock is refitted to all records, and each stretch of those to judge by is predicted
    from the others.
    """
    if not any(effect.clocked for effect in fit.variant.effects):
        return assess(setting, name, fit)
    parts, count = (setting.train, setting.validation), len(setting.train)
    variant, at = refit_experiment(*parts, fit.variant, PASSES, held=held)
    pairs = [(rows[:, :-1][:, at.moves], rows[:, -1]) for rows in at.rows]
    judged = within(pairs)[count:]
    lefts = [*(left for _, left in pairs[:count]), *judged]
    return _outcome(setting, name, replace(fit, variant=variant), lefts)


def _outcome(setting: Setting, name: str, fit: JointFit, lefts: Sequence[Array]) -> Outcome:
    """Return a model with its errors, by what it leaves of each record (µm)."""
    by_record: dict[str, float] = {}
    count = len(setting.train)
    train = _error(lefts[:count], setting.train, by_record)
    validation = _error(lefts[count:], setting.validation, by_record)
    spread = max(float(np.ptp(r.y_um[r.error_mask])) for r in setting.validation)
    relative = 100.0 * validation / spread if spread > 0.0 else math.inf
    errors = Errors(train, validation, relative, by_record)
    forms = {effect.name: effect.form for effect in fit.variant.effects}
    return Outcome(name, fit, errors, pieces_of(lefts[count:]), form=forms.get(name, ""))


def of_effect(candidate: Candidate, fit: JointFit, name: str) -> Candidate:
    """Return a candidate as that of an effect in a refit: its parameters and their errors."""
    effect = {e.name: e for e in fit.variant.effects}[name]
    own = f"{name}."
    found = fit.standard_errors.items()
    errors = {key.removeprefix(own): e for key, e in found if key.startswith(own)}
    return replace(
        candidate,
        effect=name,
        form=effect.form,
        parameters=effect.values,
        standard_errors=errors,
    )


def evidence_of(before: Errors, after: Errors, signature: str) -> str:
    """Name the record on which a candidate gains most, and what it leaves there, in a sentence."""
    falls = {
        name: before.by_record_um[name] - after.by_record_um[name] for name in after.by_record_um
    }
    most = max(falls, key=lambda name: falls[name])
    return template("evidence", record=most, signature=template_of(signature))


def _error(lefts: Sequence[Array], records: Sequence[Record], by_record: dict[str, float]) -> float:
    """Return the error over records (µm rms), and write down that of each."""
    for record, left in zip(records, lefts, strict=True):
        label = record.name
        while label in by_record:  # the held-out part of a record that is also fitted
            label += " (held out)"
        by_record[label] = math.sqrt(float((left**2).mean()))
    errors = list(by_record.values())[-len(lefts) :]
    return rms_over(errors, [left.size for left in lefts])
