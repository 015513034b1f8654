"""Kernels as C: the source of a numba function, translated for one lane with what is known of its arguments."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rdpi_gym.firmware.translation.arithmetic import Arithmetic
from rdpi_gym.firmware.translation.body import Body
from rdpi_gym.firmware.translation.scope import Retyped
from rdpi_gym.firmware.translation.sources import source_of
from rdpi_gym.firmware.values import C_TYPES, Block, Kind, Known, Number, Value
from rdpi_gym.support.errors import InputError

_TRIES = 20


@dataclass(frozen=True)
class Called:
    """A call of a translated kernel.

    Parameters
    ----------
    statement
        To be written now, with its semicolon; None where the value is the call itself.
    value
        What it returns: the call as an expression, or the array that it has filled; None: nothing.
    writes
        Which of the arguments it changes.
    """

    statement: str | None
    value: Value | None
    writes: frozenset[int] = frozenset()


@dataclass(frozen=True)
class _Function:
    name: str
    passed: tuple[int, ...]
    returns: Kind | Block | None
    writes: frozenset[int]


class Functions:
    """The translated kernels of one program, each once for each set of shapes and known numbers.

    A kernel is a function in the subset of Python that numba compiles here: loops, scalars and
    arrays of known shapes. Loops over the one sample and the one lane of a step fall away, numbers
    that are known are folded, arrays with known numbers are tables. What the kernel computes, and in
    which order, stays, so that C without contraction gives the same bits.

    Attributes
    ----------
    arithmetic : Arithmetic
        With the functions of the mathematics that are called.
    inexact : set of str
        Why C is not equal bit by bit, where it is not.
    by_lanes : set of str
        Why it is so with Python's single lanes alone, where Python itself differs in many.

    Examples
    --------
    >>> import numpy as np
    >>> from rdpi_gym.plant.effects.backlash import backlash_block
    >>> functions = Functions()
    >>> x, y = Block("x", (1, 1)), Block("y", (1, 1))
    >>> table = Block("p->gap", (1, 1), known=np.array([[0.25]]))
    >>> functions.call(
    ...     backlash_block, [x, x, table, Block("m->gap", (1, 1)), Known(1e-4), y], lambda kind, n: "z"
    ... ).statement
    'step_backlash_block(x, p->gap, m->gap, y);'
    """

    def __init__(self) -> None:
        self.arithmetic = Arithmetic()
        self.inexact: set[str] = set()
        self.by_lanes: set[str] = set()
        self._made: dict[object, _Function] = {}
        self._texts: list[str] = []
        self._names: dict[str, int] = {}

    @property
    def mathematics(self) -> frozenset[str]:
        """Functions of ``<math.h>`` that are called, by the name of their macro."""
        return frozenset(self.arithmetic.mathematics)

    @property
    def text(self) -> str:
        """The functions of C, callees first."""
        return "\n".join(self._texts)

    def call(
        self, kernel: Any, arguments: Sequence[Value], local: Callable[[Kind, int], str]
    ) -> Called:
        """Return a call of a kernel, which is translated where it has not been."""
        values = _filled(kernel, arguments)
        key = kernel.py_func, tuple(_described(value) for value in values)
        if key not in self._made:
            self._made[key] = self._translated(kernel, values)
        made = self._made[key]
        texts = [_passed(values[k]) for k in made.passed]
        if isinstance(made.returns, Block):
            name = local(made.returns.kind, made.returns.size)
            statement = f"{made.name}({', '.join([*texts, name])});"
            block = Block(name, made.returns.shape, made.returns.kind)
            return Called(statement, block, made.writes)
        call = f"{made.name}({', '.join(texts)})"
        if made.returns is None:
            return Called(f"{call};", None, made.writes)
        return Called(None, Number(call, made.returns), made.writes)

    def _translated(self, kernel: Any, values: Sequence[Value]) -> _Function:
        source = source_of(kernel)
        if kernel.targetoptions.get("fastmath"):
            self.inexact.add("Python sums over vectors of plays, in another order")
        kinds: dict[str, Kind] = {}
        for _ in range(_TRIES):
            body = Body(self, source, values, kinds)
            try:
                body.translate()
                break
            except Retyped as found:
                kinds[found.name] = found.kind
        else:
            raise InputError(f"{source.place} changes the types of its variables too often")
        name = self._unique(source.name)
        passed, parameters, writes = [], [], set()
        for k, (parameter, value) in enumerate(zip(source.parameters, values, strict=True)):
            if not body.uses(parameter):
                continue
            passed.append(k)
            if isinstance(value, Number):
                fixed = "" if body.writes(parameter) else "const "
                parameters.append(f"{fixed}{C_TYPES[value.kind]} {body.argument(parameter)}")
            elif isinstance(value, Block):
                if body.writes(parameter):
                    writes.add(k)
                fixed = "" if k in writes else "const "
                parameters.append(f"{fixed}{C_TYPES[value.kind]} *{body.argument(parameter)}")
        returns = body.returns
        head = "void" if returns is None or isinstance(returns, Block) else C_TYPES[returns]
        if isinstance(returns, Block):
            parameters.append(f"{C_TYPES[returns.kind]} *{returns.text}")
        text = "\n".join(
            [f"static {head} {name}({', '.join(parameters) or 'void'}) {{", *body.lines, "}", ""]
        )
        self._texts.append(text)
        return _Function(name, tuple(passed), returns, frozenset(writes))

    def _unique(self, name: str) -> str:
        base = f"step_{name.lstrip('_')}"
        count = self._names.get(base, 0)
        self._names[base] = count + 1
        return f"{base}_{count + 1}" if count else base


def _filled(kernel: Any, arguments: Sequence[Value]) -> list[Value]:
    parameters = list(inspect.signature(kernel.py_func).parameters.values())
    missing = parameters[len(arguments) :]
    for parameter in missing:
        if parameter.default is inspect.Parameter.empty:
            file = Path(inspect.getfile(kernel.py_func)).name
            raise InputError(f"{kernel.__name__} ({file}) is called without {parameter.name}")
    return [*arguments, *(Known(parameter.default) for parameter in missing)]


def _described(value: Value) -> object:
    if isinstance(value, Known):
        return "known", type(value.value), repr(value.value)
    if isinstance(value, Number):
        return "number", value.kind
    return "block", value.shape, value.kind, None if value.known is None else value.known.tobytes()


def _passed(value: Value) -> str:
    assert not isinstance(value, Known)
    text = value.text
    return (
        text[1:-1] if text.startswith("(") and text.endswith(")") and text.count("(") == 1 else text
    )
