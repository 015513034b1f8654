"""Uniform sampling: missing samples filled, recorded times brought to one grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.measurement.record import BoolArray
from rdpi_gym.measurement.table import Table
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import digits

MOST_MISSING = 0.2
"""Share of a record's samples that may be missing."""
_SIGNALS = ("u", "y")


def unknown_times(t_s: Array) -> BoolArray:
    """Mask of times without information: no number, or the time of the sample before."""
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


Places: TypeAlias = Array | NDArray[np.intp]

JITTER = 0.01
"""Largest deviation of a time step from the mean step, over it, that counts as uniform."""
_WORTH_SAYING = 1e-4
_GAP_STEPS = 5.0  # a longer step is a hole in the record, not jitter
_LOST = 1.5  # steps from which on a step is nearer to two: between its ends a sample was lost
_DECIMALS = 12
_FEWEST, _BOTH = 16, 0.05  # samples; share of the steps that the rarer length has
_EXACT = 1e-3  # of a decimal: so far a time may be off it by the arithmetic of a converted unit
_LARGEST_GROWTH = 10
_HALF = 0.55  # of a decimal: no stamp of an even clock is rounded by more
_ERRORS = 2.0  # standard errors by which samples run straighter by their stamps than by chance
_NO_BEND = 1e-9  # of a signal's range: beneath it a sample is on the line between its neighbours
_NEARLY = 0.9  # of an interpolated sample is made of samples that count


@dataclass(frozen=True)
class Grid:
    """A record on uniform times."""

    t_s: Array  # Times (s), (M,)
    ts_s: float  # Sampling time (s)
    columns: Mapping[str, Array]  # The other columns, each (M,)
    # (M,) bool; False where a sample was lost, or more of them: its values are only interpolated
    measured: BoolArray
    remarks: tuple[str, ...]  # Changes, one sentence each
    jitter_s: float = 0.0  # As of the record


def rounding(t_s: Array) -> float:
    """Return the decimal to which the times of an even clock were rounded (s), or 0.

    Its steps are two neighbouring multiples of the decimal, or one, and no time is farther from
    the even grid than rounding puts it.
    """
    if t_s.size < _FEWEST or not np.isfinite(t_s).all() or t_s[-1] <= t_s[0]:
        return 0.0
    decimal = _decimal(t_s, float(t_s[-1] - t_s[0]) / (t_s.size - 1))
    if not decimal:
        return 0.0
    even = np.linspace(t_s[0], t_s[-1], t_s.size)
    steps = np.diff(np.round(t_s / decimal))
    longer = float(np.mean(steps > steps.min()))
    near = float(np.max(np.abs(t_s - even))) <= 1.01 * decimal
    # of a few steps that are longer, each is a sample that was lost
    both = steps.max() - steps.min() == 1 and _BOTH < longer < 1.0 - _BOTH
    return decimal if steps.min() >= 0 and both and near else 0.0


def _decimal(t_s: Array, step_s: float) -> float:
    """Return the largest decimal (s) of which all times are multiples, not far below a step, or 0."""
    span = float(t_s[-1] - t_s[0])
    for decimals in range(-3, _DECIMALS):
        decimal = 10.0**-decimals
        if decimal < JITTER * step_s:
            return 0.0
        if decimal > span:
            continue
        ticks = t_s / decimal
        off = np.max(np.abs(ticks - np.round(ticks)))
        if off <= max(_EXACT, 1e-15 * float(np.max(np.abs(ticks)))):
            return decimal
    return 0.0


def to_uniform(
    t_s: Array,
    columns: Mapping[str, Array],
    where: str,
    scored: BoolArray | None = None,
    sampling_time_s: float | None = None,
) -> Grid:
    """Put a record on uniform times.

    Where every step is within 1 % of the mean step, or the times are those of an even clock that
    were rounded, or off by less than half a step and the samples run no straighter by that, the
    samples stay as they are and the times become the uniform grid between the
    first and the last one; samples that such a clock lost, up to a fifth, are put back. Else the
    columns are interpolated linearly at the median step (``period`` keeps its last value).
    """
    counts = np.ones(t_s.size, dtype=np.bool_) if scored is None else scored
    found = _even(t_s, columns, counts, sampling_time_s)
    whole, rows = with_lost(t_s)
    if found is None and rows.size < whole.size:
        scored = np.zeros(whole.size, dtype=np.bool_)
        scored[rows] = counts
        found = _even(whole, _at(np.arange(whole.size), rows, columns), scored, sampling_time_s)
        if found is not None:
            found = replace(found, remarks=(*found.remarks, _said_lost(whole, rows)))
    return found or _resampled(t_s, columns, counts, where)


