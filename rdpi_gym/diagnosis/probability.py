"""Probabilities of effects from the course of a search, calibrated on studies whose truth is known."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Protocol

from rdpi_gym.support.documents import PLAIN, Document, stored
from rdpi_gym.support.files import read_json

FORMAT, VERSION = "rdpi-probabilities", 1
NONE, OTHER = "none", "something else"
"""Names of what is no effect of the catalogue: that none is missing, that another one is."""
LEAST_PROBABLE = 0.5
"""Least probability of an effect that is added."""
COVERED = 0.9
"""Coverage of the set of probable effects, and least probability of one that is stated as missing."""
# Shares of the excess beyond which nothing more is read from them: of a named effect, of another.
_LEAST_SHARE, _LEAST_OTHER, _MOST_SHARE = 0.01, 0.003, 0.999
_MOST_FLOORS, _MOST_RIVALS = 100.0, 3
# Of the square of the floor, what is taken to be left at least; and the largest logarithm of a ratio
# of what two effects leave.
_LEAST_LEFT, _FARTHEST = 0.15, 8.0
# Floors up to which a model counts as explained; as a verdict does, but for what the sampling hides.
_EXPLAINED = 1.15
_FITTED = Path(__file__).with_name("probabilities.json")


class Sign(Protocol):
    """Evidence for one effect: the part of a candidate that a probability is read from."""

    @property
    def effect(self) -> str:
        """Its name."""

    @property
    def share(self) -> float:
        """Share of the excess over the noise floor that it takes in the round in which it was tried."""

    @property
    def confidence(self) -> float:
        """Share of the splits of the records in which it wins, 0 to 1."""

    @property
    def indistinguishable(self) -> tuple[str, ...]:
        """Effects that fit as well."""


@dataclass(frozen=True)
class Course:
    """Course of a search, as far as probabilities are read from it."""

    # Validation error of the base model and of the final one (µm rms)
    base_um: float
    end_um: float
    floor_um: float  # noise and numerical floor together (µm rms)
    added: Sequence[Sign]  # what was added, in order
    tried: Sequence[Sign]  # every candidate of the first round

    @property
    def common(self) -> dict[str, float]:
        """Features of the search as a whole."""
        return {
            "base": _floors(self.base_um, self.floor_um),
            "left": _floors(self.end_um, self.floor_um),
            "explained": float(self.end_um <= _EXPLAINED * self.floor_um),
            "steps": float(len(self.added)),
            "empty": float(not self.added),
        }

    def of_added(self, place: int) -> dict[str, float]:
        """Return the features of what was added in a place."""
        sign = self.added[place]
        return self.common | {
            "share": _logit(min(max(sign.share, _LEAST_SHARE), _MOST_SHARE)),
            "rivals": float(min(len(sign.indistinguishable), _MOST_RIVALS)),
            "splits": sign.confidence,
            "later": float(len(self.added) - place - 1),
        }

    def of_other(self, sign: Sign, kin: Collection[str]) -> dict[str, float]:
        """Return the features of a candidate that was not added."""
        names = {step.effect for step in self.added}
        rival = any(sign.effect in step.indistinguishable for step in self.added)
        return self.common | {
            "share": _logit(min(max(sign.share, _LEAST_OTHER), _MOST_SHARE)),
            "rival": float(rival or bool(names & set(sign.indistinguishable))),
            "kin": float(bool(names & set(kin))),
            "behind": self._behind(sign),
        }

    def _behind(self, sign: Sign) -> float:
        """Excess that one effect would leave in place of another that alone explains the data.

        The logarithm of the ratio of the excesses; 0 where there is no such effect.
        """
        if len(self.added) != 1 or self.end_um > _EXPLAINED * self.floor_um:
            return 0.0
        ratio = math.log(self._left_by(sign) / self._left_by(self.added[0]))
        return min(max(ratio, 0.0), _FARTHEST)

    def _left_by(self, sign: Sign) -> float:
        """Excess that a candidate leaves, refitted in the first round (µm²)."""
        floor = max(self.floor_um, 1e-300) ** 2
        excess = max(self.base_um**2 - floor, 0.0)
        return (1.0 - min(max(sign.share, -1.0), 1.0)) * excess + _LEAST_LEFT * floor


NAMED = ("left", "explained", "share", "rivals", "splits", "later")
IN_CLASS = ("left", "explained", "share", "later")
UNNAMED = ("left", "explained", "share", "rival", "kin", "behind")
ELSE = ("left", "explained", "steps", "base")
NOTHING = ("empty", "base")
"""Features that each of the probabilities is read from."""


@dataclass(frozen=True)
class Calibration:
    """Logistic regressions from features to probabilities, and what a probable set holds."""

    # Weights by feature, ``constant`` among them: that an effect which was added is there; that it
    # is, or one that the records do not tell from it; that one is there which was not added; that
    # something outside the catalogue is; that nothing is missing
    named: Mapping[str, float]
    in_class: Mapping[str, float]
    unnamed: Mapping[str, float]
    other: Mapping[str, float]
    none: Mapping[str, float]
    least: float  # probability from which on an effect belongs to the set of probable ones

    def to_dict(self) -> dict[str, Any]:
        """Return the content of the file."""
        return {"format": FORMAT, "version": VERSION, **PLAIN.write_fields(self)}

    @classmethod
    def load(cls, path: Path) -> Calibration:
        """Read what :meth:`to_dict` returns."""
        return PLAIN.read_fields(cls, read_json(path, (FORMAT,), VERSION), str(path))


@dataclass(frozen=True)
class Probabilities(Document):
    """Probabilities of effects, given the course of a search.

    Parameters
    ----------
    effects
        By name, 0 to 1, the most probable first. They are no shares of a whole: two effects can be
        there at once.
    classes
        Of each effect that was added: that it is there, or one that the records do not tell from it.
    none
        That no effect is missing.
    other
        That something is there that the catalogue does not have.
    probable
        The effects of the set that holds all that are there in nine of ten searches.
    """

    effects: Mapping[str, float]
    classes: Mapping[str, float]
    none: float = field(metadata=stored(NONE))
    other: float = field(metadata=stored(OTHER))
    probable: tuple[str, ...]


def probabilities(
    course: Course,
    kin: Mapping[str, Collection[str]],
    calibration: Calibration | None = None,
) -> Probabilities:
    """Return how probable each effect is that was added or tried."""
    fitted = calibration or of_the_package()
    found = {
        sign.effect: chance(fitted.named, course.of_added(place))
        for place, sign in enumerate(course.added)
    }
    for sign in course.tried:
        if sign.effect not in found:
            features = course.of_other(sign, kin.get(sign.effect, ()))
            found[sign.effect] = chance(fitted.unnamed, features)
    effects = dict(sorted(found.items(), key=lambda item: -item[1]))
    return Probabilities(
        effects,
        dict(zip((sign.effect for sign in course.added), of_classes(course, fitted), strict=True)),
        chance(fitted.none, course.common),
        chance(fitted.other, course.common),
        tuple(name for name, p in effects.items() if p >= fitted.least),
    )


GRADES = ("", "probably", "possibly")
"""Words that grade an answer, the surest first."""


def grade(probability: float) -> str:
    """Return the word of a probability (0 to 1): none from `COVERED` on, the last below `LEAST_PROBABLE`."""
    return GRADES[(probability < COVERED) + (probability < LEAST_PROBABLE)]


def of_classes(course: Course, calibration: Calibration | None = None) -> list[float]:
    """Return for each effect that was added how probable it, or one that fits as well, is."""
    fitted = calibration or of_the_package()
    return [chance(fitted.in_class, course.of_added(k)) for k in range(len(course.added))]


@cache
def of_the_package() -> Calibration:
    """Return the calibration that lies in the package."""
    return Calibration.load(_FITTED)


def chance(weights: Mapping[str, float], features: Mapping[str, float]) -> float:
    """Return the probability that a logistic regression gives; ``constant`` is a feature of one."""
    return 1.0 / (1.0 + math.exp(-sum(w * features.get(n, 1.0) for n, w in weights.items())))


def _logit(share: float) -> float:
    return math.log(share / (1.0 - share))


def _floors(error_um: float, floor_um: float) -> float:
    """Logarithm of an error in floors, none below one."""
    return math.log(min(max(error_um / max(floor_um, 1e-300), 1.0), _MOST_FLOORS))
