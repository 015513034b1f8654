"""A kernel's source: its syntax tree, and what can be read off it before it is translated."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from rdpi_gym.support.errors import InputError


@dataclass(frozen=True)
class Source:
    """A kernel's syntax tree, and where it stands.

    Parameters
    ----------
    name, place
        Of the function; with its file.
    parameters
        Their names.
    tree
        The function.
    names
        Its globals.
    first_line
        Of the function in its file.
    """

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
