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
class Table:
    """Numbers that the code reads and never writes: one field of its struct of parameters.

    Parameters
    ----------
    name
        Identifier of C, lower case.
    values
        float64[N], N at least 1.
    """

    name: str
    values: Array


@dataclass(frozen=True)
class Memory:
    """Numbers that the code keeps from sample to sample: one field of its struct of memory.

    Parameters
    ----------
    name
        Identifier of C, lower case.
    rest : float64[N]
        Where an episode begins whose first reference is 0 µm; NaN where the first sample sets it.
    by_reference : float64[N]
        What each µm of the first reference adds to it; zero for a plant.
    """

    name: str
    rest: Array
    by_reference: Array


@dataclass(frozen=True)
class Program:
    """One sample of a controller or of a plant as C, for one lane.

    The body of ``step`` stands in a function that sees ``p``, the const struct of tables, and ``m``,
    the struct of memory, which it changes; of a controller ``reference_um`` is r(k), ``ahead_um[j]``
    r(k+1+j), ``measured_um`` and ``applied_V`` what was measured and commanded at k; of a plant
    ``command_V``. It ends with a ``return``, for a controller of u(k+1) (V), for a plant of the
    displacement (µm). Every number is an ``rdpi_real``, every literal ``RDPI_C(1.5)``, every
    function of the mathematics ``RDPI_EXP`` and so on, so that one text serves both precisions.

    Parameters
    ----------
    kind
        Which of the two.
    title
        What it is, for people: the controller's name, or that of the plant. Not trusted.
    model
        Name of the model it is made of. Not trusted.
    ts_s
        Sampling time (s).
    preview
        Samples of the reference after r(k) that a step is given, at least 1; 0 for a plant.
    command_range_V
        Lowest and highest command (V).
    rest_V
        Command (V) at which it begins.
    centre_um, scale_um
        Centre and amplitude (µm) of the references that suit it.
    tables, memory
        In the order of their structs.
    functions
        C text of static functions that `step` calls, callees first.
    step
        C text of the body.
    mathematics
        Functions of ``<math.h>`` that are called, by the name of their macro ("EXP").
    twin
        The same in Python, from rest: commands (V) of references and measurements (µm), or displacements
        (µm) of commands, float64[T, B].
    begin
        C text of the body of ``void begin(p, m, reference_um)``, which sets the memory where that is
        not affine in the first reference; empty: it is, and `memory` says all.
    exact
        Whether it is equal to the Python kernels bit by bit in double; else why not.
    """

    kind: Literal["controller", "plant"]
    title: str
    model: str
    ts_s: float
    preview: int
    command_range_V: tuple[float, float]
    rest_V: float
    centre_um: float
    scale_um: float
    tables: Sequence[Table]
    memory: Sequence[Memory]
    functions: str
    step: str
    mathematics: frozenset[str]
    twin: Callable[..., Array]
    begin: str = ""
    exact: bool = True
    inexact_because: str = ""
    notes: Sequence[str] = field(default_factory=tuple)


_LARGEST_FLOAT, _SMALLEST_FLOAT = 3e38, 1.2e-38

Kind = Literal["real", "int", "bool"]
"""``rdpi_real``, ``int32_t`` and ``bool`` (as ``int``) of the C text."""

C_KEYWORDS = frozenset(
    [
        "auto",
        "break",
        "case",
        "char",
        "const",
        "continue",
        "default",
        "do",
        "double",
        "else",
        "enum",
        "extern",
        "float",
        "for",
        "goto",
        "if",
        "inline",
        "int",
        "long",
        "register",
        "restrict",
        "return",
        "short",
        "signed",
        "sizeof",
        "static",
        "struct",
        "switch",
        "typedef",
        "union",
        "unsigned",
        "void",
        "volatile",
        "while",
    ]
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
