"""From the times that were written down to a uniform grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rdpi_gym.measurement.record import BoolArray
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

JITTER = 0.01
"""Largest deviation of a time step from the mean step, over it, that counts as uniform."""
_WORTH_SAYING = 1e-4
_GAP_STEPS = 5.0  # a longer step is a hole in the record, not jitter
_DECIMALS = 12
_FEWEST, _BOTH = 16, 0.05  # samples; share of the steps that the rarer length has
_EXACT = 1e-3  # of a decimal: so far a time may be off it by the arithmetic of a converted unit
_LARGEST_GROWTH = 10
_HALF = 0.55  # of a decimal: no stamp of an even clock is rounded by more
_NEARLY = 0.9  # of an interpolated sample is made of samples that count


@dataclass(frozen=True)
class Grid:
    """A record on uniform times.

    Parameters
    ----------
    t_s
        Times (s), (M,).
    ts_s
        Sampling time (s).
    columns
        The other columns, each (M,).
    measured
        (M,) bool; False inside a hole of the record, where values are only interpolated.
    remarks
        What was done.
    jitter_s
        As of the record.
    """

    t_s: Array
    ts_s: float
    columns: Mapping[str, Array]
    measured: BoolArray
    remarks: tuple[str, ...]
    jitter_s: float = 0.0


def rounding(t_s: Array) -> float:
    """Return the decimal to which the times of an even clock were rounded (s), or 0.

    Its steps are two neighbouring multiples of the decimal, or one, and no time is farther from
    the even grid than rounding puts it.

    Examples
    --------
    >>> rounding(np.round(3.328e-4 * np.arange(1000), 4)), rounding(1e-3 * np.arange(1000))
    (0.0001, 0.0)
    """
    if t_s.size < _FEWEST or not np.isfinite(t_s).all() or t_s[-1] <= t_s[0]:
        return 0.0
    span, mean = float(t_s[-1] - t_s[0]), float(t_s[-1] - t_s[0]) / (t_s.size - 1)
    even = np.linspace(t_s[0], t_s[-1], t_s.size)
    for decimals in range(-3, _DECIMALS):
        decimal = 10.0**-decimals
        if decimal < JITTER * mean:
            return 0.0
        if decimal > span:
            continue
        ticks = t_s / decimal
        whole = np.round(ticks)
        if np.max(np.abs(ticks - whole)) > max(_EXACT, 1e-15 * float(np.max(np.abs(ticks)))):
            continue
        steps = np.diff(whole)
        longer = float(np.mean(steps > steps.min()))
        near = float(np.max(np.abs(t_s - even))) <= 1.01 * decimal
        # of a few steps that are longer, each is a sample that was lost
        both = steps.max() - steps.min() == 1 and _BOTH < longer < 1.0 - _BOTH
        return decimal if steps.min() >= 0 and both and near else 0.0
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
    were rounded, the samples stay as they are and the times become the uniform grid between the
    first and the last one. Else the columns are interpolated linearly at the median step
    (``period`` keeps its last value).

    Parameters
    ----------
    t_s
        Times (s), (N,), strictly increasing.
    columns
        Other columns by our name, each (N,).
    where
        File, for the error line.
    scored
        (N,) bool, where a sample counts; everywhere by default.
    sampling_time_s
        What the user says of the step (s): it holds where the times were rounded.

    Raises
    ------
    InputError
        A hole so long that the grid would have more than ten times the samples.

    Examples
    --------
    >>> grid = to_uniform(np.array([0.0, 1.0, 2.0, 4.0]), {"u": np.array([0.0, 1, 2, 4])}, "run.csv")
    >>> grid.t_s.tolist(), grid.columns["u"].tolist()
    ([0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 1.0, 2.0, 3.0, 4.0])
    """
    samples = t_s.size
    steps = np.diff(t_s)
    median = float(np.median(steps))
    even = np.linspace(t_s[0], t_s[-1], samples)
    ts_s = float(t_s[-1] - t_s[0]) / (samples - 1)
    jitter = float(np.max(np.abs(steps - ts_s))) / ts_s
    counts = np.ones(samples, dtype=np.bool_) if scored is None else scored
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
    # small deviations of one sign would add up to a clock that is wrong by whole samples
    if jitter <= JITTER and np.max(np.abs(t_s - even)) <= ts_s / 2:
        said = f"time steps jitter by up to {100 * jitter:.2g} % of the mean step: taken as even"
        is_said = jitter > _WORTH_SAYING
        return Grid(even, ts_s, columns, counts, (said,) if is_said else (), off_even(t_s, ts_s))

    length = (t_s[-1] - t_s[0]) / median
    if length > _LARGEST_GROWTH * samples:
        k = int(np.argmax(steps))
        raise InputError(
            f"{where}: time jumps from {t_s[k]:g} to {t_s[k + 1]:g} s where the median step is "
            f"{median:g} s; put what follows into a file of its own"
        )
    grid = t_s[0] + median * np.arange(int(np.floor(length * (1 + 1e-12))) + 1)
    last = np.clip(np.searchsorted(t_s, grid, side="right") - 1, 0, samples - 2)
    holes = steps > _GAP_STEPS * median
    from_sample = np.minimum(grid - t_s[last], t_s[last + 1] - grid)
    measured = ~(holes[last] & (from_sample > median / 2))
    remarks: tuple[str, ...] = (
        f"time steps differ by up to {100 * jitter:.3g} % from the mean step: resampled at "
        f"the median step, {median:.6g} s, by linear interpolation, {samples} samples became {grid.size}",
    )
    if holes.any():
        remarks += (
            f"left out of the error: {int(np.sum(~measured))} samples interpolated across "
            f"{int(np.sum(holes))} gap(s) longer than {_GAP_STEPS:g} steps",
        )
    resampled = {
        name: values[np.searchsorted(t_s, grid, side="right") - 1]
        if name == "period"
        else np.interp(grid, t_s, values)
        for name, values in columns.items()
    }
    # what lies beside a sample that does not count is made of it
    beside = np.interp(grid, t_s, counts.astype(np.float64))
    return Grid(
        grid, median, resampled, measured & (beside > _NEARLY), remarks, off_even(t_s, median)
    )


def off_even(t_s: Array, ts_s: float) -> float:
    """Return by how much times are off an even clock, from one to the next (s rms), or 0.

    A clock that runs slowly off is none, nor is a sample that was lost.

    Parameters
    ----------
    t_s : float64[N]
        Times (s).
    ts_s
        Step of the clock (s).

    Examples
    --------
    >>> t = np.arange(20_000) * 1e-3
    >>> shaken = t + np.random.default_rng(0).normal(0.0, 2e-5, t.size)
    >>> off_even(t, 1e-3), float(round(1e6 * off_even(shaken, 1e-3)))
    (0.0, 20.0)
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
