"""Kernels of the plant as functions on torch tensors, made from their own source.

A kernel loops over samples and lanes. Here it runs for one sample of one "lane" whose numbers are
tensors over all lanes, so its loops and its index arithmetic stay as they are. A branch on numbers
of the lanes runs for all of them: assignments within it, and what follows a ``return``, ``continue``
or ``break`` in it, hold in the lanes that take it.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import textwrap
from collections.abc import Callable, Mapping
from itertools import count
from types import FunctionType, ModuleType
from typing import Any, TypeAlias

import numpy as np
import torch
from torch import Tensor

from rdpi_gym.plant.cores import elementary
from rdpi_gym.support.errors import InputError

Mask: TypeAlias = bool | Tensor
"""Lanes for which something holds; a bool: all of them, or none."""


class UntranslatableError(InputError):
    """A kernel that cannot be run on tensors."""


class Lanes:
    """The operations of translated kernels, for the lanes that are active.

    Parameters
    ----------
    count
        Number of lanes B.
    device
        Of the tensors.
    """

    def __init__(self, count: int, device: torch.device) -> None:
        self.count, self.device = count, device
        self.active: Mask = True
        self.off: dict[str, Mask] = {"return": False, "continue": False, "break": False}
        self._translated: dict[Any, Callable[..., Any]] = {
            getattr(elementary, name): self.function(name)
            for name in ("expm1", "log", "log1p", "power")  # whose bits are shifted there
        }

    def translated(self, kernel: Any) -> Callable[..., Any]:
        """Return a compiled kernel, or a function that one calls, on tensors."""
        if kernel not in self._translated:
            self._translated[kernel] = self._translate(getattr(kernel, "py_func", kernel))
        return self._translated[kernel]

    def _translate(self, function: FunctionType) -> Callable[..., Any]:
        try:
            tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
        except (OSError, TypeError) as error:
            raise UntranslatableError(f"{function.__name__} has no source") from error
        (definition,) = tree.body
        if not isinstance(definition, ast.FunctionDef):
            raise UntranslatableError(f"{function.__name__} is no function of a file")
        code = compile(_Translator().function(definition), f"<{function.__name__}>", "exec")
        known = function.__globals__ | {
            name: cell.cell_contents
            for name, cell in zip(
                function.__code__.co_freevars, function.__closure__ or (), strict=True
            )
        }
        names: dict[str, Any] = {"lanes_": self}
        for name in {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}:
            if name in known:
                names[name] = self.resolve(known[name])
            elif name in _BUILTINS:
                names[name] = getattr(self, name)
        exec(code, names)  # the kernel's own source, with other operators
        made: Callable[..., Any] = names[function.__name__]
        return made

    def resolve(self, value: Any) -> Any:
        """Return what a global name of a kernel stands for on tensors."""
        if isinstance(value, ModuleType):
            return _Module(self)
        if hasattr(value, "py_func"):
            return self.translated(value)
        if callable(value):
            return self.function(getattr(value, "__name__", str(value)))
        return value

    def function(self, name: str) -> Any:
        """Return a function of NumPy or of the mathematics library on tensors."""
        if name in ("pi", "nan", "inf", "e"):
            return getattr(math, name)
        if name in _ARRAYS:
            return _ARRAYS[name]

        def apply(*arguments: Any) -> Any:
            if name not in _MATHEMATICS:
                raise UntranslatableError(f"{name}()")
            if any(isinstance(each, np.ndarray) for each in arguments):
                return np.frompyfunc(apply, len(arguments), 1)(*arguments)
            if not any(isinstance(each, Tensor) for each in arguments):
                return (getattr(math, name, None) or getattr(np, name))(*arguments)
            return _MATHEMATICS[name](*(self.guarded(self.tensor(each)) for each in arguments))

        return apply

    # Lanes: which are active, and values that differ between them.
    def tensor(self, value: Any) -> Tensor:
        """Return a number as a tensor, and a tensor as it is."""
        if isinstance(value, Tensor):
            return value
        kind = torch.float64 if isinstance(value, float) else None
        return torch.tensor(value, dtype=kind, device=self.device)

    def mask(self) -> Mask:
        """Return the lanes that are active and have not left."""
        found = self.active
        for off in self.off.values():
            if off is not False:
                found = self.without(found, off)
        return found

    def without(self, mask: Mask, off: Mask) -> Mask:
        """Return the lanes of a mask that are not in another."""
        return self.both(mask, lambda: self.no(off))

    def both(self, one: Mask, other: Callable[[], Mask]) -> Mask:
        """Return ``one and other``; the other is worked out where it may matter."""
        if isinstance(one, Tensor):
            second = other()
            return one & second if isinstance(second, Tensor) else one if second else False
        return other() if one else False

    def either(self, one: Mask, other: Callable[[], Mask]) -> Mask:
        """Return ``one or other``."""
        return self.no(self.both(self.no(one), lambda: self.no(other())))

    def no(self, one: Mask) -> Mask:
        """Return ``not one``."""
        return ~one if isinstance(one, Tensor) else not one

    def put(self, value: Any, before: Any) -> Any:
        """Return a value in the lanes that are active, and what was before in the others."""
        mask = self.mask()
        if mask is True or before is None or isinstance(value, np.ndarray):
            return value
        return before if mask is False else self._choice(mask, value, before)

    def _choice(self, mask: Tensor, value: Any, other: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(self._choice(mask, *pair) for pair in zip(value, other, strict=True))
        return torch.where(mask, self.tensor(value), self.tensor(other))

    def guarded(self, value: Tensor) -> Tensor:
        """Return a value that is 1 in lanes that are not active, so that none spoils derivatives."""
        mask = self.mask()
        if isinstance(mask, Tensor) and value.requires_grad:
            return torch.where(mask, value, 1.0)
        return value

    # Control flow.
    def enter(self, test: Any) -> bool:
        """Leave active the lanes for which a test holds; say whether there may be some."""
        if not isinstance(test, Tensor):
            test = bool(test)
        self.active = self.both(self.active, lambda: test)
        return self.active is not False

    def leave(self, kind: str) -> bool:
        """Take the active lanes out by ``return``, ``continue`` or ``break``; say whether all."""
        mask = self.mask()
        self.off[kind] = self.either(self.off[kind], lambda: mask)
        return mask is True

    def choose(self, test: Any, one: Callable[[], Any], other: Callable[[], Any]) -> Any:
        """Return ``one if test else other``."""
        if not isinstance(test, Tensor):
            return one() if test else other()
        before = self.active
        self.active = self.both(before, lambda: test)
        value = one()
        self.active = self.both(before, lambda: ~test)
        rest = other()
        self.active = before
        return self._choice(test, value, rest)

    def begin_call(self) -> tuple[Mask, dict[str, Mask]]:
        """Return what :meth:`end_call` restores; in the call no lane has left."""
        before = self.active, self.off
        self.active, self.off = self.mask(), dict.fromkeys(self.off, False)
        return before

    def end_call(self, before: tuple[Mask, dict[str, Mask]]) -> None:
        """Go on where a function was called."""
        self.active, self.off = before

    def begin_loop(self) -> tuple[Mask, dict[str, Mask]]:
        """Return what :meth:`end_loop` restores; in the loop no lane has left it."""
        before = self.active, self.off
        self.off = self.off | {"continue": False, "break": False}
        for kind in ("continue", "break"):
            self.active = self.without(self.active, before[1][kind])
        return before

    def begin_round(self, before: Mask) -> None:
        """Begin a round of a loop with the lanes that have not left it."""
        self.active, self.off["continue"] = before, False

    def end_loop(self, before: tuple[Mask, dict[str, Mask]]) -> None:
        """Go on behind a loop."""
        returned = self.off["return"]
        self.active, self.off = before[0], before[1] | {"return": returned}

    def concrete(self, value: Any) -> Any:
        """Return a number that is the same for all lanes, or refuse one that is not."""
        if isinstance(value, Tensor):
            raise UntranslatableError("a loop whose length differs between lanes")
        return value

    # Elements of arrays; their indices may differ between lanes.
    def load(self, array: Any, index: Any) -> Any:
        """Return ``array[index]``."""
        if not isinstance(array, np.ndarray | tuple | list):
            raise UntranslatableError(f"an element of {type(array).__name__}")
        first, rest = _parts(index)
        if not isinstance(first, Tensor):
            found = array[index]
            return found.item() if isinstance(found, np.generic) else found
        column: Any = array[(slice(None), *rest)] if isinstance(array, np.ndarray) else array
        elements = torch.stack([self.tensor(each).expand(self.count) for each in column])
        place = first.clamp(0, len(column) - 1).expand(self.count)
        return elements.gather(0, place[None])[0]

    def store(self, array: Any, index: Any, value: Any) -> None:
        """Assign ``array[index] = value`` in the lanes that are active."""
        first, rest = _parts(index)
        if isinstance(first, Tensor):
            for i in range(len(array)):
                before = self.active
                self.enter(first == i)
                self.store(array, (i, *rest), value)
                self.active = before
            return
        view = array[index]
        if not isinstance(view, np.ndarray):
            array[index] = self.put(value, view)
            return
        values = np.broadcast_to(value, view.shape) if isinstance(value, np.ndarray) else None
        for place in np.ndindex(view.shape):
            view[place] = self.put(value if values is None else values[place], view[place])

    # Operators and functions of Python.
    def divide(self, one: Any, other: Any) -> Any:
        """Return ``one / other``."""
        return one / (self.guarded(other) if isinstance(other, Tensor) else other)

    def raised(self, one: Any, power: Any) -> Any:
        """Return ``one ** power``."""
        if isinstance(one, Tensor) or isinstance(power, Tensor):
            return self.guarded(self.tensor(one)) ** power
        return one**power

    def int(self, value: Any) -> Any:
        """Return the whole number next to zero."""
        return value.to(torch.int64) if isinstance(value, Tensor) else builtins.int(value)

    def float(self, value: Any) -> Any:
        """Return a number as it is."""
        return value.to(torch.float64) if isinstance(value, Tensor) else builtins.float(value)

    def min(self, one: Any, *others: Any) -> Any:
        """Return the least."""
        return self._extreme(torch.minimum, builtins.min, one, others)

    def max(self, one: Any, *others: Any) -> Any:
        """Return the largest."""
        return self._extreme(torch.maximum, builtins.max, one, others)

    def slice(self, *ends: Any) -> Any:
        """Return a part of an array's axis."""
        return builtins.slice(*map(self.concrete, ends))

    def range(self, *bounds: Any) -> Any:
        """Return the numbers of a loop."""
        return builtins.range(*map(self.concrete, bounds))

    def _extreme(self, of_tensors: Any, of_numbers: Any, one: Any, others: Any) -> Any:
        for other in others:
            either = isinstance(one, Tensor) or isinstance(other, Tensor)
            pair = (self.tensor(one), self.tensor(other)) if either else (one, other)
            one = (of_tensors if either else of_numbers)(*pair)
        return one


