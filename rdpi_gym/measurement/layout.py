"""How the lines of a text file are written: what separates the values, and who names them."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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
    """What separates the values of a text file and what its header says.

    Parameters
    ----------
    delimiter
        What stands between two values; None for blanks.
    header
        Names of the columns, empty without a header.
    header_line
        Line of the header, counted from 1.
    width
        Values in the first line of values.
    """

    delimiter: str | None
    header: tuple[str, ...]
    header_line: int
    width: int

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


def find_layout(
    rows: Sequence[str], first_line: int, comment: str, comment_line: int, separator: str = ""
) -> tuple[Layout, int]:
    """Find out how the values of a file are written."""
    second = rows[min(1, len(rows) - 1)]
    delimiter = SEPARATORS[separator] if separator else find_delimiter(second)
    first = split_cells(rows[0], delimiter)
    filled = [cell for cell in first if cell]
    # a damaged first row of values still holds numbers, and a header may hold a name such as "2"
    if 2 * sum(map(is_number, filled)) < len(filled):
        width = len(split_cells(rows[1], delimiter)) if len(rows) > 1 else len(first)
        return Layout(delimiter, _names(rows[0], delimiter, width), first_line, width), 1
    names = _names(comment, delimiter, len(first))
    if len(names) != len(first):
        names = ()
    return Layout(delimiter, names, comment_line, len(first)), 0


def _names(line: str, delimiter: str | None, width: int) -> tuple[str, ...]:
    """Split a header, which may be separated otherwise than the values are."""
    names = split_cells(line, delimiter)
    if len(names) != width or any(name.endswith((",", ";")) for name in names):
        other = split_cells(line, find_delimiter(line))
        if len(other) == width:
            names = other
    return tuple(names)
