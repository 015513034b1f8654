"""What every reader hands on: named columns, and where in the file each value stands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import short, some

REQUIRED = ("t", "u", "y")
_MEANING = {
    "t": "time in s",
    "u": "voltage in V",
    "y": "displacement in µm",
    "reference": "reference in µm",
    "temperature": "temperature in °C",
    "period": "index of the repetition",
}


@dataclass(frozen=True)
class Table:
    """Columns of one file in the file's own units, by our names, all of one length.

    Parameters
    ----------
    source
        The file.
    columns
        Values by our name (`rdpi_gym.measurement.COLUMNS`), each (N,).
    labels
        What the file calls each column, as an error line should say it.
    lines
        (N,) line number of each row, counted from 1; None for a file without lines.
    remarks
        What a reader noticed, one sentence each.
    """

    source: Path
    columns: Mapping[str, Array]
    labels: Mapping[str, str]
    lines: NDArray[np.int64] | None = None
    remarks: tuple[str, ...] = ()

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
    """Name a column for an error line: by the file's own name, ours behind it where it differs.

    Examples
    --------
    >>> label("column", "y", "disp"), label("column", "u", "u"), label("column", "t", 1)
    ('column disp (y)', 'column u', 'column 1 (t)')
    """
    named = f"{kind} {short(str(source))}"
    return named if source == column else f"{named} ({column})"


def select(
    columns: Mapping[str, str | int],
    names: Sequence[str],
    time_needed: bool,
    where: str,
    kind: str,
) -> dict[str, str | int]:
    """Choose what each of our columns is read from.

    Parameters
    ----------
    columns
        What the user says, by our name; a name that is missing there stands for itself.
    names
        The names that the file offers.
    time_needed
        Whether a file without a time column is refused.
    where, kind
        File (and line), and what it calls a column, for the error line.

    Returns
    -------
    dict
        Source of t, u, y and of the optional columns that are there.

    Raises
    ------
    InputError
        A column that is needed, or that the user named, is missing or stands there twice.

    Examples
    --------
    >>> select({"y": "disp"}, ["t", "u", "disp"], True, "run.csv, line 1", "column")
    {'t': 't', 'u': 'u', 'y': 'disp'}
    """
    chosen: dict[str, str | int] = {}
    for name, meaning in _MEANING.items():
        source = columns.get(name, name)
        if isinstance(source, int):
            chosen[name] = source
        elif source in chosen.values():
            other = next(key for key, value in chosen.items() if value == source)
            raise InputError(
                f"{where}, {label(kind, source, source)}: read as {other}, so {name} needs a column of its own; "
                f"name it with --columns {name}=..."
            )
        elif names.count(source) > 1:
            raise InputError(
                f"{where}, {label(kind, source, source)}: it is there twice; rename one"
            )
        elif source in names:
            chosen[name] = source
        elif name in columns or (name in REQUIRED and (name != "t" or time_needed)):
            otherwise = " or give --sampling-time 5e-3" if name == "t" else ""
            raise InputError(
                f"{where}, {label(kind, name, source)}: missing ({meaning}); the file has "
                f"{some(names) or 'none'}; name it with --columns {name}=...{otherwise}"
            )
    return chosen