_BUILTINS = ("int", "float", "min", "max", "range")
_MATHEMATICS: Mapping[str, Callable[..., Any]] = {
    **{
        name: getattr(torch, name)
        for name in (
            "abs", "atan", "atan2", "ceil", "copysign", "cos", "cosh", "exp", "expm1", "floor", "hypot",
            "isnan", "log", "log1p", "log2", "log10", "sign", "sin", "sinh", "sqrt", "tan", "tanh", "where",
        )
    },
    "fabs": torch.abs, "arctan": torch.atan, "arctan2": torch.atan2, "minimum": torch.minimum,
    "maximum": torch.maximum, "power": torch.pow, "pow": torch.pow, "fmin": torch.fmin, "fmax": torch.fmax,
}  # fmt: skip


_ARRAYS: Mapping[str, Callable[..., Any]] = {
    "empty": lambda shape: np.full(shape, 0.0, dtype=object),
    "zeros": lambda shape: np.full(shape, 0.0, dtype=object),
    "empty_like": lambda array: np.full(array.shape, 0.0, dtype=object),
    "zeros_like": lambda array: np.full(array.shape, 0.0, dtype=object),
    "full": lambda shape, value: np.full(shape, value, dtype=object),
}


class _Module:
    """A module whose functions run on tensors."""

    def __init__(self, lanes: Lanes) -> None:
        self._lanes = lanes

    def __getattr__(self, name: str) -> Any:
        return self._lanes.function(name)


