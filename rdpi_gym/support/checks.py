"""Values that a caller hands in: what is a number, and how an error shows what it is not."""

from __future__ import annotations

import functools
import inspect
import math
import numbers
import os
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import guess, quoted, some


def is_finite(value: object) -> bool:
    """Say whether a value is a finite real number that a float can hold; text and bool are none.

    Examples
    --------
    >>> is_finite(1), is_finite(float("nan")), is_finite("1"), is_finite(True), is_finite(10**400)
    (True, False, False, False, False)
    """
    if type(value) is float:
        return math.isfinite(value)
    if not isinstance(value, int | float | np.integer | np.floating) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number that no float holds
        return False


def is_whole(value: object, minimum: float) -> bool:
    """Say whether a value is a whole number of at least `minimum`; bool is none.

    Examples
    --------
    >>> is_whole(3, 0), is_whole(3, 4), is_whole(3.0, 0), is_whole(True, 0)
    (True, False, False, False)
    """
    whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    return whole and value >= minimum  # type: ignore[operator]  # Integral has no order


def shape_of(value: Any) -> tuple[int, ...] | None:
    """Return the shape of an array or of nested lists; None where they are ragged."""
    try:
        shape: tuple[int, ...] = np.shape(value)
    except ValueError:
        return None
    return shape


def unknown_name(where: str, name: object, known: Iterable[str]) -> InputError:
    """Return the error for a name that is not among those known, with the close match."""
    names = list(known)
    meant = guess(name, names)
    hint = f" ({meant})" if meant else ""
    return InputError(f"{where}: {quoted(name)} is unknown{hint}; known are {some(names, 24)}")


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
        raise InputError(f"{where} is {quoted(value)}; give {described(hint)}")


def unaliased(hint: Any) -> Any:
    """Return what an annotation stands for: from NumPy 2.5 on ``NDArray`` is an alias of its own."""
    meaning, parts = getattr(get_origin(hint) or hint, "__value__", None), get_args(hint)
    if meaning is None:
        return hint
    return meaning[parts] if parts else meaning


def _fits(value: Any, hint: Any) -> bool:
    hint = unaliased(hint)
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


def described(hint: Any) -> str:
    """Return what an annotation asks for, in words."""
    hint = unaliased(hint)
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        words = list(dict.fromkeys(described(part) for part in parts))
        return " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
    if origin is Literal:
        return f"one of {', '.join(map(repr, parts))}"
    kind = hint if origin is None else origin
    if kind is type:
        return "a class"
    if issubclass(kind, Mapping):
        return f"a mapping of {described(parts[0])} to {described(parts[1])}"
    if issubclass(kind, Sequence) and kind is not str:
        return f"a sequence of {described(parts[0])}" if parts else "a sequence"
    if "Callable" in kind.__name__ or "__call__" in vars(kind):
        return "a function"
    if issubclass(kind, os.PathLike):
        return "a path"
    return _WORDS.get(kind, f"a {kind.__name__}")