def _even(
    t_s: Array, columns: Mapping[str, Array], counts: BoolArray, sampling_time_s: float | None
) -> Grid | None:
    """Return the samples as they are, on the grid of an even clock; None where it is none."""
    samples = t_s.size
    even = np.linspace(t_s[0], t_s[-1], samples)
    ts_s = float(t_s[-1] - t_s[0]) / (samples - 1)
    if decimal := rounding(t_s):
        said = (
            f"times are rounded to {decimal:g} s: taken as even, {ts_s:.6g} s apart, which is the "
            "mean step"
        )
        if sampling_time_s is not None:
            ts_s, even = sampling_time_s, t_s[0] + sampling_time_s * np.arange(samples)
            said = f"times are rounded to {decimal:g} s: taken as {ts_s:.6g} s apart, as was said"
            return Grid(even, ts_s, columns, counts, (said,))
        return Grid(even, ts_s, columns, counts, (said,), _beyond_rounding(t_s, decimal))
    jitter = float(np.max(np.abs(np.diff(t_s) - ts_s))) / ts_s
    # small deviations of one sign would add up to a clock that is wrong by whole samples
    if np.max(np.abs(t_s - even)) > ts_s / 2:
        return None
    if JITTER < jitter < _LOST - 1.0 and not _is_as_stamped(t_s, even, columns):
        said = (
            f"time steps differ by up to {100 * jitter:.3g} % from the mean step, and the samples run "
            f"no straighter by that: taken as even, {ts_s:.6g} s apart"
        )
        return Grid(even, ts_s, columns, counts, (said,))
    if jitter <= JITTER:
        said = f"time steps jitter by up to {100 * jitter:.2g} % of the mean step: taken as even"
        is_said = jitter > _WORTH_SAYING
        return Grid(even, ts_s, columns, counts, (said,) if is_said else (), off_even(t_s, ts_s))
    return None


def _is_as_stamped(t_s: Array, even: Array, columns: Mapping[str, Array]) -> bool:
    """Whether samples lie straighter between their neighbours by their stamps than by an even clock.

    A command or displacement that was taken at other times than it is stamped with zigzags. Logarithms,
    as jumps hide all other samples in a sum of squares; by some standard errors, as noise tells nothing.
    """
    signals = [x for name, x in columns.items() if name != "period"]
    gains = np.concatenate([_bent(even, x) - _bent(t_s, x) for x in signals])
    return float(gains.sum()) > _ERRORS * float(np.linalg.norm(gains))


def _bent(t_s: Array, x: Array) -> Array:
    """Logarithm of how far each sample is off the line between its neighbours, ``(N - 2,)``."""
    share = (t_s[1:-1] - t_s[:-2]) / (t_s[2:] - t_s[:-2])
    off = np.abs(x[1:-1] - x[:-2] - share * (x[2:] - x[:-2]))
    return np.asarray(np.log(off + _NO_BEND * max(float(np.ptp(x)), 1e-300)))


def with_lost(t_s: Array) -> tuple[Array, NDArray[np.intp]]:
    """Put back the times of rows that were lost, evenly between their neighbours."""
    steps = np.diff(t_s)
    usual = steps[steps < _LOST * np.median(steps)]
    # where most steps are 0 s, times are rounded coarsely
    taken = np.maximum(np.round(steps / usual.mean()), 1.0) if usual.size else np.ones(steps.size)
    samples = 1.0 + float(taken.sum())
    if samples - t_s.size > MOST_MISSING * samples:
        taken = np.ones(steps.size)
    rows = np.concatenate([[0], np.cumsum(taken)]).astype(np.intp)
    if rows[-1] + 1 == t_s.size:
        return t_s, rows
    whole: Array = np.interp(np.arange(rows[-1] + 1), rows, t_s)
    if decimal := _decimal(t_s, float(usual.mean())):
        whole = np.round(whole / decimal) * decimal
    whole[rows] = t_s
    return whole, rows


