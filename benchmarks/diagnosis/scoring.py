"""Scores of an answer: logarithmic and quadratic loss, wrong names, the share of the error explained."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.diagnosis.answers import Answer, checked_prediction
from benchmarks.effect_discovery.cases import Case
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.arrays import Array

LEAST = 1e-3
"""Probability below which none counts, so that one sure error is no infinite loss."""
NAMED = 0.5
"""Probability from which on an effect counts as named."""
OTHER = "something else"
_WITHHELD = 0.25  # of the longest record, where none is for validation
_LEFT_OUT = 0.02  # of the samples, those of the largest errors: spikes and dropouts
_GAP = 1.2  # mean squares of the noise that a base model leaves where there is something to explain


@dataclass(frozen=True)
class Outcomes:
    """True outcomes of a plant, as far as its records tell.

    Parameters
    ----------
    there
        Hidden effects, each with those that the records do not tell from it: one of them suffices.
    absent
        Effects that are not there; those that a case excuses are in neither.
    other
        Whether something outside the catalogue is there.
    """

    there: tuple[frozenset[str], ...]
    absent: frozenset[str]
    other: bool


def outcomes_of(case: Case, truth: Mapping[str, Any]) -> Outcomes:
    """Return what is true of a case."""
    is_outside = case.study == "outside" or bool(truth.get("outside"))
    hidden = () if is_outside else case.subject
    alike = truth.get("alike", {})
    there = tuple(frozenset((name, *alike.get(name, ()))) for name in hidden)
    absent = frozenset(CATALOGUE).difference(truth.get("excused", ()), *there)
    return Outcomes(there, absent, is_outside)


def losses(answer: Answer, true: Outcomes) -> dict[str, Any]:
    """Return the losses of the probabilities: sums over effects and something else."""

    def p(name: str) -> float:
        return float(answer.effects.get(name, 0.0))

    of_true = [max(map(p, names)) for names in true.there]
    of_false = [p(name) for name in sorted(true.absent)]
    (of_true if true.other else of_false).append(float(answer.other))
    right = np.concatenate([of_true, 1.0 - np.array(of_false)])
    return {
        "log_loss": float(-np.log(np.clip(right, LEAST, 1.0 - LEAST)).sum()),
        "brier": float(np.sum((1.0 - right) ** 2)),
        "false_names": sum(p(name) >= NAMED for name in true.absent),
        "hidden": len(true.there),
        "found": sum(max(map(p, names)) >= NAMED for names in true.there),
    }


def withheld(dataset: Dataset) -> tuple[Dataset, tuple[Record, ...]]:
    """Split a data set into what a diagnoser is given and the records that it predicts.

    Those are the records for validation; where there is none, the last quarter of the longest one.
    """
    asked = tuple(r for r in dataset.records if r.role == "validation")
    if asked:
        given = tuple(r for r in dataset.records if r.role != "validation")
        return _with(dataset, given), asked
    longest = max(dataset.records, key=lambda r: r.t_s.size)
    end = longest.t_s.size - round(_WITHHELD * longest.t_s.size)
    given = tuple(r.cut(slice(0, end)) if r is longest else r for r in dataset.records)
    return _with(dataset, given), (longest.cut(slice(end, longest.t_s.size)),)


def _with(dataset: Dataset, records: Sequence[Record]) -> Dataset:
    return Dataset(dataset.title, tuple(records), quantities=dataset.quantities)


def blank(record: Record) -> Record:
    """Return a record without its displacement."""
    return replace(record, y_um=np.zeros_like(record.y_um))


def mean_square(answer: Answer, asked: Sequence[Record]) -> float:
    """Mean square (µm²) of what a prediction leaves, an offset free in each record."""
    squares: list[Array] = []
    for record in asked:
        error = (record.y_um - checked_prediction(answer, blank(record)))[record.error_mask]
        squares.append((error - np.median(error)) ** 2)
    every = np.sort(np.concatenate(squares))
    return float(np.mean(every[: max(1, round((1.0 - _LEFT_OUT) * every.size))]))


def explained(base: float, left: float, noise_um: float) -> float | None:
    """Share of the gap between base model and noise that is explained; None where there is none."""
    gap = base - noise_um**2
    if not base > _GAP * noise_um**2:
        return None
    return float(np.clip((base - left) / gap, 0.0, 1.0))


UNINFORMED = (len(CATALOGUE) + 1) * math.log(2.0)
"""Logarithmic loss of one half for everything, which a diagnoser that fails is given."""
