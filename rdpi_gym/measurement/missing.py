"""Samples that are no numbers, and times that stand there twice: bridged, counted, never scored."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rdpi_gym.measurement.record import BoolArray
from rdpi_gym.measurement.table import Table
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import digits

MOST_MISSING = 0.2
"""Share of a record's samples that may be missing."""
_SIGNALS = ("u", "y")


def unknown_times(t_s: Array) -> BoolArray:
    """Where a clock says nothing: no number, or the time of the sample before."""
    unknown = np.isnan(t_s)
    known = np.flatnonzero(~unknown)
    unknown[known[1:][np.diff(t_s[known]) == 0.0]] = True
    return unknown


def filled_times(t_s: Array, unknown: BoolArray) -> Array:
    """Put evenly between its neighbours what a clock does not say."""
    k = np.arange(t_s.size)
    known = k[~unknown]
    filled = t_s.copy()
    filled[unknown] = np.interp(k[unknown], known, t_s[known])
    step = float(np.median(np.diff(t_s[known]) / np.diff(known)))
    before, after = k < known[0], k > known[-1]
    filled[before] = t_s[known[0]] - step * (known[0] - k[before])
    filled[after] = t_s[known[-1]] + step * (k[after] - known[-1])
    return filled


def bridge(
    table: Table, columns: Mapping[str, Array], unknown: BoolArray, first: int
) -> tuple[dict[str, Array], BoolArray, tuple[str, ...]]:
    """Carry u and y in straight lines across what is no number."""
    gaps = {key: np.isnan(columns[key]) for key in _SIGNALS}
    missing = unknown | gaps["u"] | gaps["y"]
    counted = missing[first:]
    number = int(counted.sum())
    if number > MOST_MISSING * counted.size:
        row = first + int(np.argmax(counted))
        key = next((key for key in _SIGNALS if gaps[key][row]), "t")
        value = "no time of its own" if key == "t" else f"{columns[key][row]:g} is no number"
        raise InputError(
            f"{table.where(key, row)}: {value}, and so it is in {number} of {counted.size} samples; "
            f"mend or remove them, {100 * MOST_MISSING:g} % may be missing"
        )
    k = np.arange(missing.size)
    bridged = dict(columns)
    for key, gap in gaps.items():
        if gap.any() and not gap.all():
            bridged[key] = columns[key].copy()
            bridged[key][gap] = np.interp(k[gap], k[~gap], columns[key][~gap])
    said = []
    for what, at in (
        ("no number in u or y", gaps["u"] | gaps["y"]),
        ("a time that is missing or stands there twice", unknown),
    ):
        if size := int(at[first:].sum()):
            row = first + int(np.argmax(at[first:]))
            said.append(
                f"left out of the error, simulated through in a straight line: {size} of "
                f"{counted.size} samples ({digits(100 * size / counted.size)} %) with {what}, the "
                f"first in {_place(table, row)}"
            )
    return bridged, missing, tuple(said)


def _place(table: Table, row: int) -> str:
    return table.at(row).removeprefix(f"{table.source}, ")
