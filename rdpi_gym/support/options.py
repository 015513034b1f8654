"""Options of a task, written once: a frozen dataclass that commands and functions take over.

The field's name, default and type are the keyword's; its paragraph in the class's docstring is the
help of the command's option; its metadata are how the option is written.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import Field, dataclass, field, fields
from typing import Any, Concatenate, ParamSpec, TypeVar, overload

A = TypeVar("A")
B = TypeVar("B")
O = TypeVar("O")  # noqa: E741
P = ParamSpec("P")
R = TypeVar("R")

_KEY = "option"


@dataclass(frozen=True)
class Option:
    """Form of one field of the options on the command line."""

    flag: str  # For example ``--sampling-time``
    metavar: str | None = None  # Value in the help; by default the type's name
    type: Any = str  # Type that the command line reads: ``str``, ``int``, ``float``, ``list[str]``
    # Turns what was read into the field's value; by default it is the value
    read: Callable[[Any], Any] | None = None

    @property
    def metadata(self) -> Mapping[str, Any]:
        """Metadata of the dataclass's field."""
        return {_KEY: self}

    @property
    def optional(self) -> Any:
        """Field of a dataclass that is None where the option is not given."""
        return field(default=None, metadata=self.metadata)


def option_of(field: Field[Any]) -> Option | None:
    """Return how a command writes a field; None where it does not."""
    found = field.metadata.get(_KEY)
    return found if isinstance(found, Option) else None


def entries(docstring: str | None) -> dict[str, tuple[str, str]]:
    """Form and meaning that a docstring states of each parameter, without marks of code."""
    text = inspect.cleandoc(docstring or "")
    section = re.search(r"^Parameters\n-+\n(.*?)(?=^\w+\n-+$|\Z)", text, re.DOTALL | re.MULTILINE)
    found: dict[str, tuple[str, str]] = {}
    if section is None:
        return found
    for entry in re.split(r"^(?=\S)", section[1], flags=re.MULTILINE):
        head, _, paragraph = entry.partition("\n")
        names, _, form = head.partition(" : ")
        plain = " ".join(paragraph.replace("`", "").split())
        found |= {name.strip(): (form, plain) for name in names.split(",") if name.strip()}
    return found


@overload
def with_options(
    kind: Callable[P, O],
) -> Callable[[Callable[[A, O], R]], Callable[Concatenate[A, P], R]]: ...


@overload
def with_options(
    kind: Callable[P, O], leading: None
) -> Callable[[Callable[[A, B, O], R]], Callable[Concatenate[A, B, P], R]]: ...


def with_options(kind: Any, leading: Any = ...) -> Any:
    """Give a function the fields of a dataclass of options as keywords of its own."""

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        own = list(inspect.signature(function).parameters.values())[:-1]

        @functools.wraps(function)
        def call(*args: Any, **keywords: Any) -> Any:
            first = {p.name: keywords.pop(p.name) for p in own if p.name in keywords}
            given, rest = args[: len(own)], args[len(own) :]
            if len(given) + len(first) == len(own):
                return function(*given, **first, **{last: kind(*rest, **keywords)})
            return function(*given, **first)  # Python's own words for an argument that is missing

        last = list(inspect.signature(function).parameters)[-1]
        taken = list(inspect.signature(kind).parameters.values())
        call.__signature__ = inspect.signature(function).replace(  # type: ignore[attr-defined]
            parameters=[*own, *taken]
        )
        return call

    return decorate


def option_fields(kind: type) -> list[tuple[Field[Any], Option, str]]:
    """Return the fields of a dataclass that a command has: field, option, help."""
    told: dict[str, tuple[str, str]] = {}
    for base in reversed(kind.__mro__):
        told |= entries(base.__doc__)
    found = [(field, option_of(field)) for field in fields(kind)]
    return [(field, option, told[field.name][1]) for field, option in found if option is not None]
