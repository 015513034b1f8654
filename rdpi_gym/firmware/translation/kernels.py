"""Kernels as C: the statements of a numba function, translated for one lane with what is known of its arguments."""

from __future__ import annotations

import ast
import inspect
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rdpi_gym.firmware.program import C_TYPES, Block, Kind, Known, Number, Value, literal
from rdpi_gym.firmware.translation.arithmetic import (
    Arithmetic,
    Constant,
    Entry,
    Scalar,
    bare,
    is_simple,
    joined,
    kind_of,
    text_of,
)
from rdpi_gym.firmware.translation.expressions import Expressions, tuple_of
from rdpi_gym.firmware.translation.scope import (
    Item,
    Retyped,
    View,
    as_read,
    assigned_names,
    is_left,
    source_of,
    straight,
)
from rdpi_gym.support.errors import InputError

_TRIES = 20
_PLAIN = (-1.0, 0.0, 0.5, 1.0, 2.0)  # numbers that say as much as a name


@dataclass(frozen=True)
class Called:
    """A call of a translated kernel."""

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
        name = self._unique(source.name)
        shown = _with_names(name, source.parameters, values)
        for _ in range(_TRIES):
            body = Body(self, source, shown, kinds)
            try:
                body.translate()
                break
            except Retyped as found:
                kinds[found.name] = found.kind
        else:
            raise InputError(f"{source.place} changes the types of its variables too often")
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
        constants = [
            f"#define {each.name} {literal(each.value)}\n"
            for each in shown
            if isinstance(each, Constant) and re.search(rf"\b{each.name}\b", text)
        ]
        self._texts.append("".join([*constants, text]))
        return _Function(name, tuple(passed), returns, frozenset(writes))

    def _unique(self, name: str) -> str:
        base = f"step_{name.lstrip('_')}"
        count = self._names.get(base, 0)
        self._names[base] = count + 1
        return f"{base}_{count + 1}" if count else base


def _with_names(name: str, parameters: Sequence[str], values: Sequence[Value]) -> list[Value]:
    """Return arguments, of which those that are known and say little as a number have a name."""
    named = list(values)
    for k, (parameter, value) in enumerate(zip(parameters, values, strict=True)):
        number = value.value if isinstance(value, Known) else None
        if isinstance(number, float) and math.isfinite(number) and number not in _PLAIN:
            named[k] = Constant(number, f"{name}_{parameter}".upper())
    return named


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


