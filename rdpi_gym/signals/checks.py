"""Checks of a signal's fields: one line that names the field, its value and what would be right."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rdpi_gym.support.checks import is_finite, is_whole, shown
from rdpi_gym.support.errors import InputError


def refuse(signal: Any, field: str, wanted: str) -> InputError:
    """Return the error for a field of `signal` that is not as `wanted` says."""
    return InputError(f"{signal.name}: {field} is {shown(getattr(signal, field))}; give {wanted}")


def set_number(
    signal: Any,
    field: str,
    *,
    above: float = -math.inf,
    minimum: float = -math.inf,
    maximum: float = math.inf,
) -> None:
    """Store a field as a float after checking that it is finite and within its bounds."""
    value = getattr(signal, field)
    if not (is_finite(value) and value > above and minimum <= value <= maximum):
        bounds = [
            f"{word} {bound:g}"
            for word, bound in (("above", above), ("at least", minimum), ("at most", maximum))
            if math.isfinite(bound)
        ]
        raise refuse(signal, field, " ".join(["a finite number", " and ".join(bounds)]).strip())
    object.__setattr__(signal, field, float(value))


def set_positive(signal: Any, *fields: str) -> None:
    """Store fields as floats after checking that they are finite and above zero."""
    for field in fields:
        set_number(signal, field, above=0.0)


def set_integer(signal: Any, field: str, *, minimum: int, maximum: int | None = None) -> None:
    """Store a field as an int after checking that it is a whole number within its bounds."""
    value = getattr(signal, field)
    if not is_whole(value, minimum) or (maximum is not None and value > maximum):
        limit = "" if maximum is None else f" and at most {maximum}"
        raise refuse(signal, field, f"a whole number of at least {minimum}{limit}")
    object.__setattr__(signal, field, int(value))


def set_numbers(signal: Any, field: str, *, count: int) -> None:
    """Store a field as a tuple of floats after checking that there are `count` of them or more."""
    try:
        values = np.asarray(getattr(signal, field), dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        values = np.empty(0)
    if values.ndim != 1 or values.size < count or not np.isfinite(values).all():
        raise refuse(signal, field, f"a flat list of at least {count} finite numbers")
    object.__setattr__(signal, field, tuple(values.tolist()))
