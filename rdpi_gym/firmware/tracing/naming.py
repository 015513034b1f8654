"""Names of variables in generated code: what the traced code itself calls the number that it computes."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import FrameType
from typing import TypeAlias

from rdpi_gym.firmware.translation.scope import RESERVED

_TRACERS = (
    "/rdpi_gym/firmware/tracing/", "/rdpi_gym/firmware/translation/", "/numpy/", "/numba/", "/torch/",
)  # fmt: skip
_LONGEST = 30  # letters
_UNNAMED = "value"
# Of every function that is traced, and what loops count with.
_TAKEN = {"p", "m", "reference_um", "ahead_um", "measured_um", "applied_V", "i", "j", "k", "n"}
_OPERATIONS: Mapping[type[ast.AST], str] = {
    ast.Add: "sum", ast.Sub: "difference", ast.Mult: "product", ast.MatMult: "product",
    ast.Div: "quotient", ast.Pow: "power", ast.BitAnd: "both", ast.BitOr: "either",
    ast.USub: "negative", ast.Invert: "opposite", ast.Compare: "test",
}  # fmt: skip
_Span: TypeAlias = tuple[int | None, int | None, int | None, int | None]


@cache
def _traces(path: str) -> bool:
    name = path.replace("\\", "/")
    return any(part in name for part in _TRACERS)


@dataclass
class _Code:
    """Expressions of a file by their place, and the name of what each is assigned to."""

    nodes: dict[_Span, ast.expr] = field(default_factory=dict)
    goals: dict[_Span, str] = field(default_factory=dict)
    wholes: set[_Span] = field(default_factory=set)  # those that are all that is assigned
    lines: dict[int, str] = field(default_factory=dict)


@cache
def _read(path: str) -> _Code:
    code = _Code()
    try:
        tree = ast.parse(Path(path).read_text(encoding="utf-8"))
    except (OSError, SyntaxError, UnicodeDecodeError):
        return code
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            for goal, value in _assigned(function):
                code.wholes.add(_span(value))
                for node in ast.walk(value):
                    if isinstance(node, ast.expr):
                        code.nodes[_span(node)] = node
                        code.goals[_span(node)] = goal
                for line in range(value.lineno, (value.end_lineno or value.lineno) + 1):
                    code.lines[line] = goal
    return code


def _assigned(function: ast.FunctionDef) -> Iterator[tuple[str, ast.expr]]:
    """Yield each value of a function that gets a name, and that name; a call alone gets none."""
    for node in ast.walk(function):
        if isinstance(node, ast.Assign):
            target, values = node.targets[0], [node.value]
            targets: list[ast.expr] = [target]
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                targets, values = target.elts, node.value.elts
            yield from ((_goal(each), value) for each, value in zip(targets, values, strict=True))
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            yield _goal(node.target), node.value
        elif isinstance(node, ast.AugAssign):
            yield f"{_goal(node.target)}_change".lstrip("_"), node.value
        elif isinstance(node, ast.Return) and node.value is not None:
            yield function.name, node.value
        elif isinstance(node, ast.Expr):
            yield "", node.value


def _goal(target: ast.expr) -> str:
    while isinstance(target, ast.Subscript):
        target = target.value
    if isinstance(target, ast.Attribute):
        return target.attr
    return target.id if isinstance(target, ast.Name) else ""


def _span(node: ast.expr) -> _Span:
    return node.lineno, node.end_lineno, node.col_offset, node.end_col_offset


def wish(argument: int | None = None, otherwise: str = "") -> str:
    """Return the name of what the traced code computes now; or what an argument of its call is named.

    Nothing where it has none.
    """
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and _traces(frame.f_code.co_filename):
        frame = frame.f_back
    if frame is None:
        return otherwise
    code = _read(frame.f_code.co_filename)
    span = _positions(frame)
    node = code.nodes.get(span)
    if argument is not None:
        given = node.args if isinstance(node, ast.Call) else []
        first = given[argument] if argument < len(given) else None
        is_plain = isinstance(first, ast.Name) and not any(
            isinstance(each, ast.Starred) for each in given
        )
        return first.id if is_plain and isinstance(first, ast.Name) else otherwise
    goal = code.goals.get(span, code.lines.get(frame.f_lineno, ""))
    if node is None or span in code.wholes:
        return goal
    return "_".join(filter(None, (goal, _operation(node))))


def _positions(frame: FrameType) -> _Span:
    for k, found in enumerate(frame.f_code.co_positions()):
        if 2 * k == frame.f_lasti:
            return found
    return None, None, None, None


def _operation(node: ast.expr) -> str:
    if isinstance(node, ast.Call):
        function = node.func
        if isinstance(function, ast.Attribute):
            return function.attr
        return function.id if isinstance(function, ast.Name) else ""
    kind = type(node.op) if isinstance(node, ast.BinOp | ast.UnaryOp) else type(node)
    return _OPERATIONS.get(kind, "")


def identifier(name: str) -> str:
    """Return what a variable can be called that is wished to be called so; nothing where none can."""
    plain = re.sub(r"\W", "", name.lstrip("_"), flags=re.ASCII)[:_LONGEST].rstrip("_")
    plain = re.sub("__+", "_", plain)
    return plain if re.fullmatch(r"[A-Za-z]\w*", plain) else ""


def chosen(wishes: Mapping[str, str], used: Iterable[str]) -> dict[str, str]:
    """Return a name for each variable: that which it is wished, numbered where it is taken."""
    taken = {*used, *_TAKEN, *RESERVED}
    names = {}
    for variable, wished in wishes.items():
        base = name = wished or _UNNAMED
        count = 1
        while name in taken:
            count += 1
            name = f"{base}_{count}"
        taken.add(name)
        names[variable] = name
    return names
