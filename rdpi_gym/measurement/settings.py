"""`dataset.toml`: what a folder says about its records."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rdpi_gym.measurement.options import check_columns, check_skip, unit_factor, unknown_name
from rdpi_gym.measurement.quantities import SIDES
from rdpi_gym.measurement.record import ROLES, Role
from rdpi_gym.measurement.text import SEPARATORS, read_lines
from rdpi_gym.support.errors import InputError, printable
from rdpi_gym.support.words import quoted

SETTINGS_FILE = "dataset.toml"
LARGEST = 2**20
"""Most bytes of a ``dataset.toml`` that is read."""
_BLANKS = str.maketrans("\t\r\n", "   ")
_KEYS = ("title", "skip_s", "columns", "units", "quantities", "records")
_QUANTITY_KEYS = ("name", "symbol", "unit")
_LONGEST = 30  # characters of a name or a unit
_RECORD_KEYS = ("role", "skip_s", "mask_s", "ts_s", "note", "columns", "units", "separator")


@dataclass(frozen=True)
class RecordSettings:
    """Settings of one record in ``dataset.toml``."""

    role: Role | None = None  # ``train``, ``validation``, ``test``, or None: by its name
    # Seconds at its start that are simulated and left out of the error, or None: as the folder
    # says
    skip_s: float | None = None
    # Stretches (s, from and to) left out of the error, still simulated
    mask_s: tuple[tuple[float, float], ...] = ()
    # Sampling time (s) where its file has no time column, or times that are rounded
    ts_s: float | None = None
    note: str = ""  # What the experimenter wrote about it
    # Of its file, where they differ from those of the folder
    columns: Mapping[str, str | int] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    # Between the values of its file, one of `rdpi_gym.measurement.text.SEPARATORS`; by default it
    # is found
    separator: str = ""


@dataclass(frozen=True)
class Settings:
    """Settings of a folder in ``dataset.toml``."""

    title: str = ""  # What the data set is
    # Seconds at the start of each record that are simulated and left out of the error
    skip_s: float = 0.0
    # As `DataOptions` has them
    columns: Mapping[str, str | int] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    inputs: tuple[str, ...] = ()  # Names of the columns that are inputs, where a file has several
    # Name, symbol and unit of ``input`` and ``output``, as far as they are said
    quantities: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    # What it says about single records, by name
    records: Mapping[str, RecordSettings] = field(default_factory=dict)

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
    _refuse_unknown(path, document, _KEYS)
    where = f"{path}, [columns]"
    columns = _table(document, "columns", path)
    inputs = _inputs(columns, where)
    check_columns(columns, where)
    records = _table(document, "records", path)
    _refuse_unknown(
        f"{path}, [records]", records, records if record_names is None else record_names
    )
    return Settings(
        title=_text(document, "title", path),
        skip_s=_skip(document, path) or 0.0,
        columns=columns,
        units=_units(_table(document, "units", path), f"{path}, [units]"),
        inputs=inputs,
        quantities=_quantities(_table(document, "quantities", path), f"{path}, [quantities]"),
        records={
            name: _record(_table(records, name, f"{path}, [records]"), f"{path}, [records.{name}]")
            for name in records
        },
    )


def _units(table: Mapping[str, Any], where: str) -> dict[str, str]:
    units = {column: _text(table, column, where) for column in table}
    for column, unit in units.items():
        unit_factor(column, unit, where)
    return units


def _inputs(columns: dict[str, Any], where: str) -> tuple[str, ...]:
    """Take the list of inputs out of the columns."""
    listed = columns.pop("inputs", [])
    names = listed if isinstance(listed, list) else [listed]
    if len(set(map(str, names))) != len(names) or not all(n and type(n) is str for n in names):
        raise InputError(
            f'{where}: inputs = {quoted(listed)}; give different names, as in inputs = ["u1", "u2"]'
        )
    return tuple(names)


def _quantities(sides: dict[str, Any], where: str) -> dict[str, dict[str, str]]:
    _refuse_unknown(where, sides, SIDES)
    found: dict[str, dict[str, str]] = {}
    for side, entry in sides.items():
        if not isinstance(entry, dict):
            raise InputError(
                f"{where}: {side} = {quoted(entry)}; give a table, as in "
                f'{side} = {{ name = "force", symbol = "F", unit = "kN" }}'
            )
        _refuse_unknown(f"{where}, {side}", entry, _QUANTITY_KEYS)
        found[side] = {key: _text(entry, key, f"{where}, {side}").strip() for key in entry}
        for key, text in found[side].items():
            if not 0 < len(text) <= _LONGEST:
                raise InputError(
                    f"{where}, {side}: {key} = {quoted(text)}; give 1 to {_LONGEST} characters"
                )
    return found


def _record(entry: Mapping[str, Any], where: str) -> RecordSettings:
    _refuse_unknown(where, entry, _RECORD_KEYS)
    role = entry.get("role")
    if role is not None and role not in ROLES:
        raise InputError(f"{where}: role = {quoted(role)}; give {', '.join(ROLES)}")
    stretches = entry.get("mask_s", [])
    pairs = stretches if isinstance(stretches, list) else [stretches]
    for pair in pairs:
        is_pair = isinstance(pair, list) and len(pair) == 2 and all(map(_is_number, pair))
        if not is_pair or not pair[0] < pair[1]:
            raise InputError(
                f"{where}: mask_s = {quoted(stretches)}; give stretches from and to in seconds, "
                "as in [[36.9, 37.5]]"
            )
    columns = _table(entry, "columns", where)
    check_columns(columns, f"{where} columns")
    separator = entry.get("separator", "")
    if separator not in ("", *SEPARATORS):
        raise InputError(f"{where}: separator = {quoted(separator)}; give {', '.join(SEPARATORS)}")
    return RecordSettings(
        role=role,
        skip_s=_skip(entry, where),
        mask_s=tuple((float(start), float(end)) for start, end in pairs),
        ts_s=_sampling_time(entry, where),
        note=_text(entry, "note", where),
        columns=columns,
        units=_units(_table(entry, "units", where), f"{where} units"),
        separator=separator,
    )


def _refuse_unknown(where: str, table: Mapping[str, Any], known: Iterable[str]) -> None:
    names = list(known)
    for key in table:
        if key not in names:
            raise unknown_name(where, key, names)


def _table(document: Mapping[str, Any], key: str, where: str) -> dict[str, Any]:
    value = document.get(key, {})
    if not isinstance(value, dict):
        raise InputError(f"{where}: {key} = {quoted(value)}; give a table, [{key}]")
    return value


def _text(document: Mapping[str, Any], key: str, where: str) -> str:
    value = document.get(key, "")
    text = value.translate(_BLANKS) if isinstance(value, str) else None
    if text is None or printable(text) != text:
        raise InputError(f'{where}: {key} = {quoted(value)}; give text, {key} = "..."')
    return text


def _is_number(value: object) -> bool:
    # TOML's whole numbers have any length
    return isinstance(value, float) or (type(value) is int and abs(value) < 2**63)


def _skip(document: Mapping[str, Any], where: str) -> float | None:
    value = document.get("skip_s")
    if value is None:
        return None
    if not _is_number(value):
        raise InputError(f"{where}: skip_s = {quoted(value)}; give seconds, as in skip_s = 1.0")
    check_skip(value, f"{where}: skip_s")
    return float(value)


def _sampling_time(document: Mapping[str, Any], where: str) -> float | None:
    value = document.get("ts_s")
    if value is None:
        return None
    if not _is_number(value) or not 0.0 < value < math.inf:
        raise InputError(
            f"{where}: ts_s = {quoted(value)}; give seconds above 0, as in ts_s = 5e-3"
        )
    return float(value)
