"""Results in the quantities of their data set: sentences are made for V and µm, and turned once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar, cast

from rdpi_gym.measurement import Quantities

T = TypeVar("T")
# Fields that hold names, or what is no text for a reader.
_KEPT = frozenset(
    [
        "title",
        "name",
        "names",
        "role",
        "record",
        "effect",
        "form",
        "kind",
        "zone",
        "verdict",
        "suggests",
        "removed",
        "indistinguishable",
        "quantities",
        "model",
        "plant",
        "plane",
        "traces",
        "views",
        "advice",
        "reservation",
        "limit_notices",
    ]
)


def told(result: T, quantities: Quantities, keep: Iterable[str] = ()) -> T:
    """Return a result whose sentences use the quantities of a data set."""
    return result if quantities.are_standard else cast("T", _told(result, quantities, tuple(keep)))


def _told(value: Any, quantities: Quantities, keep: tuple[str, ...]) -> Any:
    if isinstance(value, str):
        return quantities.said(value, keep)
    if isinstance(value, tuple | list):
        return type(value)([_told(each, quantities, keep) for each in value])
    if isinstance(value, Mapping):
        return {key: _told(each, quantities, keep) for key, each in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        changed = {f.name: getattr(value, f.name) for f in fields(value) if f.name not in _KEPT}
        return replace(value, **{k: _told(each, quantities, keep) for k, each in changed.items()})
    return value
