"""A kernel's source, its arrays, and the names of its translation: what they stand for, and the lines so far."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.firmware.program import C_KEYWORDS, C_TYPES, Block, Kind, Known, Number, Value, words
from rdpi_gym.firmware.translation.arithmetic import (
    Arithmetic,
    Entry,
    Scalar,
    bare,
    is_simple,
    joined,
    text_of,
)
from rdpi_gym.support.errors import InputError


@dataclass(frozen=True)
class Source:
    """A kernel's syntax tree, and where it stands."""

    name: str
    place: str
    parameters: tuple[str, ...]
    tree: ast.FunctionDef
    names: Mapping[str, Any]
    first_line: int


@cache
def source_of(kernel: Any) -> Source:
    """Return the source of a kernel."""
    function = kernel.py_func
    try:
        lines, first = inspect.getsourcelines(function)
        file = Path(inspect.getfile(function)).name
    except (OSError, TypeError) as error:
        raise InputError(
            f"the source of kernel {function.__name__} cannot be read ({error})"
        ) from error
    tree = ast.parse(textwrap.dedent("".join(lines))).body[0]
    assert isinstance(tree, ast.FunctionDef)
    closed = inspect.getclosurevars(function)
    names = {**function.__globals__, **closed.nonlocals}
    parameters = tuple(a.arg for a in tree.args.args)
    return Source(
        function.__name__, f"{function.__name__} ({file})", parameters, tree, names, first
    )


def as_read(target: ast.expr) -> ast.expr:
    """Return what is written as it would be read."""
    copy = ast.parse(ast.unparse(target), mode="eval").body
    return ast.copy_location(copy, target)


def assigned_names(body: Sequence[ast.stmt], counters: bool = False) -> set[str]:
    """Return the names that statements assign; those that their loops count with if asked for."""
    nodes = nodes_of(body)
    loops = [] if counters else [each for each in nodes if isinstance(each, ast.For)]
    counted = {id(n) for loop in loops for n in ast.walk(loop.target)}
    return {
        n.id
        for n in nodes
        if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store) and id(n) not in counted
    }


def nodes_of(body: Sequence[ast.stmt]) -> list[ast.AST]:
    """Return all nodes of statements."""
    return [n for each in body for n in ast.walk(each)]


def is_left(body: Sequence[ast.stmt]) -> bool:
    """Whether a loop's own body goes on to the next turn, or leaves it, before its end."""
    return any(
        isinstance(each, ast.Break | ast.Continue)
        or (isinstance(each, ast.If) and (is_left(each.body) or is_left(each.orelse)))
        for each in body
    )


def straight(body: Sequence[ast.stmt]) -> list[ast.stmt]:
    """Return the body of a loop of one turn without jumps: what follows one is its other branch."""
    made: list[ast.stmt] = []
    for k, each in enumerate(body):
        if isinstance(each, ast.Break | ast.Continue):
            return made
        if isinstance(each, ast.If) and is_left([each]):
            if each.orelse or is_left(each.body[:-1]):
                raise InputError("a loop that is left from within several branches has no C")
            rest = straight(body[k + 1 :])
            before: list[ast.stmt] = each.body[:-1] or [ast.Pass()]
            made.append(ast.copy_location(ast.If(each.test, before, rest), each))
            return made
        made.append(each)
    return made


def returns_tuple(tree: ast.FunctionDef) -> bool:
    """Whether a function returns several numbers."""
    last = tree.body[-1]
    return isinstance(last, ast.Return) and isinstance(last.value, ast.Tuple)


def writes_arrays(source: Source) -> bool:
    """Whether a kernel writes into any array."""
    return any(
        isinstance(n, ast.Subscript) and isinstance(n.ctx, ast.Store) for n in ast.walk(source.tree)
    )


