"""Text files of numbers: comma, semicolon, tab or blanks between them, with or without header."""

from __future__ import annotations

import codecs
import csv
import gzip
import math
import os
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, NamedTuple, NoReturn, cast

import numpy as np

from rdpi_gym.measurement.table import PACKED, REQUIRED, Table, from_header, label, select
from rdpi_gym.measurement.units import is_unit
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError, printable
from rdpi_gym.support.files import open_regular, read_bytes
from rdpi_gym.support.npz import EXPANSION, FREE_BYTES, largest_expansion
from rdpi_gym.support.words import quoted

LARGEST_TEXT = 2**30
"""Most bytes of a text file that is read: some ten million samples."""
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")  # in no text, but in most of what is none
_PIECE = 2**20  # bytes that are expanded at once
_MARKS = (
    (codecs.BOM_UTF8, "UTF-8"),
    (codecs.BOM_UTF16_LE, "UTF-16-LE"),
    (codecs.BOM_UTF16_BE, "UTF-16-BE"),
)
INSTRUMENTS = "Windows-1252"
"""Encoding of what instruments and older programs export, where it is no UTF-8; it holds Latin-1's letters."""


class Lines(NamedTuple):
    r"""Lines of a text, whatever ended them (``\n``, ``\r\n`` or ``\r``), and what it was decoded from."""

    lines: list[str]
    encoding: str


def read_lines(path: Path, largest: int) -> list[str]:
    """Read the lines of a text that is UTF-8, or UTF-16 with its mark."""
    return _lines(_text(path, read_bytes(path, largest), True)[0])


def read_export(path: Path, most: int | None = None) -> Lines:
    """Read the lines of a text of measurements, compressed or not, also one of :data:`INSTRUMENTS`.

    With `most` no more than the whole lines of its first bytes.
    """
    is_whole = most is None
    if most is None:
        raw = _unpacked(path) if _is_packed(path) else read_bytes(path, LARGEST_TEXT)
    else:
        with open_regular(path) as stream, _reading(path, stream) as content:
            raw = content.read(most + 1)
        is_whole, raw = len(raw) <= most, raw[:most]
    text, encoding = _text(path, raw, is_whole, INSTRUMENTS)
    lines = _lines(text)
    return Lines(lines if is_whole else lines[:-1] or lines, encoding)


def _is_packed(path: Path) -> bool:
    return path.suffix.lower() == PACKED


@contextmanager
def _reading(path: Path, stream: IO[bytes]) -> Iterator[IO[bytes]]:
    """Give the bytes of a text as they are, or as they were before compression."""
    if not _is_packed(path):
        yield stream
        return
    try:
        yield cast(IO[bytes], gzip.GzipFile(fileobj=stream))
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(
            f"{path} cannot be read as gzip ({printable(str(error))[:150]}); give the text itself"
        ) from error


def _unpacked(path: Path) -> bytes:
    """Expand a text, piece by piece: no file sizes the memory."""
    with open_regular(path) as stream, _reading(path, stream) as content:
        most = min(LARGEST_TEXT, largest_expansion(os.fstat(stream.fileno()).st_size))
        whole = bytearray()
        while piece := content.read(min(_PIECE, most + 1 - len(whole))):
            whole += piece
    if len(whole) > most:
        raise InputError(
            f"{path}: expands to more than {most / 2**20:.0f} MiB; a compressed text may take {EXPANSION} times "
            f"its size, or {FREE_BYTES / 2**20:.0f} MiB where that is more"
        )
    return bytes(whole)


