"""Arguments of the wrong type are refused in one line, before anything is computed."""

from __future__ import annotations

import functools
import inspect
import numbers
import os
import types
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

P = ParamSpec("P")
R = TypeVar("R")

_WORDS: dict[Any, str] = {
    bool: "True or False",
    int: "a whole number",
    float: "a number",
    str: "text",
    type(None): "None",
    os.PathLike: "a path",
}


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Check the arguments of a function against its annotations at every call.

    Parameters
    ----------
    function
        Every parameter is annotated.

    Returns
    -------
    callable
        The same; it raises :class:`InputError` for an argument of another type.

    Examples
    --------
    >>> @checked
    ... def twice(count: int) -> int:
    ...     return 2 * count
    >>> twice(2)
    4
    >>> twice(count="two")
    Traceback (most recent call last):
    ...
    rdpi_gym.support.errors.InputError: twice: count is 'two'; give a whole number
    """
    signature = inspect.signature(function)

    @functools.cache
    def hints() -> dict[str, Any]:
        return get_type_hints(function)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        for name, value in signature.bind(*args, **kwargs).arguments.items():
            many = signature.parameters[name].kind is inspect.Parameter.VAR_POSITIONAL
            for each in value if many else (value,):
                if name != "self":
                    check_type(each, hints()[name], f"{function.__name__}: {name}")
        return function(*args, **kwargs)

    return call


def check_type(value: Any, hint: Any, where: str) -> None:
    """Refuse a value that is not of the annotated type."""
    if not _fits(value, hint):
        raise InputError(f"{where} is {quoted(value)}; give {_described(hint)}")


def _fits(value: Any, hint: Any) -> bool:
    origin, parts = get_origin(hint), get_args(hint)
    if hint is Any or isinstance(hint, TypeVar):
        return True
    if origin in (Union, types.UnionType):
        return any(_fits(value, part) for part in parts)
    if origin is Literal:
        return value in parts
    if hint in (int, float):
        kind = numbers.Integral if hint is int else numbers.Real
        return isinstance(value, kind) and not isinstance(value, bool)
    if origin is type:
        return isinstance(value, type)
    if origin is None:
        return isinstance(value, hint)
    if not isinstance(value, origin):
        return False
    if issubclass(origin, Mapping):
        return all(_fits(k, parts[0]) and _fits(v, parts[1]) for k, v in value.items())
    if issubclass(origin, Sequence) and origin is not tuple:
        # a text is a sequence of texts, and never meant as one
        return not isinstance(value, str) and all(_fits(each, parts[0]) for each in value)
    return True


def _described(hint: Any) -> str:
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        words = list(dict.fromkeys(_described(part) for part in parts))
        return " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
    if origin is Literal:
        return f"one of {', '.join(map(repr, parts))}"
    kind = hint if origin is None else origin
    if kind is type:
        return "a class"
    if issubclass(kind, Mapping):
        return f"a mapping of {_described(parts[0])} to {_described(parts[1])}"
    if issubclass(kind, Sequence) and kind is not str:
        return f"a sequence of {_described(parts[0])}" if parts else "a sequence"
    if "Callable" in kind.__name__ or "__call__" in vars(kind):
        return "a function"
    if issubclass(kind, os.PathLike):
        return "a path"
    return _WORDS.get(kind, f"a {kind.__name__}")
