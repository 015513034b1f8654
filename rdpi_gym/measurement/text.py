"""Text files: comma, semicolon, tab or blanks between values, with or without a header."""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

from rdpi_gym.arrays import Array
from rdpi_gym.errors import InputError
from rdpi_gym.measurement.table import Table, label, select

_DECIMAL_COMMA = re.compile(r"[+-]?\d+(,\d+)?([eE][+-]?\d+)?")


@dataclass(frozen=True)
class _Layout:
    """How the lines of one file are written."""

    delimiter: str | None  # None: blanks
    header: tuple[str, ...]  # empty without one
    header_line: int
    width: int  # values in a line


def read_text(
    path: Path, columns: Mapping[str, str | int], *, has_sampling_time: bool = False
) -> Table:
    """Read a text file of numbers.

    Lines that begin with ``#`` or ``%`` are comments; the last one before the first value may
    hold the header. Decimal commas are understood where the comma is not between the values.

    Parameters
    ----------
    path
        The file, UTF-8, or UTF-16 with a byte-order mark.
    columns
        Header name or zero-based position by our name; see `rdpi_gym.measurement.parse_columns`.
    has_sampling_time
        Whether the file may come without a time column.

    Raises
    ------
    InputError
        Wrong encoding, a missing column, a value that is no number: file, line and column.
    """
    lines = _decode(path).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    numbers: list[int] = []
    rows: list[str] = []
    comment, comment_line = "", 0
    for number, line in enumerate(lines, 1):
        text = line.lstrip()
        if not text:
            continue
        if text[0] not in "#%":
            numbers.append(number)
            rows.append(line)
        elif not rows:
            comment, comment_line = text.lstrip("#% "), number
    if not rows:
        raise InputError(f"{path}, line {len(lines)}: the file ends without a value; give a record")

    layout = _layout(rows, numbers[0])
    if layout.header:
        numbers, rows = numbers[1:], rows[1:]
    elif set(_cells(comment, _delimiter(comment))) & {"u", "y", *map(str, columns.values())}:
        names = tuple(_cells(comment, _delimiter(comment)))
        layout = _Layout(layout.delimiter, names, comment_line, layout.width)
    sources = _sources(path, columns, layout, numbers, has_sampling_time)
    labels = {name: label("column", name, source) for name, source in sources.items()}
    indices = {
        name: layout.header.index(source) if isinstance(source, str) else source
        for name, source in sources.items()
    }
    values = _values(path, rows, numbers, layout, indices, labels)
    return Table(
        source=path,
        columns={name: np.ascontiguousarray(values[:, k]) for k, name in enumerate(indices)},
        labels=labels,
        lines=np.array(numbers),
    )


def _decode(path: Path) -> str:
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror})") from error
    is_utf16 = raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = raw.decode("utf-16" if is_utf16 else "utf-8-sig")
    except UnicodeDecodeError as error:
        # the decoder counts from behind a UTF-8 byte-order mark
        position = raw.index(error.object) + error.start
        line_start = raw.rfind(b"\n", 0, position) + 1
        raise InputError(
            f"{path}, line {raw.count(b'\n', 0, position) + 1}, column "
            f"{position - line_start + 1} (byte {position}): "
            f"not {'UTF-16' if is_utf16 else 'UTF-8'} text; save the file as UTF-8"
        ) from None
    if "\0" in text:
        line, column = _line_and_column(text, text.index("\0"))
        raise InputError(
            f"{path}, line {line}, column {column}: a NUL character, so this is no UTF-8 text; "
            "save the file as UTF-8, or as UTF-16 with its byte-order mark"
        )
    return text


def _line_and_column(text: str, position: int) -> tuple[int, int]:
    return text.count("\n", 0, position) + 1, position - text.rfind("\n", 0, position)


def _delimiter(line: str) -> str | None:
    if ";" in line:
        return ";"
    if "\t" in line and not any(" " in cell.strip() for cell in line.split("\t")):
        return "\t"
    if "," in line:
        cells = line.split()
        if len(cells) > 1 and all(_DECIMAL_COMMA.fullmatch(cell) for cell in cells):
            return None
        return ","
    return None


def _cells(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return [cell.strip("\"'") for cell in line.split()]
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return "_" not in cell


def _layout(rows: Sequence[str], first_line: int) -> _Layout:
    delimiter = _delimiter(rows[1] if len(rows) > 1 else rows[0])
    first = _cells(rows[0], delimiter)
    filled = [cell for cell in first if cell]
    # a damaged first row of values still holds numbers, a header may hold a name like "2"
    if 2 * sum(map(_is_number, filled)) >= len(filled):
        return _Layout(delimiter, (), first_line, len(first))
    if _delimiter(rows[0]) != delimiter and len(first) == 1:
        first = _cells(rows[0], _delimiter(rows[0]))
    while first and not first[-1]:
        first.pop()
    width = len(_cells(rows[1], delimiter)) if len(rows) > 1 else len(first)
    return _Layout(delimiter, tuple(first), first_line, width)
