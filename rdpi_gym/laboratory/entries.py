"""Refits and rankings as a journal holds them: every field that is read is there, and of its type."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rdpi_gym.support.checked import check_type

Entry = Mapping[str, Any]
Fields = Mapping[str, tuple[Any, Any]]
"""By name, the type of a field and what stands for one that is missing."""
_NUMBERS = Mapping[str, float]
_REFIT: Fields = {
    "effect": (str, None), "form": (str, None), "plant": (Entry | None, None),
    "train_um": (float | None, None), "validation_um": (float | None, None),
    "by_record_um": (Mapping[str, float | None], {}), "parameters": (_NUMBERS, {}),
    "at_bound": (Sequence[str], []),
}  # fmt: skip
_CANDIDATE: Fields = {
    "effect": (str, None), "form": (str, None), "share_of_excess": (float | None, None),
    "confidence": (float | None, None), "indistinguishable": (Sequence[str], []),
    "remarks": (Sequence[str], []),
}  # fmt: skip
_RESULT: Fields = {
    "candidates": (Sequence[Entry], []), "chosen": (Sequence[str], []), "headline": (str, ""),
    "lines": (Sequence[str], []), "remainder": (str, ""), "portrait_lines": (Sequence[str], []),
    "next_experiment": (str | None, None), "experiment": (Entry | None, None), "advice": (Entry | None, None),
    "noise_floor": (float | None, None), "settled": (Entry | None, None), "final": (Entry, {}),
}  # fmt: skip
_FINAL: Fields = {
    "train_rmse": (float | None, None), "validation_rmse": (float | None, None),
    "by_record": (Mapping[str, float | None], {}),
}  # fmt: skip


def refit_of(entry: Any) -> Entry:
    """Return a refit with every field."""
    return _whole(entry, _REFIT, "a refit")


def result_of(entry: Any) -> Entry | None:
    """Return what a ranking ended with, with every field; None where it has not ended."""
    if entry is None:
        return None
    found = _whole(entry, _RESULT, "a ranking")
    candidates = [_whole(each, _CANDIDATE, "a candidate") for each in found["candidates"]]
    return found | {"candidates": candidates, "final": _whole(found["final"], _FINAL, "a ranking")}


def error_um(entry: Entry) -> float:
    """Return the validation error of a refit (µm rms); one that is not finite stands as null."""
    error = entry["validation_um"]
    return math.inf if error is None else float(error)


def _whole(entry: Any, fields: Fields, what: str) -> dict[str, Any]:
    check_type(entry, Entry, what)
    found = {**entry}
    for name, (hint, missing) in fields.items():
        found.setdefault(name, missing)
        check_type(found[name], hint, f"{name} of {what}")
    return found
