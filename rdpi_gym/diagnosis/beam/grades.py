"""Probability and grade of each name."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rdpi_gym.diagnosis.beam.constants import FOUND, LEVEL, LIKELY
from rdpi_gym.diagnosis.beam.decision import chances, classes
from rdpi_gym.diagnosis.beam.models import Visited
from rdpi_gym.diagnosis.beam.search import Scores
from rdpi_gym.diagnosis.words import Grade
from rdpi_gym.plant.effects.unknown import Unknown


@dataclass(frozen=True)
class Name:
    """One effect or clock fault.

    Parameters
    ----------
    name, form
        Of the best set that has it.
    probability
        Weight of the sets that have it.
    instead
        Names that take its weight, and of a name of the best set are not beside it there: the class
        that the records do not tell apart.
    shared
        Weight of the sets that have it or one of these.
    grade
        ``found``, ``likely``, ``stand-in``, or empty where the class is less likely than not.
    """

    name: str
    form: str
    probability: float
    instead: tuple[str, ...]
    shared: float
    grade: Grade


def names_of(scores: Scores, best: Visited) -> tuple[Name, ...]:
    """Return the names that any set has, with probability and grade, most probable first."""
    mean = scores.probabilities.mean(axis=0)
    members = [one.model.names for one in scores.sets]
    instead = classes(scores.probabilities, members) if any(members) else {}
    found = []
    for name, others in instead.items():
        if name == Unknown.name:
            continue
        having = [k for k, each in enumerate(members) if name in each]
        probability = min(float(mean[having].sum()), 1.0)
        beside = best.model.names if name in best.model.names else frozenset()
        rivals = tuple(other for other in others if other not in {Unknown.name, *beside})
        either = [k for k, each in enumerate(members) if not each.isdisjoint((name, *rivals))]
        shared = min(float(mean[either].sum()), 1.0)
        top = scores.sets[max(having, key=lambda k: mean[k])]
        form = next((e.form for e in top.model.effects if e.name == name), "")
        grade: Grade = ""
        if name in best.model.names:
            if _loses(scores, best, name) or takes_less(scores, best, name):
                grade = "stand-in"
            elif shared >= LIKELY:
                grade = "found" if probability >= FOUND else "likely"
        found.append(Name(name, form, probability, rivals, shared, grade))
    return tuple(sorted(found, key=lambda each: -each.probability))


def _loses(scores: Scores, best: Visited, name: str) -> bool:
    """Whether a free block in the place of a name is better by the one decision, whatever its form."""
    rivals = [
        one
        for one in scores.sets
        if one.model.names == (best.model.names - {name}) | {Unknown.name}
        and one.parent == best.key
    ]
    if not rivals:
        return False
    forms = [one for one in scores.sets if one.model.names == best.model.names]
    here = min(map(scores.of, forms), key=np.sum)
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