def _parts(index: Any) -> tuple[Any, tuple[Any, ...]]:
    return (index[0], index[1:]) if isinstance(index, tuple) else (index, ())


class _Translator(ast.NodeTransformer):
    """Rewrites a kernel: assignments, branches, indices and some operators become those of `Lanes`."""

    def __init__(self) -> None:
        self._numbers = count()

    def function(self, definition: ast.FunctionDef) -> ast.Module:
        """Return a module with the function alone, without decorators and annotations."""
        names = {
            node.id
            for node in ast.walk(definition)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        } - {argument.arg for argument in definition.args.args}
        arguments = ", ".join(argument.arg for argument in definition.args.args)
        body = [self.visit(node) for node in definition.body]
        made = ast.parse(
            f"def {definition.name}({arguments}):\n"
            + "".join(f"    {name} = None\n" for name in sorted(names))
            + "    value_ = None\n"
            "    before_ = lanes_.begin_call()\n"
            "    try:\n        pass\n"
            "    finally:\n        lanes_.end_call(before_)\n"
            "    return value_\n"
        )
        (function,) = made.body
        assert isinstance(function, ast.FunctionDef)
        (block,) = (node for node in function.body if isinstance(node, ast.Try))
        block.body = list(_flat(body))
        return ast.fix_missing_locations(made)

    # Statements.
    def visit_Assign(self, node: ast.Assign) -> list[ast.stmt]:
        name = f"assigned_{next(self._numbers)}"
        found = [_assign(name, self.visit(node.value))]
        return [*found, *_flat(self._put(target, _name(name)) for target in node.targets)]

    def visit_AnnAssign(self, node: ast.AnnAssign) -> list[ast.stmt]:
        assert node.value is not None
        return self.visit_Assign(ast.Assign([node.target], node.value))

    def visit_AugAssign(self, node: ast.AugAssign) -> list[ast.stmt]:
        before = ast.parse(ast.unparse(node.target), mode="eval").body
        return self.visit_Assign(ast.Assign([node.target], ast.BinOp(before, node.op, node.value)))

    def _put(self, target: ast.expr, value: ast.expr) -> list[ast.stmt]:
        if isinstance(target, ast.Tuple):
            parts = (
                self._put(each, ast.Subscript(value, ast.Constant(i), ast.Load()))
                for i, each in enumerate(target.elts)
            )
            return list(_flat(parts))
        if isinstance(target, ast.Subscript):
            index = self.visit(target.slice)
            return [ast.Expr(_call("store", self.visit(target.value), _indices(index), value))]
        assert isinstance(target, ast.Name)
        return [_assign(target.id, _call("put", value, _name(target.id)))]

    def visit_If(self, node: ast.If) -> list[ast.stmt]:
        number = next(self._numbers)
        test, before = f"test_{number}", f"active_{number}"
        found: list[ast.stmt] = [
            _assign(test, self.visit(node.test)),
            _assign(before, _active()),
        ]
        for condition, body in (
            (_name(test), node.body),
            (_call("no", _name(test)), node.orelse),
        ):
            if body:
                block = list(_flat(self.visit(each) for each in body))
                found += [ast.If(_call("enter", condition), block, []), _set_active(before)]
        return found

    def visit_For(self, node: ast.For) -> list[ast.stmt]:
        return self._loop(ast.For(node.target, self.visit(node.iter), node.body, []))

    def visit_While(self, node: ast.While) -> list[ast.stmt]:
        return self._loop(ast.While(_call("concrete", self.visit(node.test)), node.body, []))

    def _loop(self, loop: ast.For | ast.While) -> list[ast.stmt]:
        number = next(self._numbers)
        before, active = f"before_{number}", f"active_{number}"
        loop.body = [
            ast.Expr(_call("begin_round", _name(active))),
            *_flat(self.visit(each) for each in loop.body),
        ]
        return [
            _assign(before, _call("begin_loop")),
            _assign(active, _active()),
            loop,
            ast.Expr(_call("end_loop", _name(before))),
        ]

    def visit_Continue(self, node: ast.Continue) -> list[ast.stmt]:
        return [ast.If(_call("leave", ast.Constant("continue")), [node], [])]

    def visit_Break(self, node: ast.Break) -> list[ast.stmt]:
        return [ast.If(_call("leave", ast.Constant("break")), [node], [])]

    def visit_Return(self, node: ast.Return) -> list[ast.stmt]:
        value = ast.Constant(None) if node.value is None else self.visit(node.value)
        kept = _assign("value_", _call("put", value, _name("value_")))
        left = ast.If(_call("leave", ast.Constant("return")), [ast.Return(_name("value_"))], [])
        return [kept, left]

    # Expressions.
    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        return _call("load", self.visit(node.value), _indices(self.visit(node.slice)))

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        left, right = self.visit(node.left), self.visit(node.right)
        if isinstance(node.op, ast.Pow):
            return _call("raised", left, right)
        if isinstance(node.op, ast.Div):
            return _call("divide", left, right)
        return ast.BinOp(left, node.op, right)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.expr:
        operand: ast.expr = self.visit(node.operand)
        return (
            _call("no", operand) if isinstance(node.op, ast.Not) else ast.UnaryOp(node.op, operand)
        )

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.expr:
        kind = "both" if isinstance(node.op, ast.And) else "either"
        found: ast.expr = self.visit(node.values[0])
        for each in node.values[1:]:
            found = _call(kind, found, _later(self.visit(each)))
        return found

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        values = [self.visit(each) for each in (node.left, *node.comparators)]
        tests = [
            ast.Compare(left, [operator], [right])
            for left, operator, right in zip(values, node.ops, values[1:], strict=False)
        ]
        found: ast.expr = tests[0]
        for test in tests[1:]:
            found = _call("both", found, _later(test))
        return found

    def visit_IfExp(self, node: ast.IfExp) -> ast.expr:
        test, body, orelse = map(self.visit, (node.test, node.body, node.orelse))
        return _call("choose", test, _later(body), _later(orelse))


