"""Parts of generated code before it is written: memory, tables, C text, a twin in Python; and values in C."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.support.arrays import Array


@dataclass(frozen=True)
class Part:
    """Neighbours in a table or a memory that have a name of their own."""

    name: str
    count: int
    unit: str = ""


@dataclass(frozen=True)
class Table:
    """Numbers that the code reads and never writes, at least one: a field of its struct of parameters.

    They are float64[N], or whole numbers of the type of a form on whole numbers.
    """

    name: str  # an identifier of C, lower case
    values: NDArray[Any]
    type: str = "rdpi_real"
    parts: Sequence[Part] = ()  # in their order, from the first number on; empty: none is named
    about: str = ""


@dataclass(frozen=True)
class Memory:
    """Numbers that the code keeps from sample to sample, as those of a table: a field of its struct of memory."""

    name: str  # an identifier of C, lower case
    # where an episode begins whose first reference is 0 µm; NaN where the first sample sets it
    rest: NDArray[Any]
    by_reference: Array  # added to it by each µm (code) of the first reference; zero for a plant
    type: str = "rdpi_real"
    parts: Sequence[Part] = ()  # as those of a table
    about: str = ""


@dataclass(frozen=True)
class Program:
    """One sample of a controller or of a plant as C, for one lane.

    The body of ``step`` stands in a function that sees ``p``, the const struct of tables, and ``m``,
    the struct of memory, which it changes; of a controller ``reference_um`` is r(k), ``ahead_um[j]``
    r(k+1+j), ``measured_um`` and ``applied_V`` what was measured and commanded at k; of a plant
    ``command_V``. It ends with a ``return``, for a controller of u(k+1) (V), for a plant of the
    displacement (µm). Every number is an ``rdpi_real``, every literal ``RDPI_C(1.5)``, every
    function of the mathematics ``RDPI_EXP`` and so on, so that one text serves both precisions.
    """

    kind: Literal["controller", "plant"]
    title: str  # name of the controller or of the plant; not trusted
    model: str  # name of the model that it is made of; not trusted
    ts_s: float
    preview: int  # samples of the reference after r(k), at least 1; 0 for a plant
    command_range_V: tuple[float, float]
    rest_V: float  # command at which it begins
    centre_um: float  # centre and amplitude of the references that suit it
    scale_um: float
    tables: Sequence[Table]  # in the order of their structs
    memory: Sequence[Memory]
    functions: str  # static functions that `step` calls, callees first
    step: str
    # functions of <math.h> that are called, by the name of their macro ("EXP")
    mathematics: frozenset[str]
    # the same in Python, from rest: commands (V) of references and measurements (µm), or displacements
    # (µm) of commands, float64[T, B]
    twin: Callable[..., Array]
    # body of `void begin(p, m, reference_um)`, where the memory at rest is not affine in the first reference
    begin: str = ""
    exact: bool = True  # equal to the Python kernels bit by bit in double; else why not
    inexact_because: str = ""
    notes: Sequence[str] = field(default_factory=tuple)


_LARGEST_FLOAT, _SMALLEST_FLOAT = 3e38, 1.2e-38

Kind = Literal["real", "int", "bool"]
"""``rdpi_real``, ``int32_t`` and ``bool`` (as ``int``) of the C text."""


def words(text: str) -> frozenset[str]:
    """Return the words of a text."""
    return frozenset(text.split())


C_KEYWORDS = words(
    "auto break case char const continue default do double else enum extern float for goto if inline int long "
    "register restrict return short signed sizeof static struct switch typedef union unsigned void volatile "
    "while"
)
C_TYPES: dict[Kind, str] = {"real": "rdpi_real", "int": "int32_t", "bool": "int32_t"}


@dataclass(frozen=True)
class Known:
    """A number, a flag, None, or a tuple of them, known as the code is written."""

    value: Any


@dataclass(frozen=True)
class Number:
    """A scalar that is known only as the code runs."""

    text: str
    kind: Kind = "real"


@dataclass(frozen=True)
class Block:
    """An array in memory, contiguous, its last index running fastest."""

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
