"""What a check says: a number, its threshold, one of three zones, a sentence, the next step."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

Zone = Literal["yes", "no", "cannot tell"]

_SURE = 5.0  # standard errors that a value above its threshold is away from zero
_ABSENT = 3.0  # standard errors that fit between a value and its threshold


@dataclass(frozen=True)
class Check:
    """One test of a data set that needs no model.

    Parameters
    ----------
    name
        What is looked for: an effect, or a weakness of the data.
    value, threshold
        What was measured, and from where on its size counts; None where nothing could be measured.
    unit
        Of both, in print: ``%``, ``µs``, or empty.
    zone
        ``yes``: it is there. ``no``: the data would show it and do not. ``cannot tell``: the data
        do not hold what the test needs, or the value is too uncertain.
    sentence
        What was found, for a reader of the report.
    next_step
        The experiment or the action that would help; empty where none is needed.
    suggests
        Names of effects that a ``yes`` speaks for, the likeliest first.
    """

    name: str
    value: float | None
    threshold: float | None
    unit: str
    zone: Zone
    sentence: str
    next_step: str = ""
    suggests: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the check as a JSON object."""
        return {
            "name": self.name,
            "value": self.value,
            "threshold": self.threshold,
            "unit": self.unit,
            "zone": self.zone,
            "sentence": self.sentence,
            "next_step": self.next_step or None,
            "suggests": list(self.suggests),
        }


def cannot_tell(name: str, sentence: str, next_step: str) -> Check:
    """Return a check for which the data do not hold what it needs."""
    return Check(name, None, None, "", "cannot tell", sentence, next_step)


def zone_of(value: float, error: float, threshold: float) -> Zone:
    """Sort a value with its standard error into a zone."""
    size = abs(value)
    if not (math.isfinite(size) and math.isfinite(error)):
        return "cannot tell"
    if size >= threshold:
        return "yes" if size >= _SURE * error else "cannot tell"
    return "no" if size + _ABSENT * error < threshold else "cannot tell"
