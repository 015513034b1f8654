"""Data that all refits of one search share, and the errors of a refit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rdpi_gym.diagnosis.beam.constants import FIT_SAMPLES, PASSES
from rdpi_gym.diagnosis.results import Candidate, Errors
from rdpi_gym.diagnosis.words import template
from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.joint import JointFit, refit_experiment
from rdpi_gym.identification.residuals import centred_residual, pieces_of, rms_over
from rdpi_gym.measurement import Record
from rdpi_gym.measurement.quantities import template_of
from rdpi_gym.plant.cores.base import Core
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
    """Simulate a refit over all records."""
    by_record: dict[str, float] = {}
    train, _ = _squares(fit.variant, setting.train, by_record)
    validation, pieces = _squares(fit.variant, setting.validation, by_record)
    spread = max(float(np.ptp(r.y_um[r.error_mask])) for r in setting.validation)
    relative = 100.0 * validation / spread if spread > 0.0 else math.inf
    errors = Errors(train, validation, relative, by_record)
    forms = {effect.name: effect.form for effect in fit.variant.effects}
    return Outcome(name, fit, errors, pieces, form=forms.get(name, ""))


def assess_refit(
    setting: Setting, name: str, fit: JointFit, held: frozenset[str] = frozenset()
) -> Outcome:
    """Simulate a refit to the records to fit over all: what goes by the clock goes on into the others."""
    parts = setting.train, setting.validation
    variant, _ = refit_experiment(*parts, fit.variant, PASSES, FIT_SAMPLES, held)
    return assess(setting, name, replace(fit, variant=variant))


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


def _squares(
    variant: Variant[Core], records: Sequence[Record], by_record: dict[str, float]
) -> tuple[float, Array]:
    lefts = [centred_residual(variant, record) for record in records]
    for record, left in zip(records, lefts, strict=True):
        label = record.name
        while label in by_record:  # the held-out part of a record that is also fitted
            label += " (held out)"
        by_record[label] = math.sqrt(float((left**2).mean()))
    errors = list(by_record.values())[-len(lefts) :]
    return rms_over(errors, [left.size for left in lefts]), pieces_of(lefts)
