"""Fields of a JSON object that somebody may have edited: each has the type it must, or is named."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted


class Fields:
    """A JSON object whose fields are asked for by type.

    Parameters
    ----------
    document
        The object.
    source
        Where it stands; begins every error.

    Raises
    ------
    InputError
        It is no object; a field that is asked for is missing or of another type.

    Examples
    --------
    >>> fields = Fields({"noise": 0.012, "notes": ["a", "b"]}, "found.json")
    >>> fields.number("noise"), fields.texts("notes")
    (0.012, ('a', 'b'))
    >>> fields.text("verdict")
    Traceback (most recent call last):
    ...
    rdpi_gym.support.errors.InputError: found.json: "verdict" is missing; expected a text
    """

    def __init__(self, document: Any, source: str) -> None:
        if not isinstance(document, Mapping):
            raise InputError(f"{source} is {quoted(document)}; expected an object")
        self.document = document
        self.source = source

    def raw(self, key: str) -> Any:
        """Return a field as it is, or None."""
        return self.document.get(key)

    def number(self, key: str, null: float | None = None) -> float:
        """Return a number; `null`, where it is given, stands for a JSON null."""
        if null is not None and key in self.document and self.document[key] is None:
            return null
        return float(self._checked(key, self.raw(key), "a number", _is_number))

    def optional_number(self, key: str) -> float | None:
        """Return a number, or None for a JSON null and for a key that is not there."""
        return None if self.raw(key) is None else self.number(key)

    def text(self, key: str) -> str:
        """Return a text."""
        return str(self._checked(key, self.raw(key), "a text", _is_text))

    def optional_text(self, key: str) -> str | None:
        """Return a text, or None for a JSON null and for a key that is not there."""
        return None if self.raw(key) is None else self.text(key)

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of texts; an empty one where the key is not there."""
        found = self._list(key)
        return tuple(str(self._checked(key, v, "a list of texts", _is_text)) for v in found)

    def groups(self, key: str) -> tuple[tuple[str, ...], ...]:
        """Return a list of lists of texts; an empty one where the key is not there."""
        return tuple(Fields({key: group}, self.source).texts(key) for group in self._list(key))

    def numbers(self, key: str) -> dict[str, float]:
        """Return an object of numbers."""
        found = self.inner(key).document.items()
        return {k: float(self._checked(key, v, "numbers", _is_number)) for k, v in found}

    def optional_numbers(self, key: str) -> dict[str, float | None]:
        """Return an object of numbers, some of which may be null."""
        inner = self.inner(key)
        return {k: None if v is None else inner.number(k) for k, v in inner.document.items()}

    def inner(self, key: str) -> Fields:
        """Return an object within the object."""
        return Fields(self.raw(key), f'{self.source}, "{key}"')

    def objects(self, key: str) -> Iterator[Fields]:
        """Give the objects of a list; none where the key is not there."""
        for i, value in enumerate(self._list(key)):
            yield Fields(value, f'{self.source}, "{key}" {i + 1}')

    def lists(self, key: str) -> Iterator[Iterator[Fields]]:
        """Give the objects of each list of a list; none where the key is not there."""
        for group in self._list(key):
            yield Fields({key: group}, self.source).objects(key)

    def _list(self, key: str) -> list[Any]:
        value = self.document.get(key, [])
        return list(self._checked(key, value, "a list", _is_list))

    def _checked(self, key: str, value: Any, expected: str, fits: Callable[[Any], bool]) -> Any:
        if not fits(value):
            found = quoted(value) if key in self.document else "missing"
            raise InputError(f'{self.source}: "{key}" is {found}; expected {expected}')
        return value


def _is_number(value: Any) -> bool:
    """Whether a value is finite and fits a float: neither NaN nor an integer of 400 digits."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e308


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_list(value: Any) -> bool:
    return isinstance(value, list)
