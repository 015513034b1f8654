"""Results in the quantities of their data set: the fields of their texts are filled in once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar, cast

from rdpi_gym.measurement import Quantities

T = TypeVar("T")
# Fields of results that hold no text for a reader.
_KEPT = frozenset(["model", "plane", "plant", "quantities", "traces", "views"])


def told(result: T, quantities: Quantities) -> T:
    """Return a result whose texts have the words and units of a data set."""
    return cast("T", _told(result, quantities))


def _told(value: Any, quantities: Quantities) -> Any:
    if isinstance(value, str):
        return quantities.fill(value)
    if isinstance(value, tuple | list):
        return type(value)([_told(each, quantities) for each in value])
    if isinstance(value, Mapping):
        return {key: _told(each, quantities) for key, each in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        own = {f.name: getattr(value, f.name) for f in fields(value) if f.name not in _KEPT}
        found = {name: _told(each, quantities) for name, each in own.items()}
        return value if found == own else replace(value, **found)
    return value
