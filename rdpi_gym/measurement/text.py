"""Text files of numbers: comma, semicolon, tab or blanks between them, with or without header."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np

from rdpi_gym.measurement.encoding import read_lines
from rdpi_gym.measurement.layout import Layout, find_layout, is_number, split_cells
from rdpi_gym.measurement.table import REQUIRED, Table, from_header, label, select
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError, printable
from rdpi_gym.support.words import quoted

_LONGEST_LINE = 100_000  # characters; Python's reader of CSV takes cells of 131,072


def read_text(
    path: Path,
    columns: Mapping[str, str | int],
    *,
    time_needed: bool = True,
    separator: str = "",
) -> Table:
    r"""Read a text file of numbers.

    Lines that begin with ``#`` or ``%`` are comments. Decimal commas are understood where no
    comma stands between the values.
    """
    lines = read_lines(path)
    layout, numbers, rows = find_rows(path, lines, separator)
    sources = _sources(path, layout, numbers[0], columns, time_needed)
    indices = {
        name: layout.header.index(source) if isinstance(source, str) else source
        for name, source in sources.items()
    }
    labels = {name: label("column", name, source) for name, source in sources.items()}
    values = _values(path, layout, numbers, rows, indices, labels)
    names, units = from_header(sources)
    return Table(
        source=path,
        columns={name: values[:, k].copy() for k, name in enumerate(indices)},
        labels=labels,
        lines=np.array(numbers),
        remarks=_cut_off(lines[-1]),
        names=names,
        units=units,
    )


def find_rows(
    path: Path, lines: Sequence[str], separator: str = ""
) -> tuple[Layout, list[int], list[str]]:
    """Find the rows of values of a text file, and how they are written."""
    numbers: list[int] = []
    rows: list[str] = []
    comment, comment_line = "", 0
    for number, line in enumerate(lines, 1):
        text = line.lstrip()
        if len(line) > _LONGEST_LINE:
            raise InputError(
                f"{path}, line {number}: {len(line)} characters; a line of values has {_LONGEST_LINE} at most"
            )
        if text and text[0] not in "#%":
            numbers.append(number)
            rows.append(line)
        elif text and not rows:
            comment, comment_line = text.lstrip("#% "), number
    header_rows = 0
    if rows:
        layout, header_rows = find_layout(rows, numbers[0], comment, comment_line, separator)
        numbers, rows = numbers[header_rows:], rows[header_rows:]
    if not rows:
        raise InputError(
            f"{path}, line {len(lines)}: the file ends before its first value; "
            "give lines of numbers, t,u,y"
        )
    return layout, numbers, rows


def _cut_off(last_line: str) -> tuple[str, ...]:
    """Say that the last value may be cut off: every program that is not interrupted ends its line."""
    if not last_line.strip():
        return ()
    end = last_line if len(last_line) < 40 else f"...{last_line[-36:]}"
    return (
        f"the file ends without a line break, so its last line ({printable(end)}) may be cut off",
    )


def _sources(
    path: Path,
    layout: Layout,
    first_line: int,
    columns: Mapping[str, str | int],
    time_needed: bool,
) -> dict[str, str | int]:
    names, width = layout.header, layout.width
    by_name = [
        name
        for name in REQUIRED
        if not isinstance(columns.get(name), int) and (name != "t" or time_needed)
    ]
    if by_name and not names:
        raise InputError(
            f"{path}, line {first_line}, column 0: a number where a header was expected",
            "give the zero-based positions, for example --columns t=0,u=1,y=2 (missing: "
            f"{', '.join(by_name)})",
        )
    sources = select(columns, names, time_needed, f"{path}, line {layout.header_line}", "column")
    if layout.is_shifted and any(isinstance(source, str) for source in sources.values()):
        raise InputError(
            f"{path}, line {first_line}: {width} values under {len(names)} names (line "
            f"{layout.header_line})",
            "give one name for each column, or positions with --columns t=0,u=1,y=2; where decimal "
            "commas are meant, put semicolons between the values",
        )
    for name, source in sources.items():
        if isinstance(source, int) and source >= max(width, len(names)):
            raise InputError(
                f"{path}, line {first_line}, {label('column', name, source)}: "
                f"there are {width} columns; give a position from 0 to {width - 1}"
            )
    return sources


def _values(
    path: Path,
    layout: Layout,
    numbers: Sequence[int],
    rows: Sequence[str],
    indices: Mapping[str, int],
    labels: Mapping[str, str],
) -> Array:
    plain = rows
    if layout.delimiter != "," and any("," in row for row in rows):
        cells = (split_cells(row, layout.delimiter) for row in rows)
        wanted = [row[k] for row in cells for k in indices.values() if k < len(row)]
        # points and commas in one file: neither is safely the decimal sign
        if not any("." in cell for cell in wanted):
            plain = [row.replace(",", ".") for row in rows]
    width = max(layout.width, len(layout.header))
    for number, row in zip(numbers, rows, strict=True):
        if row.count('"') % 2:
            raise InputError(f"{path}, line {number}: a quotation mark is not closed; close it")
        many = len(row.split()) if layout.delimiter is None else row.count(layout.delimiter) + 1
        if many > width and len(found := split_cells(row, layout.delimiter)) > width:
            raise InputError(
                f"{path}, line {number}, column {width}: {len(found)} values where {width} were "
                "expected; perhaps two lines ran together"
            )
    try:
        return np.loadtxt(
            plain,
            dtype=np.float64,
            comments=None,
            delimiter=layout.delimiter,
            usecols=list(indices.values()),
            quotechar='"',
            ndmin=2,
        )
    except ValueError as error:
        _refuse_cell(path, layout, numbers, plain, indices, labels, str(error))


def _refuse_cell(
    path: Path,
    layout: Layout,
    numbers: Sequence[int],
    rows: Sequence[str],
    indices: Mapping[str, int],
    labels: Mapping[str, str],
    reason: str,
) -> NoReturn:
    for number, row in zip(numbers, rows, strict=True):
        cells = split_cells(row, layout.delimiter)
        for name, index in indices.items():
            where = f"{path}, line {number}, {labels[name]}"
            if index >= len(cells) or not cells[index]:
                raise InputError(f"{where}: no value; perhaps the file was cut off here")
            if not is_number(cells[index]) or "," in cells[index]:
                raise InputError(
                    f"{where}: {quoted(cells[index])} is not a number; give one, as in 1.25"
                )
    raise InputError(f"{path} cannot be read as lines of numbers ({reason[:150]})")
