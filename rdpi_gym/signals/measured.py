"""A signal that was recorded."""

from __future__ import annotations

import math
import reprlib
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from rdpi_gym.signals.base import ROUNDING, Signal, checked, set_numbers
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_utf8
from rdpi_gym.support.words import guess, some

_LARGEST = 2**28  # bytes


@dataclass(frozen=True, kw_only=True)
class Measured(Signal):
    """Samples joined by straight lines; the first is held before them, the last after them.

    The samples are in µm already: here `amplitude_um` is the factor on them, 1 to leave them as
    they are.

    Parameters
    ----------
    times_s
        Times of the samples (s), increasing, two or more; stored as a tuple.
    values_um
        Displacement at these times (µm); stored as a tuple.

    Raises
    ------
    InputError
        Lengths differ, times do not increase, or a number is not finite.

    Examples
    --------
    >>> record = Measured(times_s=[0.0, 1.0, 2.0], values_um=[0.0, 10.0, 30.0])
    >>> record([0.5, 1.5, 5.0])
    array([ 5., 20., 30.])
    >>> record.derivative([0.5, 1.0, 5.0])
    array([10., 20.,  0.])
    """

    name: ClassVar[str] = "measured"
    in_micrometres: ClassVar[bool] = True
    times_s: ArrayLike = field(repr=False, metadata=checked(set_numbers, count=2))
    values_um: ArrayLike = field(repr=False, metadata=checked(set_numbers, count=2))

    def __post_init__(self) -> None:
        super().__post_init__()
        times, values = self._samples
        if times.size != values.size:
            raise InputError(
                f"measured: {times.size} times_s and {values.size} values_um; "
                "give one value for each time"
            )
        back = np.flatnonzero(np.diff(times) <= 0.0)
        if back.size:
            raise InputError(
                f"measured: times_s does not increase at sample {back[0] + 1} "
                f"({times[back[0]]:g} s, then {times[back[0] + 1]:g} s); give increasing times"
            )

    @classmethod
    def from_file(
        cls,
        path: Path | str,
        column: str = "reference",
        *,
        time: str = "t",
        skip_s: float = 0.0,
        amplitude_um: float = 1.0,
        offset_um: float = 0.0,
        smooth_start_s: float = 0.0,
    ) -> Self:
        r"""Read a comma-separated file with a header line; its first sample becomes t = 0.

        Parameters
        ----------
        path
            The file; lines that begin with ``#`` or ``%`` are comments.
        column
            Name of the column with the displacement (µm).
        time
            Name of the column with the time (s).
        skip_s
            Time left out at the start of the record (s).
        amplitude_um, offset_um, smooth_start_s
            As of any signal; ``amplitude_um`` is the factor that turns another unit into µm.

        Raises
        ------
        InputError
            The file cannot be read, lacks a column, holds something that is no finite number,
            fewer than two samples, or times that do not increase.

        Examples
        --------
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = Path(folder) / "record.csv"
        ...     _ = path.write_text("t,u,y\n2.0,0.0,1.0\n2.5,0.5,3.0\n")
        ...     float(Measured.from_file(path, "y")(0.25))
        2.0
        """
        times, values = _read_columns(Path(path), time, column)
        kept = times >= times[0] + skip_s
        if np.count_nonzero(kept) < 2:
            raise InputError(
                f"{path}: skip_s = {skip_s:g} leaves fewer than two of {times.size} samples, which "
                f"last {times[-1] - times[0]:g} s; leave out less"
            )
        return cls(
            times_s=times[kept] - times[kept][0],
            values_um=values[kept],
            amplitude_um=amplitude_um,
            offset_um=offset_um,
            smooth_start_s=smooth_start_s,
        )

    @cached_property
    def _samples(self) -> tuple[Array, Array]:
        return np.array(self.times_s), np.array(self.values_um)

    def _shape(self, t: Array) -> Array:
        return np.interp(t, *self._samples)

    def _shape_rate(self, t: Array) -> Array:
        times, values = self._samples
        slopes = np.zeros(times.size + 1)
        slopes[1:-1] = np.diff(values) / np.diff(times)
        after: Array = t + ROUNDING * (times[-1] - times[0]) / times.size
        return slopes[np.searchsorted(times, after, "right")]


def _read_columns(path: Path, time: str, column: str) -> tuple[Array, Array]:
    """Return the two columns, the first increasing; errors name line and column of the file."""
    text = read_utf8(path, _LARGEST)
    lines = [
        (number, line.split(","))
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and line.lstrip()[0] not in ("#", "%")
    ]
    header = [name.strip() for name in lines[0][1]] if lines else []
    for name in (time, column):
        if name not in header:
            meant = guess(name, header)
            hint = f"; {meant}" if meant else ""
            raise InputError(
                f"{path} has no column {name!r}{hint}; its header has {some(header) or '-'}"
            )
    if len(lines) < 3:
        raise InputError(f"{path} holds fewer than two samples; give a record with more")
    table = np.empty((2, len(lines) - 1))
    for row, name in enumerate((time, column)):
        index = header.index(name)
        for sample, (number, cells) in enumerate(lines[1:]):
            cell = cells[index].strip() if index < len(cells) else ""
            table[row, sample] = _number(cell, f"{path}, line {number}, column {name!r}")
    back = np.flatnonzero(np.diff(table[0]) <= 0.0)
    if back.size:
        number = lines[back[0] + 2][0]
        raise InputError(
            f"{path}, line {number}, column {time!r}: {table[0, back[0] + 1]:g} s follows "
            f"{table[0, back[0]]:g} s; give increasing times"
        )
    return table[0], table[1]


def _number(cell: str, where: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{where}: {reprlib.repr(cell)} is no finite number; give one")
    return value
