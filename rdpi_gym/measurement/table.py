"""Result of every reader: named columns, and the place of each value in the file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.measurement.options import OTHER, UNITS
from rdpi_gym.measurement.units import measured_by, plain_unit, split_name
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import short, some

REQUIRED = ("t", "u", "y")
_PLAIN = (".csv", ".txt", ".dat", ".tsv")
PACKED = ".gz"
"""Ending of a text that is compressed, behind its own."""
TEXTS = (*_PLAIN, *(plain + PACKED for plain in _PLAIN))
"""Endings of text files."""
ENDINGS = (*TEXTS, ".mat", ".npz")
"""Endings of files that may hold a record."""
READ = f"{', '.join(_PLAIN)} (each also with {PACKED}), .mat, .npz"
"""The same for a reader."""
_MEANING = {
    "t": "time in s",
    "u": "voltage in V",
    "y": "displacement in µm",
    "reference": "reference in µm",
    "temperature": "temperature in °C",
    "period": "index of the repetition",
}


def ending_of(file: Path) -> str:
    """Return the ending of a data file in small letters, ``.csv.gz`` of a compressed text."""
    ending = file.suffix.lower()
    return file.with_suffix("").suffix.lower() + ending if ending == PACKED else ending


def stem_of(file: Path) -> str:
    """Return the name of a data file without its ending: that of its record."""
    return file.name[: len(file.name) - len(ending_of(file))]


@dataclass(frozen=True)
class Table:
    """Columns of one file in the file's own units, by our names, all of one length."""

    source: Path
    columns: Mapping[str, Array]  # Values by our name (`rdpi_gym.measurement.COLUMNS`), each (N,)
    labels: Mapping[str, str]  # Names of the columns in the file, for error lines
    # (N,) line number of each row, counted from 1; None for a file without lines
    lines: NDArray[np.int64] | None = None
    remarks: tuple[str, ...] = ()  # Remarks of a reader, one sentence each
    # Name of a column in the header beside its unit, and that unit, where it carries one
    names: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    name: str = ""  # Name of the record, where it is not that of the file
    settles: bool = False  # Whether the first of its periods is there for a model to settle in

    @property
    def stem(self) -> str:
        """Name of the file without its ending."""
        return stem_of(self.source)

    @property
    def rows(self) -> int:
        """Number of samples."""
        return self.columns["u"].size

    def at(self, row: int) -> str:
        """Say where a row stands: file and line, or file and element."""
        if self.lines is None:
            return f"{self.source}, element {row} (counted from 0)"
        return f"{self.source}, line {self.lines[row]}"

    def where(self, column: str, row: int) -> str:
        """Say where a value stands: file, line (or element) and column."""
        return f"{self.at(row)}, {self.labels[column]}"


def label(kind: str, column: str, source: str | int) -> str:
    """Name a column for an error line: by the file's own name, ours behind it where it differs."""
    named = f"{kind} {short(str(source))}"
    return named if source == column else f"{named} ({column})"


def select(
    columns: Mapping[str, str | int],
    names: Sequence[str],
    time_needed: bool,
    where: str,
    kind: str,
) -> dict[str, str | int]:
    """Choose what each of our columns is read from."""
    chosen: dict[str, str | int] = {}
    numbered = _numbered(names)
    own = columns.get("u", numbered[0] if numbered else "u")
    if own in numbered:
        others = {OTHER + other: other for other in numbered if other != own}
        columns = {**others, **columns, "u": own}
    meanings = _MEANING | {name: "a further input" for name in columns if name not in _MEANING}
    for name, meaning in meanings.items():
        source = columns.get(name, name)
        if source == "":
            continue
        if isinstance(source, str) and source not in names:
            source = _with_unit(name, source, names)
        if isinstance(source, int):
            chosen[name] = source
        elif source in chosen.values():
            other = next(key for key, value in chosen.items() if value == source)
            raise InputError(
                f"{where}, {label(kind, source, source)}: read as {other}, so {name} needs a column of its own",
                f"name it with --columns {name}=...",
            )
        elif names.count(source) > 1:
            raise InputError(
                f"{where}, {label(kind, source, source)}: it is there twice; rename one"
            )
        elif source in names:
            chosen[name] = source
        elif name in columns or (name in REQUIRED and (name != "t" or time_needed)):
            source = columns.get(name, name)
            otherwise = " or give --sampling-time 5e-3" if name == "t" else ""
            raise InputError(
                f"{where}, {label(kind, name, source)}: missing ({meaning}); the file has "
                f"{some(names) or 'none'}",
                f"name it with --columns {name}=...{otherwise}",
            )
    return chosen


def _with_unit(column: str, source: str, names: Sequence[str]) -> str:
    """Return the one name of the file that is `source` and a unit; else `source`."""
    found = [name for name in names if split_name(name)[0] == source and header_unit(column, name)]
    return found[0] if len(found) == 1 else source


def header_unit(column: str, name: str) -> str:
    """Return the unit that the name of a column carries, where that column may have it."""
    _, unit = split_name(name)
    own = UNITS.get(column, UNITS["u"])
    if plain_unit(unit) in own:
        return unit
    free = column in ("u", "y", "reference") or column.startswith(OTHER)
    return unit if free and measured_by(unit) else ""


_NUMBERED = re.compile(r"u_?[0-9]{1,2}")


def _numbered(names: Sequence[str]) -> list[str]:
    """Return the inputs u1, u2, ... of a file that has no u."""
    bare = [split_name(name)[0] for name in names]
    if "u" in bare or len(bare) != len(set(bare)):
        return []
    return [name for name, base in zip(names, bare, strict=True) if _NUMBERED.fullmatch(base)]


def from_header(sources: Mapping[str, str | int]) -> tuple[dict[str, str], dict[str, str]]:
    """Return names and units of the columns whose header carries a unit."""
    said = {
        column: (split_name(source)[0], unit)
        for column, source in sources.items()
        if isinstance(source, str) and (unit := header_unit(column, source))
    }
    return {k: name for k, (name, _) in said.items()}, {k: unit for k, (_, unit) in said.items()}
