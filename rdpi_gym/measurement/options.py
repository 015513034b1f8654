"""Options of a data file: columns, units, sampling time, skipped start."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import get_type_hints

from rdpi_gym.measurement.units import measured_by, plain_unit, ratio
from rdpi_gym.support.checks import check_type, unknown_name
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.options import Option
from rdpi_gym.support.words import quoted, short

COLUMNS = ("t", "u", "y", "reference", "temperature", "period")
"""Names of the columns: t (s), u (V), y (µm), reference (µm), temperature (°C), period (index)."""

_LAST_POSITION = 99_999
_LONGEST_S = 1e12
_LENGTH_UM = {"m": 1e6, "mm": 1e3, "um": 1.0, "nm": 1e-3}
UNITS: Mapping[str, Mapping[str, float]] = {
    "t": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "u": {"V": 1.0, "mV": 1e-3, "kV": 1e3},
    "y": _LENGTH_UM,
    "reference": _LENGTH_UM,
    "temperature": {"C": 1.0, "degC": 1.0, "°C": 1.0},
    "period": {},
}
"""Factor to s, V, µm, °C for every unit of these that a column may have; µ may be written u."""

OTHER = "other:"
"""Begins the name of a column that is none of these: a further input, after it its own name."""
_ANY_QUANTITY = ("u", "y", "reference")


def unit_factor(column: str, unit: str, where: str, shown: str = "") -> float:
    """Give the factor from a unit of a column to s, V, µm or °C, or to the unit that it is shown in.

    A unit of u, y or reference that is neither a voltage nor a length is not converted: it becomes the
    unit of the quantity.
    """
    if column not in UNITS:
        raise unknown_name(where, column, UNITS)
    known = UNITS[column]
    plain = plain_unit(unit)
    if column in _ANY_QUANTITY and (shown or plain not in known):
        if shown:
            factor = ratio(plain, shown)
            if factor is None:
                raise InputError(
                    f"{where}: unit {quoted(unit)} of {column} is not turned into {shown}, in which "
                    "it is shown; give the same quantity in every file"
                )
            return factor
        if measured_by(plain):
            return 1.0
    if plain not in known:
        right = f"known are {', '.join(known)}" if known else f"{column} is an index without unit"
        if column in _ANY_QUANTITY:
            right += " and those of other quantities, as kN; any other stands in dataset.toml, [quantities]"
        raise InputError(f"{where}: unit {quoted(unit)} of {column} is unknown; {right}")
    return known[plain]


def check_units(units: Mapping[str, str], where: str = "--units") -> None:
    """Refuse units that a column cannot have."""
    for column, unit in units.items():
        unit_factor(column, unit, where)


def check_columns(columns: Mapping[str, str | int], where: str) -> None:
    """Refuse unknown column names, positions below 0 and a column that is named twice."""
    taken: dict[str | int, str] = {}
    for name, source in columns.items():
        if name not in COLUMNS:
            raise unknown_name(where, name, COLUMNS)
        if source == "" and name not in ("u", "y"):
            continue
        is_position = type(source) is int and 0 <= source <= _LAST_POSITION
        if not is_position and not (isinstance(source, str) and source):
            raise InputError(
                f"{where}: {name} = {quoted(source)}; give a header name or a position from 0 to {_LAST_POSITION}"
            )
        if source in taken:
            raise InputError(
                f"{where}: {taken[source]} and {name} both name column {short(str(source))}; give two columns"
            )
        taken[source] = name


def check_skip(seconds: float | None, where: str) -> None:
    """Refuse a stretch to leave out (s) that is not finite or below 0."""
    if seconds is not None and not 0.0 <= seconds <= _LONGEST_S:
        raise InputError(f"{where} is {quoted(seconds)}; give seconds, 0 or above")


def _parse_pairs(text: str, option: str, example: str) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for part in text.split(","):
        name, _, value = (piece.strip() for piece in part.partition("="))
        if not name or not value:
            raise InputError(f"{option} {text!r}: {part!r} is not NAME=VALUE; write {example}")
        if name in pairs:
            raise InputError(f"{option} {text!r}: {name} is given twice; give it once")
        pairs[name] = value
    return pairs


def parse_columns(text: str) -> dict[str, str | int]:
    """Read ``t=time,u=voltage,y=disp`` or zero-based positions, ``t=1,u=3,y=2``.

    Raises
    ------
    InputError
        Not NAME=VALUE, an unknown name, a name or column given twice.

    Examples
    --------
    >>> parse_columns("t=time,u=voltage,y=2")
    {'t': 'time', 'u': 'voltage', 'y': 2}
    """
    columns: dict[str, str | int] = {
        name: int(value) if value.isascii() and value.isdigit() and len(value) < 9 else value
        for name, value in _parse_pairs(text, "--columns", "t=time,u=voltage,y=disp").items()
    }
    check_columns(columns, "--columns")
    return columns


def parse_units(text: str) -> dict[str, str]:
    """Read ``y=m,t=ms``.

    Raises
    ------
    InputError
        Not NAME=UNIT, an unknown column or unit.

    Examples
    --------
    >>> parse_units("y=m, t=ms")
    {'y': 'm', 't': 'ms'}
    """
    units = _parse_pairs(text, "--units", "y=m,t=ms")
    check_units(units)
    return units


@dataclass(frozen=True, kw_only=True)
class DataOptions:
    """Options of DATA, before those of a ``dataset.toml``.

    Parameters
    ----------
    columns
        Header names, or zero-based positions, of t, u, y, reference, temperature, period; an empty
        name: the column is not read.
    input
        Name of the column that is the input u, where a file has several; the others are kept.
    units
        Units in the file: s, ms, us; V, mV, kV; m, mm, um, nm. By default s, V, um. A unit of another
        quantity, as y=kN, is not converted but shown.
    sampling_time_s
        Sampling time of records without time column, or whose times are rounded.
    validate
        Records for validation, as in 'run3*'; by default those named validation..., else a
        quarter of each, in blocks.
    skip_s
        At the start of each record: simulated, and left out of the error.

    Raises
    ------
    InputError
        Unknown columns or units, a sampling time that is not above 0, a skip below 0, a value of
        another type.

    Examples
    --------
    >>> DataOptions(columns=parse_columns("t=time,u=2"), units=parse_units("y=m")).columns
    {'t': 'time', 'u': 2}
    """

    columns: Mapping[str, str | int] = field(
        default_factory=dict,
        metadata=Option("--columns", "t=NAME,...", str, parse_columns).metadata,
    )
    input: str | None = field(default=None, metadata=Option("--input", "NAME").metadata)
    units: Mapping[str, str] = field(
        default_factory=dict, metadata=Option("--units", "y=UNIT,...", str, parse_units).metadata
    )
    sampling_time_s: float | None = field(
        default=None, metadata=Option("--sampling-time", "SECONDS", float).metadata
    )
    validate: str | None = field(default=None, metadata=Option("--validate", "PATTERN").metadata)
    skip_s: float | None = field(default=None, metadata=Option("--skip", "SECONDS", float).metadata)

    def __post_init__(self) -> None:
        for name, hint in get_type_hints(DataOptions).items():
            check_type(getattr(self, name), hint, name)
        check_columns(self.columns, "--columns")
        check_units(self.units)
        if self.input is not None and (not self.input or "u" in self.columns):
            raise InputError(
                f"--input {quoted(self.input)}: give the name of one column, and then no u in --columns"
            )
        ts_s = self.sampling_time_s
        if ts_s is not None and not (math.isfinite(ts_s) and ts_s > 0):
            raise InputError(f"--sampling-time is {ts_s}; give seconds above 0, for example 5e-3")
        check_skip(self.skip_s, "--skip")