def _text(path: Path, raw: bytes, is_whole: bool, otherwise: str = "") -> tuple[str, str]:
    """Return a text and its encoding: that of its mark, else UTF-8, else another one where it is given."""
    mark, encoding = next((pair for pair in _MARKS if raw.startswith(pair[0])), (b"", "UTF-8"))
    try:
        text = _decoded(raw[len(mark) :], encoding, is_whole)
    except UnicodeDecodeError as error:
        if otherwise and not mark:
            with suppress(UnicodeDecodeError):
                text = _decoded(raw, otherwise, is_whole)
                if not _CONTROL.search(text):
                    return text, otherwise
        before = error.object[: error.start].decode(encoding)
        raise InputError(
            f"{path}, {_place(before)} (byte {len(mark) + error.start}): "
            f"not {encoding} text; save the file as UTF-8"
        ) from None
    return _without_nul(path, text), encoding


def _decoded(raw: bytes, encoding: str, is_whole: bool) -> str:
    return codecs.getincrementaldecoder(encoding)().decode(raw, is_whole)


def _without_nul(path: Path, text: str) -> str:
    if "\0" in text:
        raise InputError(
            f"{path}, {_place(text[: text.index(chr(0))])}: a NUL character, so this is no UTF-8 "
            "text; save the file as UTF-8, or as UTF-16 with its byte-order mark"
        )
    return text


def _lines(text: str) -> list[str]:
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _place(text_before: str) -> str:
    lines = _lines(text_before)
    return f"line {len(lines)}, column {len(lines[-1]) + 1}"


SEPARATORS: Mapping[str, str | None] = {
    "comma": ",",
    "semicolon": ";",
    "tab": "\t",
    "blanks": None,
}
"""Character between two values by its name; None: any blanks."""
_DECIMAL_COMMA = re.compile(r"[+-]?\d+(,\d+)?([eE][+-]?\d+)?")


@dataclass(frozen=True)
class Layout:
    """Separator, decimal mark and header of a text file."""

    delimiter: str | None  # Text between two values; None for blanks
    header: tuple[str, ...]  # Names of the columns, empty without a header
    header_line: int  # Line of the header, counted from 1
    width: int  # Values in the first line of values
    above: int = 0  # Lines above the header, comments aside, that are left out

    @property
    def is_shifted(self) -> bool:
        """Whether the names of the header do not stand above the values."""
        names = len(self.header)
        return self.width != names if self.delimiter is None else self.width > names


def split_cells(line: str, delimiter: str | None) -> list[str]:
    """Split a line into its cells, blanks and quotes around them and empty ones at its end removed."""
    if delimiter is None:
        return [cell.strip('"') for cell in line.split()]
    rows = csv.reader([line], delimiter=delimiter, skipinitialspace=True)
    cells = [cell.strip() for cell in next(rows, [])]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def is_number(cell: str) -> bool:
    """Whether a cell holds a number, with a decimal point or a decimal comma."""
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return "_" not in cell  # Python takes 1_000 for a number


def find_delimiter(line: str) -> str | None:
    """Find what separates the values of a line: semicolon, tab, comma, or None for blanks."""
    if ";" in line:
        return ";"
    cells = line.split("\t")
    if len(cells) > 1 and not any(" " in cell.strip() for cell in cells):
        return "\t"
    blank_separated = line.split()
    if "," not in line or (
        len(blank_separated) > 1 and all(map(_DECIMAL_COMMA.fullmatch, blank_separated))
    ):
        return None
    return ","


_LOOKED_AT = 1000
"""Rows in which the shape of a row of values is looked for: more than any instrument writes above them."""


def _first_values(rows: Sequence[str], separator: str) -> int:
    """Return the index of the first row of values: of as many numbers in the same cells as most rows hold.

    A damaged row before it, of which half the cells are numbers, is one too: neither a name such as "2"
    makes one of a header, nor a single number of prose.
    """
    cells = [
        split_cells(row, SEPARATORS[separator] if separator else find_delimiter(row))
        for row in rows[:_LOOKED_AT]
    ]
    shapes = Counter(
        shape for row in cells if sum(shape := tuple(map(is_number, row))) > 1
    ).most_common(1)
    first = 0
    if shapes:
        first = next(k for k, row in enumerate(cells) if tuple(map(is_number, row)) == shapes[0][0])
    elif not _holds_values(cells[0], len(cells[0])):
        return 1
    while first and _holds_values(cells[first - 1], len(cells[first])):
        first -= 1
    return first


