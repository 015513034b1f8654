"""The result: probability and grade of each name, kind of core, clock faults, parameters."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rdpi_gym.diagnosis.beam.constants import FOUND, LEVEL, LIKELY
from rdpi_gym.diagnosis.beam.decision import chances, classes
from rdpi_gym.diagnosis.beam.evidence import Evidence, Offer
from rdpi_gym.diagnosis.beam.models import Model, Visited, refitted
from rdpi_gym.diagnosis.beam.search import Beam, Scores, searched
from rdpi_gym.diagnosis.preprocessing import Finding
from rdpi_gym.measurement import Dataset
from rdpi_gym.plant.effects.unknown import Unknown
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.progress import Progress

Grade = Literal["found", "likely", "stand-in", ""]


@dataclass(frozen=True)
class Name:
    """One effect or clock fault.

    Parameters
    ----------
    name, form
        Of the best set that has it.
    probability
        Weight of the sets that have it.
    grade
        ``found``, ``likely``, ``stand-in``, or empty for a name that is less likely than not.
    instead
        Names that take its weight: the class that the records do not tell apart.
    """

    name: str
    form: str
    probability: float
    grade: Grade
    instead: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class SetScore:
    """One visited set."""

    key: tuple[str, ...]  # Kind of the core, effects with forms, clock faults
    weight: float
    scores: Array  # Of each block (nats), ``(B,)``
    rmse_um: float


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Result of a search by the one law.

    Parameters
    ----------
    sets
        Every visited set, largest weight first.
    names
        Effects and clock faults that any of them has, most probable first.
    core
        Kind of the core of the best set, and its probability.
    something_else
        Weight of the sets with a free block: of an effect that no name stands for.
    model
        The best set with names alone, as fitted.
    parameters, standard_errors
        Of its effects, as ``effect.parameter``.
    floor_um
        Noise floor (µm rms).
    base_um, rmse_um
        Cross-fitted error without effects, and of the model (µm rms).
    findings
        What inspection found in the records.
    seconds
        Processor time.
    """

    sets: tuple[SetScore, ...]
    names: tuple[Name, ...]
    core: tuple[str, float]
    something_else: float
    model: Model
    parameters: Mapping[str, float]
    standard_errors: Mapping[str, float | None]
    floor_um: float
    base_um: float
    rmse_um: float
    findings: tuple[Finding, ...]
    seconds: float

    def graded(self, *grades: Grade) -> tuple[str, ...]:
        """Return the names of some grades."""
        return tuple(each.name for each in self.names if each.grade in grades)


def diagnose(
    dataset: Dataset,
    *,
    offer: Offer | None = None,
    jobs: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
) -> Diagnosis:
    """Look for what a model of the records misses, by one score and one decision.

    Parameters
    ----------
    dataset
        The measurement.
    offer
        Effects and kinds of core that moves may bring; by default all.
    jobs
        Processes in which sets of the beam are expanded.
    seed
        Of the bootstrap.
    progress
        Told of the rounds.

    Raises
    ------
    InputError
        No record to fit or to judge by in which the input moves.

    Examples
    --------
    >>> import numpy as np
    >>> from rdpi_gym.measurement import Record
    >>> from rdpi_gym.plant import Plant, named_plant
    >>> t = np.arange(2000) * 1e-3
    >>> u = 10 * np.sin(9 * t) * np.exp(-t / 2)
    >>> y = Plant(named_plant("P5"), 1e-3).simulate(u)
    >>> y += 0.01 * np.random.default_rng(0).normal(size=t.size)
    >>> diagnose(Dataset("nothing hidden", (Record("run", t, u, y, ts_s=1e-3),))).graded("found")
    ()
    """
    began = time.process_time()
    beam, scores, best = searched(Evidence.of(dataset, offer), jobs, seed, progress)
    return diagnosis_of(beam.evidence, beam, scores, best, began)


def diagnosis_of(
    evidence: Evidence, beam: Beam, scores: Scores, best: Visited, began: float
) -> Diagnosis:
    """Grade the sets of a beam that began at a processor time (s)."""
    mean = scores.weights.mean(axis=0)
    order = np.argsort(-mean)
    core = best.model.core.name
    held = [one.model.core.name == core for one in scores.sets]
    base = next(one for one in scores.sets if one.parent is None)
    unknown = [Unknown.name in one.model.names for one in scores.sets]
    names = names_of(beam, scores, best)
    if evidence.reads_fewer is not None:
        best = refitted(evidence.in_full, best.model, best.parent) or best
    return Diagnosis(
        tuple(
            SetScore(scores.sets[k].key, float(mean[k]), scores.table[k], scores.sets[k].rmse_um)
            for k in order
        ),
        names,
        (core, float(mean[held].sum())),
        float(mean[unknown].sum()),
        best.model,
        {f"{e.name}.{key}": v for e in best.model.effects for key, v in e.values.items()},
        dict(best.fit.standard_errors),
        scores.noise_um,
        base.rmse_um,
        best.rmse_um,
        evidence.findings,
        time.process_time() - began,
    )


def names_of(beam: Beam, scores: Scores, best: Visited) -> tuple[Name, ...]:
    """Return the names that any set has, with probability and grade, most probable first."""
    mean = scores.weights.mean(axis=0)
    members = [one.model.names for one in scores.sets]
    instead = classes(scores.weights, members) if any(members) else {}
    found = []
    for name in instead:
        if name == Unknown.name:
            continue
        having = [k for k, each in enumerate(members) if name in each]
        probability = min(float(mean[having].sum()), 1.0)
        top = scores.sets[max(having, key=lambda k: mean[k])]
        form = next((e.form for e in top.model.effects if e.name == name), "")
        grade: Grade = ""
        if name in best.model.names:
            if _loses(scores, best, name) or takes_less(scores, best, name):
                grade = "stand-in"
            elif probability >= LIKELY:
                grade = "found" if probability >= FOUND else "likely"
        found.append(Name(name, form, probability, grade, instead[name]))
    return tuple(sorted(found, key=lambda each: -each.probability))


def _loses(scores: Scores, best: Visited, name: str) -> bool:
    """Whether a free block in the place of a name is better by the one decision."""
    rivals = [
        one
        for one in scores.sets
        if one.model.names == (best.model.names - {name}) | {Unknown.name}
        and one.parent == best.key
    ]
    if not rivals:
        return False
    here = scores.of(best)
    gains = np.array([here - scores.of(one) for one in rivals])
    return bool(min(chances(gains, np.zeros(len(rivals)), scores.draws)) < LEVEL)


def takes_less(scores: Scores, best: Visited, name: str) -> bool:
    """Whether a name takes less than its set leaves: whatever leaves that may be its cause as well."""
    if scores.is_at_floor(best):
        return False
    fewer = [one for one in scores.sets if one.model.names == best.model.names - {name}]
    left = float(scores.of(best).mean())
    gone = min((float(scores.of(one).mean()) for one in fewer), default=math.inf)
    return gone - left < left