def _flat(statements: Any) -> Any:
    for each in statements:
        if isinstance(each, list):
            yield from each
        else:
            yield each


def _name(name: str) -> ast.expr:
    return ast.Name(name, ast.Load())


def _assign(name: str, value: ast.expr) -> ast.stmt:
    return ast.Assign([ast.Name(name, ast.Store())], value)


def _call(name: str, *arguments: ast.expr) -> ast.expr:
    return ast.Call(ast.Attribute(_name("lanes_"), name, ast.Load()), list(arguments), [])


def _active() -> ast.expr:
    return ast.Attribute(_name("lanes_"), "active", ast.Load())


def _set_active(name: str) -> ast.stmt:
    return ast.Assign([ast.Attribute(_name("lanes_"), "active", ast.Store())], _name(name))


def _later(value: ast.expr) -> ast.expr:
    empty = ast.arguments(posonlyargs=[], args=[], kwonlyargs=[], kw_defaults=[], defaults=[])
    return ast.Lambda(empty, value)


def _indices(index: ast.expr) -> ast.expr:
    """Return an index as an expression: a slice becomes a call."""
    if isinstance(index, ast.Tuple):
        return ast.Tuple([_indices(each) for each in index.elts], ast.Load())
    if isinstance(index, ast.Slice):
        ends = (index.lower, index.upper, index.step)
        return _call("slice", *(ast.Constant(None) if each is None else each for each in ends))
    return index
