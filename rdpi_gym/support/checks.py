"""Values that a caller hands in: what is a number, and how an error shows what it is not."""

from __future__ import annotations

import math
import numbers
import reprlib
from typing import Any

import numpy as np

_LONGEST = 60


def is_finite(value: object) -> bool:
    """Say whether a value is a finite real number that a float can hold; text and bool are none.

    Examples
    --------
    >>> is_finite(1), is_finite(float("nan")), is_finite("1"), is_finite(True), is_finite(10**400)
    (True, False, False, False, False)
    """
    if type(value) is float:
        return math.isfinite(value)
    if not isinstance(value, int | float | np.integer | np.floating) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number that no float holds
        return False


def is_whole(value: object, minimum: float) -> bool:
    """Say whether a value is a whole number of at least `minimum`; bool is none.

    Examples
    --------
    >>> is_whole(3, 0), is_whole(3, 4), is_whole(3.0, 0), is_whole(True, 0)
    (True, False, False, False)
    """
    whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    return whole and value >= minimum  # type: ignore[operator]  # Integral has no order


def shape_of(value: Any) -> tuple[int, ...] | None:
    """Return the shape of an array or of nested lists; None where they are ragged."""
    try:
        shape: tuple[int, ...] = np.shape(value)
    except ValueError:
        return None
    return shape


def shown(value: Any) -> str:
    """Return a value as an error shows it: one line, shortened where it is long.

    Examples
    --------
    >>> shown("ten"), shown(0.5), shown(list(range(100)))
    ("'ten'", '0.5', '[0, 1, 2, 3, 4, 5, ...]')
    """
    try:
        text = " ".join(reprlib.repr(value).split())
    except Exception:  # a whole number of thousands of digits, or a foreign object's own fault
        return f"a {type(value).__name__}"
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."