def _said_lost(t_s: Array, rows: NDArray[np.intp]) -> str:
    lost = np.setdiff1d(np.arange(t_s.size), rows)
    return (
        f"left out of the error, simulated through in a straight line: {lost.size} of {t_s.size} "
        f"samples ({digits(100 * lost.size / t_s.size)} %) that the times skip, the first at "
        f"{t_s[lost[0]]:.9g} s"
    )


def _at(grid: Places, t_s: Places, columns: Mapping[str, Array]) -> dict[str, Array]:
    """Return columns at other times: in straight lines between samples, ``period`` held."""
    return {
        name: values[np.searchsorted(t_s, grid, side="right") - 1]
        if name == "period"
        else np.interp(grid, t_s, values)
        for name, values in columns.items()
    }


def _resampled(t_s: Array, columns: Mapping[str, Array], counts: BoolArray, where: str) -> Grid:
    """Return the columns at the median step of a clock that is not even."""
    samples = t_s.size
    steps = np.diff(t_s)
    median = float(np.median(steps))
    ts_s = float(t_s[-1] - t_s[0]) / (samples - 1)
    jitter = float(np.max(np.abs(steps - ts_s))) / ts_s
    length = (t_s[-1] - t_s[0]) / median
    if length > _LARGEST_GROWTH * samples:
        k = int(np.argmax(steps))
        raise InputError(
            f"{where}: time jumps from {t_s[k]:g} to {t_s[k + 1]:g} s where the median step is "
            f"{median:g} s; put what follows into a file of its own"
        )
    grid = t_s[0] + median * np.arange(int(np.floor(length * (1 + 1e-12))) + 1)
    last = np.clip(np.searchsorted(t_s, grid, side="right") - 1, 0, samples - 2)
    holes = steps > _LOST * median
    from_sample = np.minimum(grid - t_s[last], t_s[last + 1] - grid)
    measured = ~(holes[last] & (from_sample > median / 2))
    remarks: tuple[str, ...] = (
        f"time steps differ by up to {100 * jitter:.3g} % from the mean step: resampled at "
        f"the median step, {median:.6g} s, by linear interpolation, {samples} samples became {grid.size}",
    )
    if not measured.all():
        remarks += (
            f"left out of the error: {int(np.sum(~measured))} samples interpolated across "
            f"{int(np.sum(holes))} gap(s) longer than {_LOST:g} steps",
        )
    # what lies beside a sample that does not count is made of it
    beside = np.interp(grid, t_s, counts.astype(np.float64))
    return Grid(
        grid,
        median,
        _at(grid, t_s, columns),
        measured & (beside > _NEARLY),
        remarks,
        off_even(t_s, median),
    )


def off_even(t_s: Array, ts_s: float) -> float:
    """Return by how much times are off an even clock, from one to the next (s rms), or 0.

    A clock that runs slowly off is none, nor is a sample that was lost.
    """
    steps = np.diff(t_s)
    off = steps - ts_s * np.maximum(np.round(steps / ts_s), 1.0)
    turns = np.diff(off[steps <= _GAP_STEPS * ts_s])
    # of times that are each off by one, second differences have a variance of six
    rms_s = float(np.sqrt(np.mean(turns * turns) / 6.0)) if turns.size else 0.0
    return rms_s if rms_s > _WORTH_SAYING * ts_s else 0.0


def _beyond_rounding(t_s: Array, decimal: float) -> float:
    """Return by how much rounded times are off an even clock (s rms) that rounding does not explain.

    Times of an even clock are rounded by half a decimal at most: then they are known exactly.
    """
    # about the straight line through them
    k = np.arange(t_s.size, dtype=np.float64)
    k -= k.mean()
    off = t_s - t_s.mean()
    off = off - (k @ off) / (k @ k) * k
    if float(np.max(np.abs(off))) <= _HALF * decimal:
        return 0.0
    return float(np.sqrt(max(np.var(off) - decimal**2 / 12.0, 0.0)))
