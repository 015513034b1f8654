"""Expressions of a kernel: what is known of them is folded, the rest is text of C."""

from __future__ import annotations

import ast
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numba.core.registry import CPUDispatcher

from rdpi_gym.firmware.program import C_TYPES, Block, Kind, Known, Number, Value
from rdpi_gym.firmware.translation.arithmetic import (
    MATHEMATICS,
    Entry,
    Scalar,
    bare,
    is_simple,
    kind_of,
    text_of,
)
from rdpi_gym.firmware.translation.scope import (
    Item,
    Scope,
    Source,
    View,
    assigned_names,
    returns_tuple,
    source_of,
    writes_arrays,
)
from rdpi_gym.plant.cores import elementary
from rdpi_gym.support.errors import InputError

LIBRARY: Mapping[Any, str] = {
    elementary.expm1: "expm1",
    elementary.log: "log",
    elementary.log1p: "log1p",
    elementary.power: "pow",
}
"""Kernels that a library of C has: their own digits are tricks with the bits of a double."""


class Expressions(Scope):
    """Values of expressions, in the scope that they stand in."""

    @abstractmethod
    def _statements(self, body: Sequence[ast.stmt]) -> bool:
        """Write statements; return whether what follows is never reached."""

    def _scalar(self, node: ast.expr) -> Scalar:
        value = self._expression(node)
        if not isinstance(value, Known | Number):
            raise InputError(f"{ast.unparse(node)!r} is no number")
        return value

    def _expression(self, node: ast.expr, target: ast.expr | None = None) -> Item:
        if isinstance(node, ast.Constant):
            return Known(node.value)
        if isinstance(node, ast.Name):
            return self._named(node.id)
        if isinstance(node, ast.Tuple):
            items = tuple(self._expression(each) for each in node.elts)
            if all(isinstance(each, Known) for each in items):
                return Known(tuple(each.value for each in items if isinstance(each, Known)))
            return items
        if isinstance(node, ast.BinOp):
            return self._operated(type(node.op).__name__, node)
        if isinstance(node, ast.UnaryOp):
            return self._unary(node)
        if isinstance(node, ast.Compare):
            return self._compared(node)
        if isinstance(node, ast.BoolOp):
            sign = "&&" if isinstance(node.op, ast.And) else "||"
            value = self._scalar(node.values[0])
            for each in node.values[1:]:
                if isinstance(value, Known) and bool(value.value) == (sign == "||"):
                    return value
                value = self._arithmetic.both(sign, value, self._scalar(each))
            return value
        if isinstance(node, ast.IfExp):
            return self._either(node)
        if isinstance(node, ast.Attribute):
            return self._attribute(node)
        if isinstance(node, ast.Subscript):
            part = self._part(node)
            return self._read(part) if isinstance(part, View) else part
        if isinstance(node, ast.Call):
            return self._called(node, target)
        raise InputError(f"{ast.unparse(node)!r} has no C")

    def _operated(self, name: str, node: ast.BinOp) -> Item:
        left, right = self._expression(node.left), self._expression(node.right)
        if isinstance(left, Known | Number) and isinstance(right, Known | Number):
            squares = name == "Pow" and isinstance(right, Known) and isinstance(right.value, int)
            if squares and isinstance(left, Number) and not is_simple(left.text):
                left = self._kept(left)
            return self._arithmetic.binary(name, left, right)
        if isinstance(left, View | Known | Number) and isinstance(right, View | Known | Number):
            return self._elementwise(lambda a, b: self._arithmetic.binary(name, a, b), left, right)
        raise InputError(f"{ast.unparse(node)!r} has no C")

    def _elementwise(self, operation: Any, *operands: Item) -> View:
        """Return a small array of what an operation makes of others, element by element."""
        views = [each for each in operands if isinstance(each, View)]
        size, shape = views[0].size, views[0].shape
        if size != 1:
            raise InputError("an operation on whole arrays in a kernel has C for one lane only")
        parts = [
            self._read(each.reshaped((1,)).fixed(0, Known(0))) if isinstance(each, View) else each
            for each in operands
        ]
        if all(isinstance(each, Known | Entry) for each in parts):  # of tables: a number of its own
            parts = [Known(each.value) if isinstance(each, Entry) else each for each in parts]
        value = operation(*parts)
        if isinstance(value, Known):
            number = np.full(shape, value.value, dtype=np.float64)
            return View.of(Block("", shape, "real", number), "")
        name = self._fresh("one")
        self._line(f"{C_TYPES[value.kind]} {name}[1];")
        self._line(f"{name}[0] = {bare(value.text)};")
        return View.of(Block(name, shape, value.kind), name)

    def _unary(self, node: ast.UnaryOp) -> Item:
        value = self._scalar(node.operand)
        if isinstance(node.op, ast.USub):
            return self._arithmetic.negative(value)
        if isinstance(node.op, ast.Not):
            return self._arithmetic.negated(value)
        raise InputError(f"{ast.unparse(node)!r} has no C")

    def _compared(self, node: ast.Compare) -> Item:
        left, found = self._scalar(node.left), None
        for operator, right_node in zip(node.ops, node.comparators, strict=True):
            right = self._scalar(right_node)
            one = self._arithmetic.compare(type(operator).__name__, left, right)
            found = one if found is None else self._arithmetic.both("&&", found, one)
            left = right
        assert found is not None
        return found

    def _either(self, node: ast.IfExp) -> Item:
        test = self._scalar(node.test)
        if isinstance(test, Known):
            return self._expression(node.body if test.value else node.orelse)
        before = len(self.lines)
        one, other = self._expression(node.body), self._expression(node.orelse)
        if len(self.lines) != before:
            raise InputError(f"a choice in {ast.unparse(node)!r} needs statements of its own")
        if isinstance(one, tuple) and isinstance(other, tuple):
            return tuple(
                self._arithmetic.chosen(test, a, b)
                for a, b in zip(one, other, strict=True)
                if isinstance(a, Known | Number) and isinstance(b, Known | Number)
            )
        if isinstance(one, Known | Number) and isinstance(other, Known | Number):
            return self._arithmetic.chosen(test, one, other)
        raise InputError(f"a choice between arrays, {ast.unparse(node)!r}, has no C")

    def _named(self, name: str) -> Item:
        if name in self._env:
            return self._env[name]
        if name in self._locals:
            raise InputError(f"{name} is read before it is set")
        found = self._source.names.get(name)
        if isinstance(found, bool | int | float | tuple):
            return Known(found)
        raise InputError(f"{name} has no C")

    def _attribute(self, node: ast.Attribute) -> Item:
        text = ast.unparse(node)
        if text == "np.inf":
            return Known(float("inf"))
        if text == "np.nan":
            return Known(float("nan"))
        if text in ("math.pi", "np.pi"):
            return Known(float(np.pi))
        over = self._expression(node.value)
        if isinstance(over, View):
            if node.attr == "shape":
                return Known(over.shape)
            if node.attr == "size":
                return Known(over.size)
            if node.attr == "T" and len(over.shape) == 1:
                return over
        raise InputError(f"{text!r} has no C")

    def _part(self, node: ast.Subscript) -> Item:
        over = self._expression(node.value)
        if isinstance(over, Known):
            place = self._scalar(node.slice)
            if not isinstance(place, Known):
                return self._looked_up(tuple_of(over), place)
            return Known(tuple_of(over)[int(place.value)])
        if isinstance(over, tuple):
            place = self._scalar(node.slice)
            assert isinstance(place, Known)
            return over[int(place.value)]
        if not isinstance(over, View):
            raise InputError(f"{ast.unparse(node)!r} has no C")
        places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        axis = 0
        for each in places:
            if isinstance(each, ast.Slice):
                if each.step is not None:
                    raise InputError(f"{ast.unparse(node)!r}: a slice with a step has no C")
                length = over.shape[axis]
                start, stop = (
                    self._whole(end, length, default)
                    for end, default in ((each.lower, 0), (each.upper, length))
                )
                over = over.cut(axis, start, stop)
                axis += 1
                continue
            index = self._scalar(each)
            if kind_of(index) == "real":
                raise InputError(f"{ast.unparse(node)!r} is read at a place with a fraction")
            over = over.fixed(axis, index)
        return over

    def _looked_up(self, items: Sequence[Any], place: Number) -> Scalar:
        """One of a few known numbers, at a place known only as the code runs."""
        if not is_simple(place.text):
            place = self._kept(place)
        value: Scalar = Known(items[-1])
        for k in range(len(items) - 2, -1, -1):
            here = self._arithmetic.compare("Eq", place, Known(k))
            value = self._arithmetic.chosen(here, Known(items[k]), value)
        return value

    def _whole(self, node: ast.expr | None, length: int, default: int) -> int:
        if node is None:
            return default
        value = self._scalar(node)
        if not isinstance(value, Known):
            raise InputError("a slice between places known only as it runs has no C")
        place = int(value.value)
        return min(max(place + length if place < 0 else place, 0), length)

    def _called(self, node: ast.Call, target: ast.expr | None) -> Item:
        function = node.func
        if isinstance(function, ast.Attribute):
            if isinstance(function.value, ast.Name) and function.value.id in ("np", "math"):
                return self._library(function.value.id, function.attr, node, target)
            text = ast.unparse(function)
            if text.startswith(("np.", "math.")):
                raise InputError(f"{text} has no C")
            return self._method(function, node, target)
        if not isinstance(function, ast.Name):
            raise InputError(f"{ast.unparse(node)!r} has no C")
        name = function.id
        called = self._source.names.get(name)
        arguments = [self._expression(each) for each in node.args]
        if isinstance(called, CPUDispatcher):
            return self._kernel(called, arguments, node)
        scalars = [each for each in arguments if isinstance(each, Known | Number)]
        if len(scalars) == len(arguments):
            found = self._builtin(name, scalars)
            if found is not None:
                return found
        if name == "len" and isinstance(arguments[0], View):
            return Known(arguments[0].shape[0])
        if name == "len" and isinstance(arguments[0], Known):
            return Known(len(tuple_of(arguments[0])))
        raise InputError(f"{ast.unparse(node)!r} has no C")

    def _builtin(self, name: str, arguments: Sequence[Scalar]) -> Scalar | None:
        arithmetic = self._arithmetic
        if name in ("min", "max") and len(arguments) >= 2:
            value = arguments[0]
            for each in arguments[1:]:
                value = arithmetic.extreme(name, value, each)
            return value
        if name == "abs":
            return arithmetic.absolute(arguments[0])
        if name == "int":
            return arithmetic.whole(arguments[0])
        if name == "float":
            value = arguments[0]
            if isinstance(value, Known):
                return Known(float(value.value))
            return value if value.kind == "real" else Number(text_of(value, "real"))
        if name == "round" and isinstance(arguments[0], Known):
            return Known(round(arguments[0].value))
        if name == "bool":
            return arguments[0]
        return None

    def _library(self, module: str, name: str, node: ast.Call, target: ast.expr | None) -> Item:
        if name in ("empty", "zeros", "full", "empty_like", "zeros_like"):
            return self._array(name, node, target)
        arguments = [self._expression(each) for each in node.args]
        if name == "where" and len(arguments) == 3:
            return self._elementwise(self._arithmetic.chosen, *arguments)
        if name == "sign":
            value = arguments[0]
            assert isinstance(value, Number)
            one, none = Known(1.0), Known(0.0)
            below = self._arithmetic.compare("Lt", value, none)
            above = self._arithmetic.compare("Gt", value, none)
            return self._arithmetic.chosen(
                above, one, self._arithmetic.chosen(below, Known(-1.0), none)
            )
        if any(isinstance(each, View) for each in arguments):
            if name in MATHEMATICS and len(arguments) == 1:
                return self._elementwise(lambda x: self._arithmetic.function(name, x), *arguments)
            raise InputError(f"{ast.unparse(node)!r} of an array has no C")
        scalars = [each for each in arguments if isinstance(each, Known | Number)]
        if len(scalars) != len(arguments):
            raise InputError(f"{ast.unparse(node)!r} has no C")
        if name in ("minimum", "maximum", "fmin", "fmax"):
            return self._arithmetic.extreme(name[-3:], *scalars)
        if name in ("abs", "absolute", "fabs"):
            return self._arithmetic.absolute(scalars[0])
        try:
            return self._arithmetic.function(name, *scalars)
        except InputError:
            raise InputError(f"{module}.{name} has no C") from None

    def _method(self, function: ast.Attribute, node: ast.Call, target: ast.expr | None) -> Item:
        over = self._expression(function.value)
        if isinstance(over, View):
            if function.attr == "copy" and not node.args:
                return self._copied(over, target)
            if function.attr == "reshape":
                shape = [self._scalar(each) for each in node.args]
                known = [int(each.value) for each in shape if isinstance(each, Known)]
                if len(known) == len(shape):
                    return over.reshaped(known)
            if function.attr == "ravel" and over.is_contiguous:
                return over.reshaped((over.size,))
        raise InputError(f"{ast.unparse(node)!r} has no C")

    def _copied(self, over: View, target: ast.expr | None) -> View:
        if over.known is not None:
            return over
        copy = self._new_array(over.shape, over.kind, self._wish(target, "copy"))
        self._filled(copy, over)
        return copy

    def _wish(self, target: ast.expr | None, otherwise: str) -> str:
        return target.id if isinstance(target, ast.Name) else otherwise

    def _array(self, name: str, node: ast.Call, target: ast.expr | None) -> View:
        kind: Kind = "real"
        for keyword in node.keywords:
            if keyword.arg != "dtype":
                raise InputError(f"{ast.unparse(node)!r} has no C")
            text = ast.unparse(keyword.value)
            kind = "bool" if "bool" in text else "int" if "int" in text else "real"
        first = self._expression(node.args[0])
        if name.endswith("_like"):
            if not isinstance(first, View):
                raise InputError(f"{ast.unparse(node)!r} has no C")
            shape = first.shape
        elif isinstance(first, Known):
            given = first.value
            shape = given if isinstance(given, tuple) else (int(given),)
        else:
            raise InputError(f"{ast.unparse(node)!r} has a size known only as it runs")
        if isinstance(target, ast.Name) and target.id == self._out:
            made = View.of(Block("out", shape, kind), "out")
        else:
            made = self._new_array(shape, kind, self._wish(target, "array"))
        if name == "full":
            self._filled(made, self._scalar(node.args[1]))
        elif name.startswith("zeros"):
            self._filled(made, Known(0.0 if kind == "real" else 0))
        return made

    def _kernel(self, kernel: Any, arguments: Sequence[Item], node: ast.Call) -> Item:
        if kernel in LIBRARY:
            name = LIBRARY[kernel]
            self._functions.inexact.add(f"{name} of a library stands for the package's own")
            scalars = [each for each in arguments if isinstance(each, Known | Number)]
            if name == "pow":
                return self._arithmetic.binary("Pow", *scalars)
            return self._arithmetic.function(name, *scalars)
        if kernel is elementary.expm1_lanes:
            self._functions.by_lanes.add("many lanes at once take another exponential in Python")
        source = source_of(kernel)
        if returns_tuple(source.tree):
            return self._inlined(source, arguments)
        values: list[Value] = []
        for each in arguments:
            if isinstance(each, View):
                values.append(self._passable(each).block())
            elif isinstance(each, Entry):
                values.append(Number(each.text, each.kind))
            elif isinstance(each, Known | Number):
                values.append(each)
            else:
                raise InputError(f"{ast.unparse(node)!r} has no C")
        called = self._functions.call(kernel, values, self._local)
        for k, view in enumerate(arguments):
            if isinstance(view, View) and k in called.writes:
                self._written.add(view.root)
        if called.statement is not None:
            self._line(called.statement)
        if isinstance(called.value, Block):
            return View.of(called.value, called.value.text)
        if isinstance(called.value, Number) and called.statement is None:
            return self._kept(called.value) if writes_arrays(source) else called.value
        return Known(None)

    def _passable(self, view: View) -> View:
        if view.is_contiguous and view.root:
            return view
        if not view.root:
            raise InputError("numbers that stand in no table are given to a kernel as an array")
        copy = self._new_array(view.shape, view.kind, "part")
        self._filled(copy, view)
        return View(copy.root, copy.shape, copy.strides, copy.kind, known=view.known)

    def _inlined(self, source: Source, arguments: Sequence[Item]) -> Item:
        """Translate a kernel that returns several numbers where it is called."""
        outer = self._source, self._env, self._locals, self._place, self._arguments
        env: dict[str, Item] = dict(zip(source.parameters, arguments, strict=True))
        for name, value in env.items():
            if isinstance(value, Number) and not is_simple(value.text):
                env[name] = self._kept(value)
        self._source, self._env = source, env
        self._locals = assigned_names(source.tree.body, counters=True)
        *body, last = source.tree.body
        assert isinstance(last, ast.Return)
        assert last.value is not None
        hidden = dict(self._variables)
        for name in self._locals:  # a name of the callee is none of the caller's
            while self._c_name(name) in self._variables:
                self._renamed[source.name, name] = self._fresh(name)
        self._statements(body)
        value = self._expression(last.value)
        self._variables = {**hidden, **self._variables}
        self._source, self._env, self._locals, self._place, self._arguments = outer
        return value


def tuple_of(value: Item) -> tuple[Any, ...]:
    """Return the items of a known tuple."""
    if isinstance(value, Known) and isinstance(value.value, tuple | range | list):
        return tuple(value.value)
    raise InputError("something else than a tuple is counted through")
