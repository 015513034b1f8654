"""Dataclasses as JSON documents and back, by their annotations.

A document names no class, no module and no function: what is built is decided by the annotations.
"""

from __future__ import annotations

import math
import types
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING, dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any, Literal, Self, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

from rdpi_gym.support.checks import described, unaliased, unknown_name
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted, some

T = TypeVar("T")
_LARGEST = 1e308  # a number of a document: neither infinite nor a whole one of 400 digits


@dataclass(frozen=True)
class Stored:
    """Form of a field in a document, where the annotation alone does not state it."""

    key: str = ""  # Its key; the name of the field by default
    # Number that a JSON null stands for; a number that is not finite is written as null then
    null: float | None = None
    # Whether the fields of its dataclass stand beside those of the one that has it
    inline: bool = False
    omitted: bool = False  # Whether it is neither written nor read: given, or its default


def stored(key: str = "", **form: Any) -> Mapping[str, Stored]:
    """Return the metadata of a field: ``field(metadata=stored("rmse", null=math.inf))``."""
    return {"stored": Stored(key, **form)}


class Documents:
    """Writer and reader of values; a subclass adds kinds of values, or another form of numbers.

    Dataclasses, tuples, lists, mappings with text as keys, ``Literal`` and enumerations (by their
    values), unions, numbers, text. A class with `to_dict` and ``from_dict(document, source)`` writes
    and reads itself: so does a union whose members a tag tells apart.
    """

    strict = False
    """Whether keys that are unknown, and fields that are missing, are refused."""
    has_forms = True
    """Whether fields have the form that their metadata state."""

    def write(self, value: Any, hint: Any = Any) -> Any:
        """Return a value as JSON has it."""
        if hasattr(type(value), "to_dict"):
            return value.to_dict()
        if isinstance(value, Enum):
            return value.value
        if is_dataclass(value):
            return self.write_fields(value)
        if isinstance(value, Mapping):
            return {key: self.write(each) for key, each in value.items()}
        if isinstance(value, list | tuple):
            return [self.write(each) for each in value]
        return value.tolist() if isinstance(value, np.ndarray | np.generic) else value

    def write_fields(self, value: Any) -> dict[str, Any]:
        """Return the fields of a dataclass as a JSON object."""
        document: dict[str, Any] = {}
        for name, hint, form, _ in self._fields(type(value)):
            own = getattr(value, name)
            if form.inline:
                document |= self.write(own)
            elif not form.omitted:
                lost = form.null is not None and not math.isfinite(own)
                document[form.key or name] = None if lost else self.write(own, hint)
        return document

    def read(self, hint: Any, document: Any, source: str) -> Any:
        """Return the value of an annotation that a document holds."""
        hint = unaliased(hint)
        origin, parts = get_origin(hint), get_args(hint)
        kind = origin or hint
        if hint is Any:
            return document
        if origin in (Union, types.UnionType):
            return self._read_union(parts, document, source)
        if hasattr(kind, "from_dict"):
            return kind.from_dict(document, source)
        if kind is Literal:
            _check(document in parts, document, described(hint), source)
            return document
        if issubclass(kind, Enum):
            values = [each.value for each in kind]
            _check(document in values, document, f"one of {some(map(repr, values))}", source)
            return kind(document)
        if is_dataclass(kind):
            return self.read_fields(cast(type[Any], kind), document, source)
        if issubclass(kind, Mapping):
            _check(isinstance(document, Mapping), document, "an object", source)
            return {
                parts[0](key): self.read(parts[1], each, at(source, key))
                for key, each in document.items()
            }
        if issubclass(kind, Sequence) and kind is not str:
            return self._read_sequence(kind, parts, document, source)
        return self.read_value(kind, document, source)

    def read_value(self, kind: type, document: Any, source: str) -> Any:
        """Return a number, a text or a truth value; a whole number may be written as ``3.0``."""
        fits = type(document) is kind
        if kind in (int, float):
            is_number = type(document) in (int, float) and abs(document) < _LARGEST
            fits = is_number and (kind is float or document == int(document))
        _check(fits, document, described(kind), source)
        return document if document is None else kind(document)

    def read_fields(
        self, kind: type[T], document: Any, source: str, given: Mapping[str, Any] | None = None
    ) -> T:
        """Build a dataclass from a JSON object, without asking it for the fields that are given."""
        _check(isinstance(document, Mapping), document, "an object", source)
        values = dict(given or {})
        known = self._fields(kind)
        if self.strict:
            keys = [form.key or name for name, _, form, _ in known if not form.omitted]
            for key in document:
                if key not in keys:
                    raise unknown_name(source, key, keys)
        for name, hint, form, has_default in known:
            key = form.key or name
            if name in values or form.omitted:
                continue
            if form.inline:
                values[name] = self.read(hint, document, source)
            elif key in document:
                is_null = form.null is not None and document[key] is None
                values[name] = (
                    form.null if is_null else self.read(hint, document[key], at(source, key))
                )
            elif not has_default:
                values[name] = self._read_missing(hint, at(source, key))
        try:
            return kind(**values)
        except InputError as error:
            raise InputError(f"{source}: {error}") from None

    def _fields(self, kind: type) -> Sequence[tuple[str, Any, Stored, bool]]:
        """Name, annotation, form and whether there is a default, of each field."""
        return _fields_of(kind, self.has_forms)

    def _read_missing(self, hint: Any, source: str) -> Any:
        if not self.strict and type(None) in get_args(hint):
            return None
        if not self.strict and get_origin(hint) is tuple and get_args(hint)[-1] is ...:
            return ()
        raise InputError(f"{source} is missing; expected {_expected(hint)}")

    def _read_union(self, parts: tuple[Any, ...], document: Any, source: str) -> Any:
        if type(document) in parts:
            return self.read(type(document), document, source)
        others = [part for part in parts if part is not type(None)]
        for part in others[:-1]:
            with suppress(InputError):
                return self.read(part, document, source)
        try:
            return self.read(others[-1], document, source)
        except InputError:
            expected = [_expected(part) for part in others]
            inside = isinstance(document, Mapping | list) and {"an object", "a list"} & {*expected}
            if len(others) == 1 or inside:
                raise
            raise _refusal(document, " or ".join(expected), source) from None

    def _read_sequence(
        self, kind: type, parts: tuple[Any, ...], document: Any, source: str
    ) -> Sequence[Any]:
        is_list = isinstance(document, list | tuple)
        if kind is tuple and parts[-1] is not ...:
            count = f"a list of {len(parts)}"
            _check(is_list and len(document) == len(parts), document, count, source)
        else:
            _check(is_list, document, "a list", source)
            parts = parts[:1] * len(document)
        read = [self.read(p, document[k], at(source, k)) for k, p in enumerate(parts)]
        return tuple(read) if kind is tuple else read


