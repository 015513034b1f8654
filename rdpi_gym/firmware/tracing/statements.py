"""What generated code is made of: statements, forks and loops, and the names of their variables."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

LOCAL = re.compile(r"\bt\d+\b")
"""Names of local variables in the text of C."""


@dataclass(frozen=True)
class Statement:
    """Lines of C.

    Parameters
    ----------
    text
        They.
    declares
        The local variable that they declare; empty: none.
    writes
        Local variables that they may write.
    keeps
        Whether they matter beside those: memory is written, or the function returns.
    """

    text: str
    declares: str = ""
    writes: frozenset[str] = frozenset()
    keeps: bool = False

    @property
    def names(self) -> frozenset[str]:
        """Local variables in the text."""
        return frozenset(LOCAL.findall(self.text))

    def renamed(self, names: dict[str, str]) -> Statement:
        """Return it with other names of variables."""
        return Statement(
            renamed_in(self.text, names),
            names.get(self.declares, self.declares),
            frozenset(names.get(name, name) for name in self.writes),
            self.keeps,
        )


@dataclass(frozen=True)
class Fork:
    """If and else.

    Parameters
    ----------
    condition
        Text of C.
    then, otherwise
        What is done where it is true, and where it is not.
    """

    condition: str
    then: tuple[Item, ...]
    otherwise: tuple[Item, ...]

    def renamed(self, names: dict[str, str]) -> Fork:
        """Return it with other names of variables."""
        return Fork(
            renamed_in(self.condition, names),
            tuple(item.renamed(names) for item in self.then),
            tuple(item.renamed(names) for item in self.otherwise),
        )


@dataclass(frozen=True)
class Loop:
    """What is done several times, one after the other.

    Parameters
    ----------
    count
        How often.
    items
        What.
    """

    count: int
    items: tuple[Item, ...]

    def renamed(self, names: dict[str, str]) -> Loop:
        """Return it with other names of variables."""
        return Loop(self.count, tuple(item.renamed(names) for item in self.items))


Item: TypeAlias = Statement | Fork | Loop


def lines(items: Sequence[Item], indent: str = "") -> Iterator[str]:
    """Yield the lines of C."""
    for item in items:
        if isinstance(item, Statement):
            for line in item.text.splitlines():
                yield f"{indent}{line}".rstrip()
            continue
        inner = indent + "    "
        if isinstance(item, Loop):
            yield f"{indent}for (int32_t n = 0; n < {item.count}; ++n) {{"
            yield from lines(item.items, inner)
        elif not item.then:
            yield f"{indent}if (!{within(item.condition)}) {{"
            yield from lines(item.otherwise, inner)
        else:
            yield f"{indent}if ({bare(item.condition)}) {{"
            yield from lines(item.then, inner)
            if item.otherwise:
                yield f"{indent}}} else {{"
                yield from lines(item.otherwise, inner)
        yield f"{indent}}}"


_DECLARED = re.compile(r"\b(?:rdpi_real|int32_t) (t\d+)\b")


def declared(items: Sequence[Item]) -> set[str]:
    """Return the variables that code declares."""
    return {name for line in lines(items) for name in _DECLARED.findall(line)}


def renamed_in(text: str, names: dict[str, str]) -> str:
    """Return a text with other names of variables."""
    return LOCAL.sub(lambda found: names.get(found[0], found[0]), text)


def within(expression: str) -> str:
    """Return an expression as part of another one."""
    called = re.match(r"\w+(?=\()", expression)
    if re.fullmatch(r"[\w.>\[\]-]+", expression) or _enclosed(
        expression[called.end() :] if called else expression
    ):
        return expression
    return f"({expression})"


def bare(expression: str) -> str:
    """Return an expression without parentheses around all of it."""
    return expression[1:-1] if _enclosed(expression) else expression


def put(text: str, name: str, expression: str) -> str:
    """Return a text with an expression in place of a name, in parentheses where it needs them."""
    found = re.search(rf"(= |return |\(|, )?\b{name}\b(?=([;,)]?))", text)
    assert found is not None
    whole = found[1] is not None and found[2] and (found[1], found[2]) != ("= ", ")")
    put = bare(expression) if whole else expression
    return f"{text[: found.start()]}{found[1] or ''}{put}{text[found.end() :]}"


def _enclosed(expression: str) -> bool:
    if not (expression.startswith("(") and expression.endswith(")")):
        return False
    depth = 0
    for at, character in enumerate(expression):
        depth += (character == "(") - (character == ")")
        if depth == 0 and at < len(expression) - 1:
            return False
    return True