def _holds_values(cells: Sequence[str], width: int) -> bool:
    filled = [cell for cell in cells if cell]
    count = sum(map(is_number, filled))
    return 2 * count >= len(filled) and (count == len(filled) or count > 1 or len(cells) == width)


def find_layout(
    rows: Sequence[str],
    numbers: Sequence[int],
    comments: Sequence[tuple[int, str]],
    separator: str = "",
) -> tuple[Layout, int]:
    """Find out how the values of a file are written, and which row is the first of them.

    The header is the line right above the values, or above a row of units there; a comment where that
    line has not as many names as there are values. What stands above the header is left out.
    """
    first = _first_values(rows, separator)
    below = rows[min(first, len(rows) - 1)]
    second = rows[min(first + 1, len(rows) - 1)]
    delimiter = SEPARATORS[separator] if separator else find_delimiter(second)
    width = len(split_cells(below, delimiter))
    layout = Layout(delimiter, (), 0, width)
    if first:
        names = _names(rows[first - 1], delimiter, width)
        layout = Layout(delimiter, names, numbers[first - 1], width, first - 1)
        if first > 1 and len(names) == width and all(map(is_unit, names)):
            units, names = names, _names(rows[first - 2], delimiter, width)
            if len(names) == width:
                marks = (unit.strip(" []()") for unit in units)
                named = (f"{name} [{unit}]" for name, unit in zip(names, marks, strict=True))
                return Layout(delimiter, tuple(named), numbers[first - 2], width, first - 2), first
    if not first or layout.is_shifted:
        last = numbers[first] if first < len(rows) else math.inf
        for number, text in reversed(comments):
            names = _names(text, delimiter, width)
            if number < last and len(names) == width:
                return Layout(delimiter, names, number, width, first), first
    return layout, first


def _names(line: str, delimiter: str | None, width: int) -> tuple[str, ...]:
    """Split a header, which may be separated otherwise than the values are."""
    names = split_cells(line, delimiter)
    if len(names) != width or any(name.endswith((",", ";")) for name in names):
        other = split_cells(line, find_delimiter(line))
        if len(other) == width:
            names = other
    return tuple(names)


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
    lines, encoding = read_export(path)
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
        remarks=(*taken(layout, encoding), *_cut_off(lines[-1])),
        names=names,
        units=units,
    )


def find_rows(
    path: Path, lines: Sequence[str], separator: str = ""
) -> tuple[Layout, list[int], list[str]]:
    """Find the rows of values of a text file, and how they are written."""
    numbers: list[int] = []
    rows: list[str] = []
    comments: list[tuple[int, str]] = []
    for number, line in enumerate(lines, 1):
        text = line.lstrip()
        if len(line) > _LONGEST_LINE:
            raise InputError(
                f"{path}, line {number}: {len(line)} characters; a line of values has {_LONGEST_LINE} at most"
            )
        if text and text[0] not in "#%":
            numbers.append(number)
            rows.append(line)
        elif text:
            comments.append((number, text.lstrip("#% ")))
    if rows:
        layout, first = find_layout(rows, numbers, comments, separator)
        numbers, rows = numbers[first:], rows[first:]
    if not rows:
        raise InputError(
            f"{path}, line {len(lines)}: the file ends before its first value; "
            "give lines of numbers, t,u,y"
        )
    return layout, numbers, rows


def taken(layout: Layout, encoding: str) -> tuple[str, ...]:
    """State what was taken of a text that is more than a header and values in UTF-8."""
    said = []
    if layout.above:
        lines = "line above it is" if layout.above == 1 else "lines above it are"
        said.append(f"the header is line {layout.header_line}; {layout.above} {lines} left out")
    if encoding == INSTRUMENTS:
        said.append(f"the file is no UTF-8 and was read as {INSTRUMENTS}")
    return tuple(said)


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
