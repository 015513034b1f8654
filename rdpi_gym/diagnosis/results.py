"""What a diagnosis and a discovery found, and how both stand in their files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array

Verdict = Literal["explained", "no missing effect", "unexplained"]
VERSION = 1


@dataclass(frozen=True)
class Errors:
    """Errors of a model over the records of a data set, one offset free in each.

    Parameters
    ----------
    train_rmse_um, validation_rmse_um
        Over the counted samples of the records of that kind (µm).
    validation_nrmse_percent
        The latter over the peak to peak of the validation records (%).
    by_record_um
        Of every record (µm).
    """

    train_rmse_um: float
    validation_rmse_um: float
    validation_nrmse_percent: float
    by_record_um: Mapping[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Return the object of the files."""
        return {
            "train_rmse": _number(self.train_rmse_um),
            "validation_rmse": _number(self.validation_rmse_um),
            "validation_nrmse_percent": _number(self.validation_nrmse_percent),
            "by_record": dict(self.by_record_um),
        }


@dataclass(frozen=True)
class Finding:
    """One effect, refitted together with the base model and what was added before.

    Parameters
    ----------
    effect
        Its name.
    errors
        With the effect added.
    parameters, standard_errors
        Of the effect; a standard error is None where the data do not fix the parameter.
    confidence
        0 to 1: how sure it is that this effect, or one that is indistinguishable from it, is there.
    share
        Of the excess over the noise floor on validation records, how much disappears.
    indistinguishable
        Effects whose validation error the data cannot separate from this one's.
    evidence
        A sentence that a person can check on a figure.
    remarks
        A bound reached, a search that did not converge, a record made worse.
    """

    effect: str
    errors: Errors
    parameters: Mapping[str, float]
    standard_errors: Mapping[str, float | None]
    confidence: float
    share: float
    indistinguishable: tuple[str, ...]
    evidence: str
    remarks: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the object of the files."""
        return {
            "effect": self.effect,
            **self.errors.to_dict(),
            "parameters": dict(self.parameters),
            "standard_errors": dict(self.standard_errors),
            "confidence": self.confidence,
            "share_of_excess": _number(self.share),
            "indistinguishable": list(self.indistinguishable),
            "evidence": self.evidence,
            "remarks": list(self.remarks),
        }


@dataclass(frozen=True)
class View:
    """One record as measured and as models see it, for the figures.

    Parameters
    ----------
    name, role
        The record and what it was used for.
    t_s, u_V, y_um
        The measurement, ``(T,)``.
    models_um
        Displacement of each model, its free offset included (µm), by label, in order.
    counted
        Samples that count in the error.
    """

    name: str
    role: str
    t_s: Array
    u_V: Array
    y_um: Array
    models_um: Mapping[str, Array]
    counted: Array


@dataclass(frozen=True)
class Diagnosis:
    """One round: every candidate, best first.

    Parameters
    ----------
    noise_floor_um, noise_origin
        Noise (µm rms) and the sentence that says where the figure comes from.
    base
        Errors of the base model, refitted on a fine comb of thresholds.
    given
        Errors of the model as it was given.
    candidates
        Best first.
    chosen
        What a discovery would add in this round: nothing, one, or a pair.
    verdict
        As in the files.
    unexplained_rmse_um
        What is left over the noise floor (µm): of the best candidate that is earned, or the base.
    remainder
        A sentence on whether what is left follows from the input.
    next_experiment
        The experiment that would tell the winner from its rivals; None where none is needed.
    indistinguishable
        Classes of effects, not in the model, that these records cannot tell apart.
    checks
        Tests without a model and of the data: a sentence each.
    views
        Records for the figures.
    seconds
        Time taken.
    """

    noise_floor_um: float
    noise_origin: str
    base: Errors
    given: Errors | None
    candidates: tuple[Finding, ...]
    verdict: Verdict
    unexplained_rmse_um: float
    remainder: str
    next_experiment: str | None
    checks: tuple[str, ...]
    views: tuple[View, ...]
    seconds: float
    indistinguishable: tuple[tuple[str, ...], ...] = ()
    chosen: tuple[Finding, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the content of ``diagnosis.json``."""
        return {
            "format": "rdpi-diagnosis",
            "version": VERSION,
            **_common(self),
            "candidates": [finding.to_dict() for finding in self.candidates],
            "chosen": [finding.effect for finding in self.chosen],
        }


@dataclass(frozen=True)
class Discovery:
    """The loop from a bare model to one that explains, or says that nothing does.

    Parameters
    ----------
    model
        The final plant.
    steps
        What was added, in order.
    rounds
        Every candidate of each round, best first: the ranking that each step stood on.
    removed
        Effects that backward elimination took out again.
    noise_floor_um, noise_origin, base, given, verdict, unexplained_rmse_um, remainder, next_experiment, indistinguishable, checks, views, seconds
        As :class:`Diagnosis`.
    """

    model: PlantModel
    steps: tuple[Finding, ...]
    rounds: tuple[tuple[Finding, ...], ...]
    removed: tuple[str, ...]
    noise_floor_um: float
    noise_origin: str
    base: Errors
    given: Errors | None
    verdict: Verdict
    unexplained_rmse_um: float
    remainder: str
    next_experiment: str | None
    checks: tuple[str, ...]
    views: tuple[View, ...]
    seconds: float
    notes: tuple[str, ...] = ()
    indistinguishable: tuple[tuple[str, ...], ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the content of ``discovery.json``."""
        return {
            "format": "rdpi-discovery",
            "version": VERSION,
            **_common(self),
            "steps": [finding.to_dict() for finding in self.steps],
            "removed": list(self.removed),
            "notes": list(self.notes),
        }


def _number(value: float) -> float | None:
    """Return a number that JSON has: None for a candidate without a refit."""
    return value if math.isfinite(value) else None


def _common(result: Diagnosis | Discovery) -> dict[str, Any]:
    return {
        "units": {"error": "um"},
        "noise_floor": result.noise_floor_um,
        "noise_origin": result.noise_origin,
        "given": None if result.given is None else result.given.to_dict(),
        "base": result.base.to_dict(),
        "verdict": result.verdict,
        "unexplained_rmse": result.unexplained_rmse_um,
        "remainder": result.remainder,
        "next_experiment": result.next_experiment,
        "indistinguishable": [list(group) for group in result.indistinguishable],
        "checks": list(result.checks),
        "seconds": result.seconds,
    }
