"""`dataset.toml`: what a folder says about its records."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from rdpi_gym.measurement.options import check_columns, check_skip, check_units
from rdpi_gym.measurement.quantities import SIDES
from rdpi_gym.measurement.record import Role
from rdpi_gym.measurement.text import read_lines
from rdpi_gym.support.checks import unknown_name
from rdpi_gym.support.documents import Documents, at, stored
from rdpi_gym.support.errors import InputError, printable
from rdpi_gym.support.words import quoted

SETTINGS_FILE = "dataset.toml"
LARGEST = 2**20
"""Most bytes of a ``dataset.toml`` that is read."""
_BLANKS = str.maketrans("\t\r\n", "   ")
_QUANTITY_KEYS = ("name", "symbol", "unit")
_LONGEST = 30  # characters of a name or a unit


class _Toml(Documents):
    """Reader that refuses unknown keys; the bounds of numbers are those of their fields."""

    strict = True

    def read_value(self, kind: type, document: Any, source: str) -> Any:
        if kind is float and document in (-math.inf, math.inf):  # an open stretch
            return document
        return super().read_value(kind, document, source)


_TOML = _Toml()


class Line(str):
    """Text on one line, without control characters."""

    __slots__ = ()

    @classmethod
    def from_dict(cls, document: Any, source: str) -> Line:
        """Read a text; tabs and ends of lines become blanks."""
        value = _TOML.read(str, document, source)
        text = value.translate(_BLANKS)
        if printable(text) != text:
            raise InputError(f"{source} is {quoted(value)}; give text without control characters")
        return cls(text)


_NO_TEXT = Line()


@dataclass(frozen=True)
class RecordSettings:
    """Settings of one record in ``dataset.toml``."""

    role: Role | None = None  # by default by its name
    # Seconds at its start that are simulated and left out of the error, or None: as the folder
    # says
    skip_s: float | None = None
    # Stretches (s, from and to) left out of the error, still simulated
    mask_s: tuple[tuple[float, float], ...] = ()
    # Sampling time (s) where its file has no time column, or times that are rounded
    ts_s: float | None = None
    note: Line = _NO_TEXT  # the experimenter's
    # Of its file, where they differ from those of the folder
    columns: Mapping[str, str | int] = field(default_factory=dict)
    units: Mapping[str, Line] = field(default_factory=dict)
    # Between the values of its file; by default it is found
    separator: Literal["", "comma", "semicolon", "tab", "blanks"] = ""

    def __post_init__(self) -> None:
        check_skip(self.skip_s, "skip_s")
        if self.ts_s is not None and not 0.0 < self.ts_s < math.inf:
            raise InputError(f"ts_s is {self.ts_s:g}; give seconds above 0, as in ts_s = 5e-3")
        for start, end in self.mask_s:
            if not start < end:
                raise InputError(
                    f"mask_s has the stretch {start:g} to {end:g} s; give stretches from and to in "
                    "seconds, as in [[36.9, 37.5]]"
                )
        check_columns(self.columns, "columns")
        check_units(self.units, "units")


@dataclass(frozen=True)
class Settings:
    """Settings of a folder in ``dataset.toml``."""

    title: Line = _NO_TEXT  # of the data set
    # Seconds at the start of each record that are simulated and left out of the error
    skip_s: float = 0.0
    # As `DataOptions` has them
    columns: Mapping[str, str | int] = field(default_factory=dict)
    units: Mapping[str, Line] = field(default_factory=dict)
    # Names of the columns that are inputs, where a file has several: a list among the columns
    inputs: tuple[str, ...] = field(default=(), metadata=stored(omitted=True))
    # Name, symbol and unit of ``input`` and ``output``, as far as they are said
    quantities: Mapping[str, Mapping[str, Line]] = field(default_factory=dict)
    # Single records, by name
    records: Mapping[str, RecordSettings] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_skip(self.skip_s, "skip_s")
        check_columns(self.columns, "columns")
        check_units(self.units, "units")
        _refuse_unknown("quantities", self.quantities, SIDES)
        named = {
            s: {k: Line(t.strip()) for k, t in own.items()} for s, own in self.quantities.items()
        }
        object.__setattr__(self, "quantities", named)
        for side, texts in self.quantities.items():
            _refuse_unknown(f"quantities.{side}", texts, _QUANTITY_KEYS)
            for key, text in texts.items():
                if not 0 < len(text) <= _LONGEST:
                    raise InputError(
                        f"quantities.{side}.{key} is {quoted(text)}; give 1 to {_LONGEST} characters"
                    )

    def of(self, record: str) -> RecordSettings:
        """Return what is said about a record, by the name of its file without ending."""
        return self.records.get(record, RecordSettings())


def read_settings(path: Path, record_names: Iterable[str]) -> Settings:
    r"""Read a ``dataset.toml``."""
    return parse_settings("\n".join(read_lines(path, LARGEST)), str(path), record_names)


def parse_settings(text: str, path: str, record_names: Iterable[str] | None = None) -> Settings:
    """Parse the text of a ``dataset.toml``; see :func:`read_settings`."""
    try:
        document = tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{path}: not TOML that is read: it is nested too deep") from None
    except ValueError as error:  # of TOML, and of whole numbers with thousands of digits
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: not TOML: {str(error)[:150]}") from None
    inputs: tuple[str, ...] = ()
    columns = document.get("columns")
    if isinstance(columns, dict) and "inputs" in columns:
        listed = columns.pop("inputs")
        names = listed if isinstance(listed, list) else [listed]
        inputs = _TOML.read(tuple[str, ...], names, at(path, "columns.inputs"))
        if len(set(inputs)) < len(inputs) or "" in inputs:
            raise InputError(
                f'{path}: columns.inputs is {quoted(listed)}; give different names, as in inputs = ["u1", "u2"]'
            )
    found = _TOML.read_fields(Settings, document, path, {"inputs": inputs})
    if record_names is not None:
        _refuse_unknown(f"{path}: records", found.records, record_names)
    return found


def _refuse_unknown(where: str, table: Mapping[str, Any], known: Iterable[str]) -> None:
    names = list(known)
    for key in table:
        if key not in names:
            raise unknown_name(where, key, names)
