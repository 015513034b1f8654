"""What stands for a number or an array while C is written: an expression, or what is known already."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

_LARGEST_FLOAT, _SMALLEST_FLOAT = 3e38, 1.2e-38

Kind = Literal["real", "int", "bool"]
"""``rdpi_real``, ``int32_t`` and ``bool`` (as ``int``) of the C text."""

C_TYPES: dict[Kind, str] = {"real": "rdpi_real", "int": "int32_t", "bool": "int32_t"}


@dataclass(frozen=True)
class Known:
    """A number, a flag, None, or a tuple of them, known as the code is written.

    Parameters
    ----------
    value
        It.
    """

    value: Any


@dataclass(frozen=True)
class Number:
    """A scalar that is known only as the code runs.

    Parameters
    ----------
    text
        Expression of C; a name, or in parentheses where it is more.
    kind
        Its type.
    """

    text: str
    kind: Kind = "real"


@dataclass(frozen=True)
class Block:
    """An array in memory, contiguous, its last index running fastest.

    Parameters
    ----------
    text
        Expression of C that points at its first element.
    shape
        Known as the code is written.
    kind
        Of an element.
    known
        Its numbers where it is a table that nothing writes; else None.
    """

    text: str
    shape: tuple[int, ...]
    kind: Kind = "real"
    known: NDArray[np.float64] | None = None

    @property
    def size(self) -> int:
        """Number of elements."""
        return int(np.prod(self.shape, dtype=int))


Value: TypeAlias = Known | Number | Block


def literal(value: float) -> str:
    """Return a number as C reads it in either precision."""
    number = float(value)
    if np.isnan(number):
        return "RDPI_NAN"
    if np.isinf(number):
        return "RDPI_INFINITY" if number > 0 else "(-RDPI_INFINITY)"
    if abs(number) > _LARGEST_FLOAT:
        return f"RDPI_WIDE({number!r}, {math.copysign(_LARGEST_FLOAT, number)!r}f)"
    if 0.0 < abs(number) < _SMALLEST_FLOAT:
        return f"RDPI_WIDE({number!r}, 0.0f)"
    return f"RDPI_C({number!r})"