PLAIN = Documents()


class Document:
    """Base of a dataclass that is written to documents and read from them."""

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as a JSON object."""
        return PLAIN.write_fields(self)

    @classmethod
    def from_dict(cls, document: Any, source: str = "document") -> Self:
        """Build from the object of :meth:`to_dict`; `source` begins every error.

        Raises
        ------
        InputError
            A field is missing, or has another type than it must.
        """
        return PLAIN.read_fields(cls, document, source)


class _Place(str):
    """A place in a document: where the document stands, a colon, a path."""

    __slots__ = ()


def at(source: str, step: str | int) -> str:
    """Return the place of a key or an item within a place.

    Examples
    --------
    >>> at(at(at("model.json", "effects"), 0), "tau_s")
    'model.json: effects[0].tau_s'
    """
    inside = isinstance(source, _Place)
    if isinstance(step, int):
        return _Place(f"{source}{'' if inside else ': '}[{step}]")
    return _Place(f"{source}{'.' if inside else ': '}{step}")


@cache
def _fields_of(kind: type, has_forms: bool) -> Sequence[tuple[str, Any, Stored, bool]]:
    hints, plain = get_type_hints(kind), Stored()
    return tuple(
        (
            f.name,
            hints[f.name],
            f.metadata.get("stored", plain) if has_forms else plain,
            f.default is not MISSING or f.default_factory is not MISSING,
        )
        for f in fields(cast(Any, kind))
    )


def _check(fits: bool, value: Any, expected: str, source: str) -> None:
    if not fits:
        raise _refusal(value, expected, source)


def _refusal(value: Any, expected: str, source: str) -> InputError:
    return InputError(f"{source} is {quoted(value)}; expected {expected}")


def _expected(hint: Any) -> str:
    """Describe what a document has to hold."""
    kind = get_origin(hint) or hint
    if is_dataclass(kind) or hasattr(kind, "from_dict"):
        return "an object"
    return "a list" if kind in (tuple, list, Sequence) else described(hint)
