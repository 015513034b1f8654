"""A test of a data set without a model: a number, its threshold, one of three zones, the next step."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from rdpi_gym.diagnosis.notices import Statement, statement
from rdpi_gym.diagnosis.words import text_of
from rdpi_gym.measurement import Quantities
from rdpi_gym.support.documents import PLAIN, stored

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
    base_unit
        Of both, in print: ``%``, ``µs``, ``µm``, or empty.
    zone
        ``yes``: it is there. ``no``: the data would show it and do not. ``cannot tell``: the data
        do not hold what the test needs, or the value is too uncertain.
    found
        What was found.
    advice
        The experiment or the action that would help; None where none is needed.
    suggests
        Names of effects that a ``yes`` speaks for, the likeliest first.
    quantities
        What was measured: sentences use its words and units.
    """

    name: str
    value: float | None
    threshold: float | None
    base_unit: str = field(metadata=stored("unit"))
    zone: Zone
    found: Statement = field(metadata=stored("sentence"))
    advice: Statement | None = field(default=None, metadata=stored("next_step"))
    suggests: tuple[str, ...] = ()
    quantities: Quantities = field(default_factory=Quantities, metadata=stored(omitted=True))

    @property
    def unit(self) -> str:
        """Unit of value and threshold, in print."""
        return self.quantities.unit(self.base_unit)

    @property
    def sentence(self) -> str:
        """The finding, for a reader of the report."""
        return text_of(self.found, self.quantities)

    @property
    def next_step(self) -> str:
        """The advice in words; empty where none is needed."""
        return "" if self.advice is None else text_of(self.advice, self.quantities)

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

    @classmethod
    def from_dict(cls, document: Any, source: str = "check") -> Check:
        """Build from the object of the files; its sentences stay as they are."""
        if isinstance(document, Mapping) and document.get("value") in ("nan", "inf", "-inf"):
            document = {**document, "value": None}  # of a saved result: no finite one
        return PLAIN.read_fields(cls, document, source)


def cannot_tell(name: str, code: str, advice: str, **values: object) -> Check:
    """Return a check for which the data do not hold what it needs."""
    return Check(name, None, None, "", "cannot tell", statement(code, **values), statement(advice))


def zone_of(value: float, error: float, threshold: float) -> Zone:
    """Sort a value with its standard error into a zone."""
    size = abs(value)
    if not (math.isfinite(size) and math.isfinite(error)):
        return "cannot tell"
    if size >= threshold:
        return "yes" if size >= _SURE * error else "cannot tell"
    return "no" if size + _ABSENT * error < threshold else "cannot tell"