class Body(Expressions):
    """One translation of a kernel, for arguments of which shapes and some numbers are known."""

    def translate(self) -> None:
        """Write the lines."""
        try:
            self._statements(self._source.tree.body)
        except InputError as error:
            if "kernel " in str(error):
                raise
            line = self._source.first_line + getattr(self._place, "lineno", 1) - 1
            raise InputError(f"kernel {self._source.place}, line {line}: {error}") from None

    def _statements(self, body: Sequence[ast.stmt]) -> bool:
        """Write statements; return whether what follows is never reached."""
        for statement in body:
            self._place = statement
            if self._statement(statement):
                return True
        return False

    def _statement(self, node: ast.stmt) -> bool:
        if isinstance(node, ast.Expr):
            if isinstance(node.value, ast.Call):
                self._expression(node.value)
            return False
        if isinstance(node, ast.Assign):
            self._assigned(node.targets, node.value)
        elif isinstance(node, ast.AnnAssign):
            if node.value is not None:
                self._assigned([node.target], node.value)
        elif isinstance(node, ast.AugAssign):
            self._augmented(node)
        elif isinstance(node, ast.If):
            return self._branched(node)
        elif isinstance(node, ast.For):
            return self._looped(node)
        elif isinstance(node, ast.While):
            self._repeated(node)
        elif isinstance(node, ast.Return):
            self._returned(node)
            return True
        elif isinstance(node, ast.Break):
            self._line("break;")
            return True
        elif isinstance(node, ast.Continue):
            self._line("continue;")
            return True
        elif not isinstance(node, ast.Pass):
            raise InputError(f"{ast.unparse(node).splitlines()[0]!r} has no C")
        return False

    def _assigned(self, targets: Sequence[ast.expr], source: ast.expr) -> None:
        first = targets[0]
        if len(targets) == 1 and isinstance(first, ast.Tuple) and isinstance(source, ast.Tuple):
            values = [self._expression(each) for each in source.elts]
            goals = [self._goal(each) for each in first.elts]
            for k, value in enumerate(values):  # all are read before any is written
                earlier = [g for g in goals[:k] if g]
                if isinstance(value, Number) and any(_mentions(value.text, g) for g in earlier):
                    values = [self._kept(v) if isinstance(v, Number) else v for v in values]
                    break
            for target, value in zip(first.elts, values, strict=True):
                self._store(target, value)
            return
        value = self._expression(source, targets[-1] if isinstance(targets[-1], ast.Name) else None)
        # an element may be one of those that are written
        changes = isinstance(value, Number) and ("[" in value.text or not is_simple(value.text))
        if len(targets) > 1 and isinstance(value, Number) and changes:
            value = self._kept(value)
        for target in targets:
            self._store(target, value)

    def _goal(self, target: ast.expr) -> str:
        """Return the C text that is written where a target is assigned."""
        if isinstance(target, ast.Name):
            return self._c_name(target.id)
        if isinstance(target, ast.Subscript):
            part = self._part(target)
            return part.element() if isinstance(part, View) and not part.shape else "\0"
        return "\0"

    def _augmented(self, node: ast.AugAssign) -> None:
        old = self._expression(as_read(node.target))
        operand = self._expression(node.value)
        name = type(node.op).__name__
        if isinstance(old, Known | Number) and isinstance(operand, Known | Number):
            self._store(node.target, self._arithmetic.binary(name, old, operand), name, operand)
            return
        raise InputError(f"{ast.unparse(node)!r} of whole arrays has no C")

    def _store(
        self,
        target: ast.expr,
        value: Item,
        operation: str | None = None,
        operand: Scalar | None = None,
    ) -> None:
        if isinstance(target, ast.Tuple):
            parts = value if isinstance(value, tuple) else None
            if parts is None and isinstance(value, Known) and isinstance(value.value, tuple):
                parts = tuple(Known(each) for each in value.value)
            if parts is None or len(parts) != len(target.elts):
                raise InputError(
                    f"{ast.unparse(target)!r} is given something else than so many numbers"
                )
            for each, part in zip(target.elts, parts, strict=True):
                self._store(each, part)
        elif isinstance(target, ast.Name):
            self._bind(target.id, value, operation, operand)
        elif isinstance(target, ast.Subscript):
            part = self._part(target)
            if not isinstance(part, View):
                raise InputError(f"{ast.unparse(target)!r} is no array that can be written")
            self._written.add(part.root)
            if part.shape:
                self._filled(part, value)
                return
            if not isinstance(value, Known | Number):
                raise InputError(f"{ast.unparse(target)!r} is given an array where a number stands")
            self._write(part.element(), part.kind, value, operation, operand)
        else:
            raise InputError(f"{ast.unparse(target)!r} cannot be assigned in C")

    def _write(
        self,
        goal: str,
        kind: Kind,
        value: Scalar,
        operation: str | None = None,
        operand: Scalar | None = None,
    ) -> None:
        short = {"Add": "+=", "Sub": "-=", "Mult": "*="}
        if operation in short and operand is not None and joined(kind, kind_of(operand)) == kind:
            self._line(f"{goal} {short[operation]} {bare(text_of(operand, kind))};")
        elif text_of(value, kind) != goal:
            self._line(f"{goal} = {bare(text_of(value, kind))};")

    def _bind(
        self, name: str, value: Item, operation: str | None = None, operand: Scalar | None = None
    ) -> None:
        here = self._env.get(name)
        c_name = self._c_name(name)
        is_variable = (
            isinstance(here, Number) and not isinstance(here, Entry) and here.text == c_name
        )
        if isinstance(value, Number) or (isinstance(value, Known) and is_variable and self._held):
            if not isinstance(value, Known | Number):
                raise InputError(f"{name} is a number here and an array there")
            kind = self._kinds.get(name, kind_of(value))
            if is_variable and c_name in self._variables:
                declared = self._variables[c_name]
                wider = joined(declared, kind_of(value))
                if wider != declared:
                    raise Retyped(name, wider)
                self._written.add(c_name)
                self._write(c_name, declared, value, operation, operand)
                return
            self._declare(name, kind, value)
            return
        self._env[name] = value

    def _branched(self, node: ast.If) -> bool:
        test = self._scalar(node.test)
        if isinstance(test, Known):
            return self._statements(node.body if test.value else node.orelse)
        self._materialise([*node.body, *node.orelse], node)
        opened = len(self.lines)
        self._line(f"if ({bare(test.text)}) {{")
        ends = self._block(node.body)
        also = False
        if node.orelse:
            self._line("} else {")
            also = self._block(node.orelse)
        written = len(self.lines) - opened - (2 if node.orelse else 1)
        if written == 0:
            del self.lines[opened:]  # neither branch does anything
            return False
        self._line("}")
        return ends and also

    def _block(self, body: Sequence[ast.stmt]) -> bool:
        """Write statements that run as the code decides: what they bind anew ends with them."""
        env, variables = dict(self._env), dict(self._variables)
        self._depth += 1
        self._held += 1
        ends = self._statements(body)
        self._held -= 1
        self._depth -= 1
        self._env, self._variables = env, variables
        return ends

    def _materialise(self, body: Sequence[ast.stmt], whole: ast.stmt) -> None:
        """Give variables to names that a block which may run or not assigns."""
        for name in sorted(assigned_names(body)):
            here = self._env.get(name)
            if isinstance(here, Known) and isinstance(here.value, bool | int | float):
                self._declare(name, self._kinds.get(name, kind_of(here)), here)
            elif isinstance(here, Number) and here.text != self._c_name(name):
                self._declare(name, self._kinds.get(name, here.kind), here)
            elif here is None and self._read_after(name, whole):
                kind = self._kinds.get(name, "bool")
                self._declare(name, kind, None)

    def _read_after(self, name: str, whole: ast.stmt) -> bool:
        """Whether a name is read outside of a statement."""
        inside = {id(n) for n in ast.walk(whole)}
        return any(
            isinstance(n, ast.Name)
            and n.id == name
            and isinstance(n.ctx, ast.Load)
            and id(n) not in inside
            for n in ast.walk(self._source.tree)
        )

    def _looped(self, node: ast.For) -> bool:
        if node.orelse:
            raise InputError("a loop with an else has no C")
        turns = self._turns(node.iter)
        if isinstance(turns, list):  # known items, one after the other
            if len(turns) > 1 and is_left(node.body):
                raise InputError("a loop over a tuple that is left early has no C")
            body = straight(node.body)
            for item in turns:
                self._store(node.target, item)
                if self._statements(body):
                    return True
            return False
        start, stop, step, items = turns
        self._materialise(node.body, node)
        target = node.target
        counter: ast.expr = target
        if items is not None:
            assert isinstance(target, ast.Tuple)
            counter = target.elts[0]
        if not isinstance(counter, ast.Name):
            raise InputError(f"a loop over {ast.unparse(node.target)} has no C")
        kept, variables = self._env.get(counter.id), dict(self._variables)
        name = self._c_name(counter.id) if counter.id != "_" else self._fresh("turn")
        if name in self._variables:
            name = self._fresh(counter.id)
        self._variables[name] = "int"
        self._env[counter.id] = Number(name, "int")
        sign, move = ("<", f"++{name}") if step == 1 else (">", f"--{name}")
        if abs(step) != 1:
            sign, move = ("<", f"{name} += {step}") if step > 0 else (">", f"{name} -= {-step}")
        self._line(f"for (int32_t {name} = {start}; {name} {sign} {stop}; {move}) {{")
        if items is not None:
            assert isinstance(target, ast.Tuple)
            assert isinstance(target.elts[1], ast.Name)
            self._env[target.elts[1].id] = self._read(items.fixed(0, Number(name, "int")))
        self._block(node.body)
        self._line("}")
        self._variables = variables
        if kept is None:
            self._env.pop(counter.id, None)
        else:
            self._env[counter.id] = kept
        return False

    def _turns(self, node: ast.expr) -> list[Item] | tuple[str, str, int, View | None]:
        """Return the range of a loop: known items, or first, last and step in C."""
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id == "range":
                return self._range([self._scalar(each) for each in node.args])
            if node.func.id == "enumerate":
                over = self._expression(node.args[0])
                if isinstance(over, View):
                    if over.shape[0] == 1:
                        return [(Known(0), self._read(over.fixed(0, Known(0))))]
                    return "0", str(over.shape[0]), 1, over
                return [(Known(k), Known(each)) for k, each in enumerate(tuple_of(over))]
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "np.flatnonzero":
            flags = self._expression(node.args[0])
            if isinstance(flags, View) and flags.size == 1:  # one turn where the one flag is set
                flag = self._read(flags.fixed(0, Known(0)))
                assert isinstance(flag, Number)
                return "0", f"({flag.text} ? 1 : 0)", 1, None
        over = self._expression(node)
        if isinstance(over, Known):
            return [Known(each) for each in tuple_of(over)]
        raise InputError(f"a loop over {ast.unparse(node)!r} has no C")

    def _range(self, limits: Sequence[Scalar]) -> list[Item] | tuple[str, str, int, View | None]:
        start: Scalar = limits[0] if len(limits) > 1 else Known(0)
        stop = limits[1] if len(limits) > 1 else limits[0]
        step = limits[2] if len(limits) > 2 else Known(1)
        if not isinstance(step, Known) or not isinstance(step.value, int):
            raise InputError("a range with a step known only as it runs has no C")
        if isinstance(start, Known) and isinstance(stop, Known):
            turns = range(int(start.value), int(stop.value), step.value)
            if len(turns) <= 1:
                return [Known(k) for k in turns]
        if isinstance(stop, Number) and not is_simple(stop.text):
            stop = self._kept(stop)
        return bare(text_of(start, "int")), bare(text_of(stop, "int")), step.value, None

    def _repeated(self, node: ast.While) -> None:
        self._materialise(node.body, node)
        before = len(self.lines)
        test = self._scalar(node.test)
        if len(self.lines) != before:
            raise InputError(
                f"the condition {ast.unparse(node.test)!r} needs statements of its own"
            )
        if isinstance(test, Known):
            raise InputError("a loop without a condition has no C")
        self._line(f"while ({bare(test.text)}) {{")
        self._block(node.body)
        self._line("}")

    def _returned(self, node: ast.Return) -> None:
        if node.value is None:
            self._line("return;")
            return
        value = self._expression(node.value)
        if isinstance(value, View):
            if self._out is None or value.root != "out":
                raise InputError("an array is returned that the kernel does not make")
            self.returns = Block("out", value.shape, value.kind)
            return
        if not isinstance(value, Known | Number):
            raise InputError("what is returned has no C")
        kind = self._kinds.get("return", kind_of(value))
        if self.returns is not None and self.returns != kind:
            assert not isinstance(self.returns, Block)
            raise Retyped("return", joined(kind, self.returns))
        self.returns = kind
        self._line(f"return {bare(text_of(value, kind))};")


def _mentions(text: str, goal: str) -> bool:
    if "[" in goal or goal == "\0":
        return goal in text
    return re.search(rf"\b{re.escape(goal)}\b", text) is not None