@dataclass(frozen=True)
class View:
    """Part of an array that stands at a name of C."""

    root: str
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    kind: Kind = "real"
    first: int = 0
    moves: str = ""
    known: NDArray[np.float64] | None = None

    @classmethod
    def of(cls, block: Block, root: str) -> View:
        """Return all of a block that stands at a name."""
        strides = tuple(
            int(np.prod(block.shape[k + 1 :], dtype=int)) for k in range(len(block.shape))
        )
        return cls(root, block.shape, strides, block.kind, known=block.known)

    @property
    def size(self) -> int:
        """Number of elements."""
        return int(np.prod(self.shape, dtype=int))

    @property
    def is_contiguous(self) -> bool:
        """Whether its elements are contiguous in their order."""
        apart = 1
        for length, stride in zip(reversed(self.shape), reversed(self.strides), strict=True):
            if length != 1 and stride != apart:
                return False
            apart *= length
        return True

    @property
    def pointer(self) -> str:
        """Expression that points at its first element."""
        offset = _offset(self.first, self.moves)
        return self.root if offset == "0" else f"({self.root} + {offset})"

    def block(self) -> Block:
        """Return the part as a block; it has to be contiguous."""
        return Block(self.pointer, self.shape, self.kind, self.known)

    def fixed(self, axis: int, index: Known | Number) -> View:
        """Return the part at one index of an axis, without that axis."""
        shape = self.shape[:axis] + self.shape[axis + 1 :]
        strides = self.strides[:axis] + self.strides[axis + 1 :]
        stride, length = self.strides[axis], self.shape[axis]
        if isinstance(index, Known):
            place = int(index.value)
            place += length if place < 0 else 0
            known = None if self.known is None else np.take(self.known, place, axis)
            first = self.first + place * stride
            return replace(self, shape=shape, strides=strides, first=first, known=known)
        if length == 1:
            return replace(
                self,
                shape=shape,
                strides=strides,
                known=None if self.known is None else np.take(self.known, 0, axis),
            )
        move = index.text if stride == 1 else f"{stride} * {index.text}"
        moves = f"{self.moves} + {move}" if self.moves else move
        return replace(self, shape=shape, strides=strides, moves=moves, known=None)

    def cut(self, axis: int, start: int, stop: int) -> View:
        """Return the part between two places of an axis."""
        shape = (*self.shape[:axis], max(stop - start, 0), *self.shape[axis + 1 :])
        known = None
        if self.known is not None:
            known = np.take(self.known, range(start, max(stop, start)), axis)
        first = self.first + start * self.strides[axis]
        return replace(self, shape=shape, first=first, known=known)

    def reshaped(self, shape: Sequence[int]) -> View:
        """Return it in another shape; it has to be contiguous."""
        lengths = list(shape)
        if -1 in lengths:
            lengths[lengths.index(-1)] = -self.size // int(np.prod(lengths, dtype=int))
        block = Block(self.root, tuple(lengths), self.kind)
        known = None if self.known is None else self.known.reshape(lengths)
        return replace(View.of(block, self.root), first=self.first, moves=self.moves, known=known)

    def element(self, index: str | int = "") -> str:
        """Return the expression of one element: of a scalar part, or the `index`-th of a flat one."""
        moves = self.moves
        first = self.first
        if isinstance(index, int):
            first += index * (self.strides[0] if self.strides else 1)
        elif index:
            stride = self._flat_stride
            move = index if stride == 1 else f"{stride} * {index}"
            moves = f"{moves} + {move}" if moves else move
        return f"{self.root}[{_offset(first, moves)}]"

    @property
    def _flat_stride(self) -> int:
        """Elements between neighbours where one axis alone is longer than 1, or it is contiguous."""
        longer = [s for n, s in zip(self.shape, self.strides, strict=True) if n != 1]
        return 1 if self.is_contiguous or not longer else longer[0]


def _offset(first: int, moves: str) -> str:
    if not moves:
        return str(first)
    return moves if first == 0 else f"{first} + {moves}" if first > 0 else f"{moves} - {-first}"


RESERVED = C_KEYWORDS | words(
    "abs ceil cos exp expm1 floor fmod gamma isnan j0 j1 jn log log1p main out pow round signbit sin sqrt tan "
    "tanh y0 y1 yn"
)
"""Names that no variable of the text has."""

Item: TypeAlias = "Value | View | tuple[Item, ...]"
"""Value of a name or of an expression of a kernel."""


class Retyped(Exception):
    """A variable has to hold numbers of another type than it was declared for."""

    def __init__(self, name: str, kind: Kind) -> None:
        super().__init__(name)
        self.name, self.kind = name, kind


class Calls(Protocol):
    """Interface of the functions around a body: :class:`rdpi_gym.firmware.translation.kernels.Functions`."""

    arithmetic: Arithmetic
    inexact: set[str]
    by_lanes: set[str]

    def call(self, kernel: Any, arguments: Sequence[Value], local: Any) -> Any:
        """As :meth:`rdpi_gym.firmware.translation.kernels.Functions.call`."""


class Scope:
    """The names of one translation, the variables that stand for them, and the text."""

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
