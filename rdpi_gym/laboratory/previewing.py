"""Preview of a data file: its first rows, and which columns are time, command and displacement."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from rdpi_gym.laboratory import bringing
from rdpi_gym.laboratory.session import Session
from rdpi_gym.measurement.binary import reading, stacked_tags
from rdpi_gym.measurement.loading import TEXTS
from rdpi_gym.measurement.matlab import MatlabReader
from rdpi_gym.measurement.options import UNITS
from rdpi_gym.measurement.table import REQUIRED, header_unit
from rdpi_gym.measurement.text import SEPARATORS, find_rows, is_number, read_head, split_cells
from rdpi_gym.measurement.units import plain_unit, split_name
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.npz import open_npz
from rdpi_gym.support.words import quoted, short

_HEAD_BYTES, _ROWS = 2**16, 8
_MOST_COLUMNS, _SHOWN_COLUMNS = 1000, 30
_USUAL = {"t": "s", "u": "V", "y": "µm"}
_SIDES = {"u": "input", "y": "output"}
_WORDS = {
    "t": "t time times timestamp clock sec seconds zeit temps tiempo",
    "u": "u v in command cmd input drive voltage volt volts amplifier amp control spannung eingang",
    "y": "y x out output pos position displacement disp sensor measured stroke travel weg ausgang",
}
_KNOWN = {role: frozenset(words.split()) for role, words in _WORDS.items()}


@dataclass(frozen=True)
class Column:
    """One column of a file, or one variable.

    Parameters
    ----------
    source
        What settings call it: its name, or its position where the name is none or there twice.
    name
        What a reader is shown.
    """

    source: str | int
    name: str


@dataclass(frozen=True)
class Head:
    """The beginning of a file.

    Parameters
    ----------
    columns
        What it offers.
    rows
        Its first rows of values, cell by cell; none where it is no text.
    separator
        What stands between its values, by its name; empty where it is no text.
    """

    columns: Sequence[Column]
    rows: Sequence[Sequence[str]] = ()
    separator: str = ""


def preview(session: Session, name: str, separator: str | None = None) -> dict[str, Any]:
    """Return the beginning of a data file of a session, and how it is or may be read."""
    folder = session.data_folder
    files = {file.name: file for file in bringing.all_files(folder) if not file.is_symlink()}
    if name not in session.files or name not in files:
        raise InputError(f"there is no data file {quoted(name)} in this session")
    file = files[name]
    own, document = bringing.record_settings(folder, file.stem), bringing.settings_of(folder)
    if separator is None:
        separator = str(own.get("separator", ""))
    if separator and separator not in SEPARATORS:
        raise InputError(f"separator {quoted(separator)}; give {', '.join(SEPARATORS)}")
    is_refused = session.files[name]["problem"] is not None
    with MatlabReader() as matlab:
        try:
            head = _head(file, separator, matlab)
        except InputError as error:
            raise InputError(error.fact.replace(f"{file.parent}/", "")) from error
        alike = [
            other.stem
            for other_name, entry in session.files.items()
            if other_name != name
            and (other := files.get(other_name)) is not None
            and other.suffix.lower() == file.suffix.lower()
            and (entry["problem"] is not None) == is_refused
            and _has(head.columns, other, separator, matlab)
        ]
    stated = {**document.get("columns", {}), **own.get("columns", {})}
    chosen = guess_columns(head, stated)
    units = _units(head, chosen, {**document.get("units", {}), **own.get("units", {})})
    for role, side in _SIDES.items():
        if side in document.get("quantities", {}) and units[role] == _USUAL[role]:
            units[role] = ""
    return {
        "record": file.stem,
        "columns": [
            {"source": c.source, "name": short(c.name), "unit": split_name(c.name)[1]}
            for c in head.columns[:_MOST_COLUMNS]
        ],
        "rows": [[short(cell) for cell in row[:_SHOWN_COLUMNS]] for row in head.rows],
        "separator": {"chosen": separator, "found": head.separator} if head.separator else None,
        "chosen": chosen,
        "units": units,
        "ts_s": own.get("ts_s"),
        "alike": alike,
    }


def guess_columns(head: Head, stated: Mapping[str, Any]) -> dict[str, str | int]:
    """Guess which columns are time, command and displacement."""
    columns = {column.source: column for column in head.columns}
    positions = dict(enumerate(columns))
    found: dict[str, str | int] = {}
    for role in REQUIRED:
        source = stated.get(role)
        source = positions.get(source) if isinstance(source, int) else source
        if not isinstance(source, str | int) or source in found.values():
            continue
        if source in columns or (role, source) == ("t", ""):
            found[role] = source
    scores = sorted(
        (-_likeness(role, column.name), k, role)
        for k, column in enumerate(head.columns)
        for role in REQUIRED
    )
    for score, k, role in scores:
        source = head.columns[k].source
        if score < 0 and role not in found and source not in found.values():
            found[role] = source
    rest = [source for source in columns if source not in found.values()]
    if not found and len(rest) > 2 and _increases([row[0] for row in head.rows if row]):
        found["t"] = rest.pop(0)
    found.setdefault("t", "")
    for role in ("u", "y"):
        if role not in found and columns:
            found[role] = rest.pop(0) if rest else list(columns)[-1]
    return {role: found[role] for role in REQUIRED if role in found}


def _likeness(role: str, name: str) -> int:
    bare, unit = split_name(name)
    parted = re.sub("(?<=[a-z])(?=[A-Z])", " ", bare).lower()
    words = set(re.findall(r"[^\W\d_]+", parted))
    others = sum(len(words & known) for other, known in _KNOWN.items() if other != role)
    own = 2 * len(words & _KNOWN[role]) + 4 * (bare == role)
    return own - others + 3 * (plain_unit(unit) in UNITS[role])


def _increases(cells: Sequence[str]) -> bool:
    values = [float(cell.replace(",", ".")) for cell in cells if is_number(cell)]
    return len(values) == len(cells) and all(one < other for one, other in pairwise(values))


def _units(
    head: Head, chosen: Mapping[str, str | int], stated: Mapping[str, Any]
) -> dict[str, str]:
    names = {column.source: column.name for column in head.columns}
    by_header = {role: header_unit(role, names.get(chosen.get(role, ""), "")) for role in REQUIRED}
    return {role: str(stated.get(role) or by_header[role] or _USUAL[role]) for role in REQUIRED}


def _has(columns: Sequence[Column], other: Path, separator: str, matlab: MatlabReader) -> bool:
    """Whether another file offers the same columns."""
    try:
        return _head(other, separator, matlab).columns == columns
    except InputError:
        return False


def _head(file: Path, separator: str, matlab: MatlabReader) -> Head:
    ending = file.suffix.lower()
    if ending in TEXTS:
        return _text(file, separator)
    if ending == ".npz":
        if stacked_tags(file):  # of channels, which settings of one file do not choose
            return Head([])
        with reading(file, "npz"), open_npz(file) as archive:
            return _variables(archive.names)
    with reading(file, "MATLAB"):
        return _variables(matlab.read(file, ["u"]).names)


def _variables(names: Sequence[str]) -> Head:
    return Head([Column(name, name) for name in names])


def _text(file: Path, separator: str) -> Head:
    layout, _, rows = find_rows(file, read_head(file, _HEAD_BYTES), separator)
    names = () if layout.is_shifted else layout.header
    columns = [
        Column(names[k] if k < len(names) and names.count(names[k]) == 1 and names[k] else k,
               (names[k] if k < len(names) else "") or f"column {k}")
        for k in range(max(layout.width, len(names)))
    ]  # fmt: skip
    found = next(name for name, mark in SEPARATORS.items() if mark == layout.delimiter)
    return Head(columns, [split_cells(row, layout.delimiter) for row in rows[:_ROWS]], found)
