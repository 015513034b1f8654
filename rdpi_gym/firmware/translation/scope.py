"""What a kernel's translation knows as it goes: names, what they stand for, and the lines so far."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping, Sequence
from typing import Any, Protocol, TypeAlias

from rdpi_gym.firmware.translation.arithmetic import (
    Arithmetic,
    Entry,
    Scalar,
    bare,
    is_simple,
    joined,
    text_of,
)
from rdpi_gym.firmware.translation.sources import Source, assigned_names
from rdpi_gym.firmware.translation.views import View
from rdpi_gym.firmware.values import C_TYPES, Block, Kind, Known, Number, Value
from rdpi_gym.support.errors import InputError

RESERVED = frozenset(
    {
        "abs", "auto", "break", "case", "ceil", "char", "const", "continue", "cos", "default",
        "do", "double", "else", "enum", "exp", "expm1", "extern", "float", "floor", "fmod",
        "for", "gamma", "goto", "if", "inline", "int", "isnan", "j0", "j1", "jn", "log",
        "log1p", "long", "main", "out", "pow", "register", "restrict", "return", "round",
        "short", "signbit", "signed", "sin", "sizeof", "sqrt", "static", "struct", "switch",
        "tan", "tanh", "typedef", "union", "unsigned", "void", "volatile", "while", "y0", "y1",
        "yn",
    }
)  # fmt: skip
"""What no variable of the text is called."""

Item: TypeAlias = "Value | View | tuple[Item, ...]"
"""What a name or an expression of a kernel stands for."""


class Retyped(Exception):
    """A variable has to hold numbers of another type than it was declared for."""

    def __init__(self, name: str, kind: Kind) -> None:
        super().__init__(name)
        self.name, self.kind = name, kind


class Calls(Protocol):
    """What a body needs of the functions around it: :class:`rdpi_gym.firmware.translation.kernels.Functions`."""

    arithmetic: Arithmetic
    inexact: set[str]
    by_lanes: set[str]

    def call(self, kernel: Any, arguments: Sequence[Value], local: Any) -> Any:
        """As :meth:`rdpi_gym.firmware.translation.kernels.Functions.call`."""


class Scope:
    """The names of one translation, the variables that stand for them, and the text.

    Parameters
    ----------
    functions
        That it calls others of.
    source
        The kernel.
    arguments
        One for each parameter.
    kinds
        Types of variables that an earlier try has found too narrow.

    Attributes
    ----------
    lines : list of str
        The C text between the braces.
    returns : Kind, Block or None
        What it returns; a block is filled through one parameter more.
    """

    def __init__(
        self,
        functions: Calls,
        source: Source,
        arguments: Sequence[Value],
        kinds: Mapping[str, Kind],
    ) -> None:
        self._functions, self._arithmetic = functions, functions.arithmetic
        self._source, self._kinds = source, kinds
        self.lines: list[str] = []
        self.returns: Kind | Block | None = None
        self._depth, self._held = 1, 0
        self._locals = assigned_names([source.tree], counters=True)
        self._env: dict[str, Item] = {}
        self._variables: dict[str, Kind] = {}  # by their names in C, as far as they are in scope
        self._taken: set[str] = set()
        self._arguments: dict[str, str] = {}
        self._written: set[str] = set()
        self._open_loops: list[bool] = []
        self._renamed: dict[tuple[str, str], str] = {}
        self._place: ast.AST = source.tree
        self._out = _returned_array(source)
        for parameter, value in zip(source.parameters, arguments, strict=True):
            name = self._c_name(parameter)
            self._arguments[parameter] = name
            if isinstance(value, Block):
                self._env[parameter] = View.of(value, name)
            elif isinstance(value, Number):
                self._env[parameter] = Number(name, value.kind)
                self._variables[name] = value.kind
            else:
                self._env[parameter] = value

    def argument(self, parameter: str) -> str:
        """Return the name of a parameter in C."""
        return self._arguments[parameter]

    def uses(self, parameter: str) -> bool:
        """Whether the text reads or writes a parameter."""
        word = re.compile(rf"\b{self._arguments[parameter]}\b")
        return any(word.search(line) for line in self.lines)

    def writes(self, parameter: str) -> bool:
        """Whether the text changes a parameter, or what it points at."""
        return self._arguments[parameter] in self._written

    def _declare(self, name: str, kind: Kind, value: Scalar | None) -> None:
        c_name = self._c_name(name)
        again = c_name in self._variables
        self._env[name] = Number(c_name, kind)
        if again and value is not None:
            if self._variables[c_name] != kind:
                raise Retyped(name, joined(kind, self._variables[c_name]))
            self._line(f"{c_name} = {bare(text_of(value, kind))};")
            return
        self._variables[c_name] = kind
        start = "" if value is None else f" = {bare(text_of(value, kind))}"
        self._line(f"{C_TYPES[kind]} {c_name}{start};")

    def _filled(self, part: View, value: Item) -> None:
        """Write all elements of a part: a number, or those of another array."""
        if part.size == 0:
            return
        if isinstance(value, Known | Number):
            if isinstance(value, Number) and (not is_simple(value.text) or part.root in value.text):
                value = self._kept(value) if part.size > 1 else value
            for index in self._elements(part.size):
                self._line(f"{part.element(index)} = {bare(text_of(value, part.kind))};")
            self._close()
            return
        if not isinstance(value, View) or value.size != part.size:
            raise InputError("an array is filled with one of another shape")
        if value.root == part.root and value.first == part.first and value.moves == part.moves:
            return
        for index in self._elements(part.size):
            self._line(f"{part.element(index)} = {value.element(index)};")
        self._close()

    def _elements(self, count: int) -> list[str | int]:
        """Open a loop over so many elements, and return its index; no loop for one."""
        if count == 1:
            self._open_loops.append(False)
            return [0]
        name = self._fresh("i")
        self._line(f"for (int32_t {name} = 0; {name} < {count}; ++{name}) {{")
        self._depth += 1
        self._open_loops.append(True)
        return [name]

    def _close(self) -> None:
        if self._open_loops.pop():
            self._depth -= 1
            self._line("}")

    def _read(self, part: View) -> Item:
        """A part of an array as a value: the number where it is one element."""
        if part.shape:
            return part
        if part.known is not None:
            if not part.root:
                return Known(float(part.known))
            return Entry(part.element(), "real", float(part.known))
        return Number(part.element(), part.kind)

    def _new_array(self, shape: tuple[int, ...], kind: Kind, wish: str) -> View:
        name = self._fresh(wish)
        block = Block(name, shape, kind)
        self._line(f"{C_TYPES[kind]} {name}[{max(block.size, 1)}];")
        return View.of(block, name)

    def _local(self, kind: Kind, count: int) -> str:
        name = self._fresh("made")
        self._line(f"{C_TYPES[kind]} {name}[{count}];")
        return name

    def _c_name(self, name: str) -> str:
        renamed = self._renamed.get((self._source.name, name))
        if renamed is not None:
            return renamed
        return f"{name}_" if name in RESERVED else name

    def _fresh(self, wish: str) -> str:
        base, count = self._c_name(wish), 0
        name = base
        used = {
            *self._variables,
            *self._taken,
            *(self._c_name(n) for n in self._locals),
            *self._arguments.values(),
        }
        if wish in self._locals and base not in self._taken and base not in self._variables:
            used.discard(base)
        while name in used:
            count += 1
            name = f"{base}_{count}"
        self._taken.add(name)
        return name

    def _kept(self, value: Number) -> Number:
        name = self._fresh("now")
        self._variables[name] = value.kind
        self._line(f"const {C_TYPES[value.kind]} {name} = {bare(value.text)};")
        return Number(name, value.kind)

    def _line(self, text: str) -> None:
        self.lines.append(f"{'    ' * self._depth}{text}")


def _returned_array(source: Source) -> str | None:
    last = source.tree.body[-1]
    if isinstance(last, ast.Return) and isinstance(last.value, ast.Name):
        return last.value.id
    return None
