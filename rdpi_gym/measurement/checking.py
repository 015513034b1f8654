"""From the columns of a file to a record: units, what is left out, and every check of the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rdpi_gym.measurement.options import OTHER, unit_factor
from rdpi_gym.measurement.quantities import Quantities
from rdpi_gym.measurement.record import LARGEST, BoolArray, Record, out_of_range
from rdpi_gym.measurement.sampling import (
    JITTER,
    bridge,
    filled_times,
    rounding,
    to_uniform,
    unknown_times,
    with_lost,
)
from rdpi_gym.measurement.table import Table
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

_LAST_PERIOD = 2.0**53
# A displacement beyond all others by this part of their range, of a voltage so far within its own.
_BEYOND, _INSIDE = 0.03, 0.1
MIN_SAMPLES = 16
"""Fewest samples of a record, and fewest that count in its error."""


def make_record(
    table: Table,
    name: str,
    *,
    units: Mapping[str, str],
    sampling_time_s: float | None = None,
    sampling_said: str = "--sampling-time",
    skip_s: float = 0.0,
    note: str = "",
    quantities: Quantities | None = None,
) -> Record:
    """Turn the columns of a file into a record."""
    if table.rows < MIN_SAMPLES:
        raise InputError(
            f"{table.where('u', max(table.rows - 1, 0))}: the record ends after {table.rows} samples; "
            f"give {MIN_SAMPLES} or more"
        )
    shown = {} if quantities is None or quantities.are_piezo else quantities.by_column
    columns = {
        key: values
        * unit_factor(key, units[key], f"{table.source}, {table.labels[key]}", shown.get(key, ""))
        if key in units
        else values
        for key, values in table.columns.items()
    }
    t_s, unknown = _times(table, columns.pop("t", None), sampling_time_s, sampling_said)
    step = float(t_s[-1] - t_s[0]) / (table.rows - 1)
    # a thousandth of a step keeps rounding from moving the first sample that is kept
    first = int(np.searchsorted(t_s, t_s[0] + skip_s - 1e-3 * step))
    if table.rows - first < MIN_SAMPLES:
        raise InputError(
            f"{table.where('u', table.rows - 1)}: {table.rows - first} samples are left after the "
            f"first {skip_s:g} s of {t_s[-1] - t_s[0]:g} s; skip less, {MIN_SAMPLES} are needed"
        )
    columns, missing, said = bridge(table, columns, unknown, first)
    _check_finite(table, columns, first)
    if "period" in columns:
        _check_whole(table, columns["period"], first)
    kept = {key: values[first:] for key, values in columns.items()}
    grid = to_uniform(t_s[first:], kept, str(table.source), ~missing[first:], sampling_time_s)
    if grid.measured.sum() < MIN_SAMPLES:
        raise InputError(
            f"{table.where('t', first)}: {int(grid.measured.sum())} samples are left at the median "
            f"step of {grid.ts_s:g} s; give {MIN_SAMPLES} or more, evenly sampled"
        )
    before_V, opened = _history(t_s, columns, first, grid.t_s[0], grid.ts_s)
    skipped = (f"left out: the first {skip_s:g} s ({first} samples)",) if first else ()
    period = grid.columns.get("period")
    return Record(
        name=name,
        t_s=grid.t_s,
        u_V=grid.columns["u"],
        y_um=grid.columns["y"],
        ts_s=grid.ts_s,
        reference_um=grid.columns.get("reference"),
        temperature_C=grid.columns.get("temperature"),
        period=None if period is None else period.astype(np.int64),
        error_mask=grid.measured,
        note=note,
        source=str(table.source),
        remarks=skipped + opened + said + table.remarks + grid.remarks,
        others={
            key.removeprefix(OTHER): values
            for key, values in grid.columns.items()
            if key.startswith(OTHER)
        },
        before_V=before_V,
        jitter_s=grid.jitter_s,
    )


def _history(
    t_s: Array, columns: Mapping[str, Array], first: int, begin_s: float, ts_s: float
) -> tuple[Array, tuple[str, ...]]:
    """Voltage (V) before the first sample that is kept, as far as the file knows it, and a remark.

    Where the file begins with a plant that still stands at 0 V, that is one sample more.
    """
    u, y = columns["u"], columns["y"]
    early = round((begin_s - float(t_s[0])) / ts_s)
    if early < 1 or not (np.isfinite(u).all() and np.isfinite(y).all()):
        return np.zeros(0), ()
    before_V: Array = np.interp(begin_s + ts_s * np.arange(-early, 0), t_s, u)
    if not _stood_at_zero(u, y, first):
        return before_V, ()
    remark = "it begins with a step from 0 V, where the first displacement still is"
    return np.concatenate([[0.0], before_V]), (remark,)


def _stood_at_zero(u: Array, y: Array, first: int) -> bool:
    """Whether the first displacement lies beyond all others, where 0 V would have put it."""
    swing, stroke = float(np.ptp(u)), float(np.ptp(y[first:]))
    rising = 1.0 if float(np.cov(u[first:], y[first:])[0, 1]) > 0.0 else -1.0
    for side in (1.0, -1.0):
        command, moved = side * u, side * rising * y
        lowest = float(command.min())
        beyond = moved[0] < float(moved[first:].min()) - _BEYOND * stroke
        if beyond and command[0] > lowest + _INSIDE * swing and lowest + _BEYOND * swing >= 0.0:
            return True
    return False


def mask_out(record: Record, stretches_s: Sequence[tuple[float, float]], where: str) -> Record:
    """Leave stretches of a record out of its error; they are still simulated."""
    t_s, mask, remarks = record.t_s, record.error_mask.copy(), record.remarks
    rounding = 1e-3 * record.ts_s
    for start, end in stretches_s:
        inside = (t_s >= start - rounding) & (t_s <= end + rounding)
        # a stretch before the first sample was skipped already; others are mistakes
        if not inside.any() and end > t_s[0]:
            raise InputError(
                f"{where}: {start:g} to {end:g} s holds no sample of record {record.name}; "
                f"its time runs from {t_s[0]:g} to {t_s[-1]:g} s"
            )
        mask &= ~inside
        remarks += (
            f"left out of the error, still simulated: {start:g} to {end:g} s "
            f"({int(inside.sum())} samples)",
        )
    if mask.sum() < MIN_SAMPLES:
        raise InputError(
            f"{where}: {int(mask.sum())} samples of record {record.name} are left in the error; "
            f"mask less, {MIN_SAMPLES} are needed"
        )
    return replace(record, error_mask=mask, remarks=remarks)


def _times(
    table: Table, t_s: Array | None, sampling_time_s: float | None, said: str
) -> tuple[Array, BoolArray]:
    """Return the times (s), and where the file does not say them."""
    nowhere = np.zeros(table.rows, dtype=np.bool_)
    if t_s is None:
        if sampling_time_s is None:
            raise InputError(f"{table.at(0)}: no time column", "give --sampling-time 5e-3")
        return sampling_time_s * np.arange(table.rows, dtype=np.float64), nowhere
    _check_finite(table, {"t": np.nan_to_num(t_s, posinf=np.inf, neginf=-np.inf)}, 0)
    unknown = nowhere if rounding(t_s) else unknown_times(t_s)
    if np.sum(~unknown) < MIN_SAMPLES:
        row = int(np.argmax(unknown))
        raise InputError(
            f"{table.where('t', row)}: {int(unknown.sum())} of {table.rows} times are missing or "
            "stand there twice",
            "give a time for each sample, or leave the column out with --sampling-time",
        )
    if unknown.any():
        t_s = filled_times(t_s, unknown)
    back = np.flatnonzero(np.diff(t_s) < 0)
    if back.size:
        row = int(back[0]) + 1
        raise InputError(
            f"{table.where('t', row)}: time goes from {t_s[row - 1]:.9g} to {t_s[row]:.9g} s; "
            "it must increase from sample to sample"
        )
    mean = float(t_s[-1] - t_s[0]) / max(with_lost(t_s)[0].size - 1, 1)
    if sampling_time_s is not None and abs(mean / sampling_time_s - 1) > JITTER:
        raise InputError(
            f"{table.where('t', 0)}: time steps by {mean:.6g} s on average where {said} "
            f"says {sampling_time_s:g} s; leave it out or correct it"
        )
    return t_s, unknown


def _check_finite(table: Table, columns: Mapping[str, Array], first: int) -> None:
    bad = [
        (first + int(np.argmin(finite)), name)
        for name, values in columns.items()
        # the record would refuse it too, but not by line; NaN is at most nothing
        if not (finite := np.abs(values[first:]) <= LARGEST).all()
    ]
    if bad:
        row, name = min(bad)
        value = columns[name][row]
        raise InputError(
            f"{table.where(name, row)}: {value:g} is {out_of_range(value)}; mend or remove this sample"
        )


def _check_whole(table: Table, period: Array, first: int) -> None:
    kept = period[first:]
    bad = np.flatnonzero((kept != np.round(kept)) | (np.abs(kept) > _LAST_PERIOD))
    if bad.size:
        row = first + int(bad[0])
        raise InputError(
            f"{table.where('period', row)}: {period[row]:g} is no index of a repetition; "
            "give whole numbers"
        )
