"""The recorded command beside the displacement: a lag between their clocks, a clipped command rebuilt."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.diagnosis.features.cycles import BoolArray, runs
from rdpi_gym.identification.least_squares import bounded_least_squares
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.duhem import Duhem
from rdpi_gym.plant.cores.play import play_columns
from rdpi_gym.support.arrays import Array

_PLAYS = 10
_SPREAD = 1.5
_POWERS = 5
_MOST = 8_000  # samples of a record that are looked at
_REACH = 5  # samples
_FEWEST = 200
_LEAST_LEAD, _LEAST_LAG = 0.2, 0.4  # samples
_EVIDENCE = 1.3  # times the mean square without the shift
_KNOWN = 0.15  # of the displacement: what may be left where a shift is believed
_AGREE, _MOSTLY = 0.35, 0.8  # samples; share of the evidence
_UNLIKE = 1.5  # times the sampling time
_WHOLE = 0.2  # samples from a whole number
# Of the squares that plays leave at their best shift, what stops leave where loops turn clockwise.
_CLOCKWISE = 0.5
# The same where branches bend exponentially after every turn, and no clock is off; lengths over
# which they do, of half of the swing.
_BENT, _LENGTHS = 0.25, tuple(0.05 * 1.8**k for k in range(8))


@dataclass(frozen=True)
class Lag:
    """Lag of a record's displacement behind its command."""

    record: str  # name of the record
    samples: float  # the lag (samples); negative where the displacement leads
    ts_s: float  # sampling time (s)
    gain: float  # mean square without it over mean square with it
    left: float  # share of the displacement (rms) that is left with it
    inside: bool  # whether it lies within the reach of the search

    @property
    def certain(self) -> bool:
        """Whether the shift makes a difference that noise and a poor model do not make."""
        return self.inside and self.gain > _EVIDENCE and self.left < _KNOWN

    @property
    def leads(self) -> bool:
        """Whether the displacement moves before its command does."""
        return self.certain and self.samples <= -_LEAST_LEAD


def leads_by(lags: Sequence[Lag]) -> Mapping[str, float]:
    """Return by how many samples the displacement leads, by the name of the record.

    Where records of unlike sampling times agree in samples, or in seconds, all are meant: a fast
    record hides a lead behind what the plant itself lags. A record that leads while more of those that
    are sampled as slowly lag for sure is not believed: dynamics that plays do not have, such as a mode at
    a harmonic of a sine, turn a record early or late.
    """
    leading = [each for each in lags if each.leads]
    found = [each for each in leading if _deny(each, lags) <= len(leading)]
    if not found:
        return {}
    steps = [each.ts_s for each in found]
    weights = [float(np.log(each.gain)) for each in found]
    by_samples = [-each.samples for each in found]
    by_seconds = [-each.samples * each.ts_s for each in found]
    if max(steps) > _UNLIKE * min(steps):
        samples = _agreed(by_samples, weights, [1.0] * len(found))
        if samples is not None:
            return {each.record: whole(samples) for each in lags}
        seconds = _agreed(by_seconds, weights, steps)
        if seconds is not None:
            return {each.record: whole(seconds / each.ts_s) for each in lags}
    return {each.record: whole(-each.samples) for each in found}


def _deny(leads: Lag, lags: Sequence[Lag]) -> int:
    """Count records of at least this sampling time that lag significantly."""
    slow = (each for each in lags if each.ts_s * _UNLIKE >= leads.ts_s)
    return sum(each.certain and each.samples >= _LEAST_LAG for each in slow)


def _agreed(
    values: Sequence[float], weights: Sequence[float], units: Sequence[float]
) -> float | None:
    """Mean of the values about the median, where most of the evidence lies there; else None."""
    order = np.argsort(values)
    x, w, unit = (np.asarray(entry)[order] for entry in (values, weights, units))
    middle = float(x[int(np.searchsorted(np.cumsum(w), 0.5 * float(w.sum())))])
    near = np.abs(x - middle) <= _AGREE * unit
    if float(w[near].sum()) < _MOSTLY * float(w.sum()):
        return None
    return float(np.average(x[near], weights=w[near]))


def whole(samples: float) -> float:
    """Round a shift where it is close to whole samples, as a recorder makes it."""
    return float(round(samples)) if abs(samples - round(samples)) < _WHOLE else samples


def late_by(lags: Sequence[Lag]) -> float:
    """Return the samples by which every record is late whatever its sampling time, or 0.

    A delay of the plant is a time; only a recorder is late by samples.
    """
    certain = [each for each in lags if each.certain and each.samples >= _LEAST_LAG]
    if len(certain) < 2 or any(each.inside and each.samples < _LEAST_LAG for each in lags):
        return 0.0
    slow = max(certain, key=lambda each: each.ts_s)
    # what is late by less time than the slowest bounds a delay of the plant
    fast = min(certain, key=lambda each: each.samples * each.ts_s)
    if fast.samples * fast.ts_s > 0.5 * slow.samples * slow.ts_s:
        return 0.0
    return min(each.samples for each in certain)


def moved(record: Record, samples: float) -> tuple[Array, BoolArray]:
    """Move a record's displacement later by some samples; where nothing is known it stands."""
    from scipy.interpolate import CubicSpline

    y = record.y_um
    lost = np.zeros(y.size, dtype=np.bool_)
    lost[: int(np.ceil(samples))] = True
    k = np.arange(y.size)
    if samples == round(samples):
        return y[np.maximum(k - int(samples), 0)], lost
    return np.asarray(CubicSpline(k, y)(np.maximum(k - samples, 0.0))), lost


def lag(record: Record, bad: BoolArray) -> Lag | None:
    """Estimate the lag between command and displacement; hysteresis itself is none.

    Play operators with weights that are not negative, fitted for each shift: they turn where the
    command turns, so what turns earlier has another clock. Where stop operators explain more of a
    record that leads, its loops turn clockwise, and the lag is theirs; where what bends exponentially
    after every turn explains much more, nothing leads either.
    """
    part = slice(0, min(record.u_V.size, _MOST))
    u, y = record.u_V[part], record.y_um[part]
    rows = np.flatnonzero(~bad[part])
    rows = rows[(rows >= _REACH + 1) & (rows < u.size - _REACH - 1)]
    if rows.size < _FEWEST:
        return None
    columns = _columns(u)
    target = y[rows] - y[rows].mean()
    if not target @ target > 0.0:  # too small to be squared, as well
        return None
    found = _best_lag(record, columns, target, rows)
    if found.samples < 0.0:
        columns[1:] *= -1.0  # beside a free slope, stops are plays turned round
        stops = _best_lag(record, columns, target, rows)
        if stops.left**2 < _CLOCKWISE * found.left**2:
            # a small stop between two of these looks like a lead: none is told here
            return stops if stops.samples >= 0.0 else replace(stops, samples=0.0, gain=1.0)
    if found.leads and _bent(u, columns, target, rows) < _BENT * found.left**2:
        return replace(found, samples=0.0, gain=1.0)
    return found


def _bent(u: Array, columns: Array, target: Array, rows: NDArray[np.intp]) -> float:
    """Return the share of the squares that operators which turn with the command leave, of any sign.

    Beside plays, those are lengths that follow the command and settle exponentially along its way,
    as in the models of Duhem, Dahl and Bouc-Wen.
    """
    x = (u - u[0]) / (0.5 * float(np.ptp(u)))
    bends = [Duhem(0.0, 1.0, length).responses(x, x, np.zeros(2))[:, 1] for length in _LENGTHS]
    every = np.vstack([*(columns[0] ** k for k in range(1, _POWERS + 1)), columns[1:], *bends])
    known = every[:, rows] - every[:, rows].mean(axis=1, keepdims=True)
    gram, products = known @ known.T, known @ target
    solved = np.linalg.solve(gram + 1e-10 * np.trace(gram) * np.eye(len(gram)), products)
    left = target - solved @ known
    return float(left @ left / (target @ target))


def _best_lag(record: Record, columns: Array, target: Array, rows: NDArray[np.intp]) -> Lag:
    """Return the shift of the operators that leaves least of the displacement."""
    power = float(target @ target)

    def left(shift: float) -> float:
        return _left(columns, target, rows, shift)

    whole = np.arange(-_REACH, _REACH + 1)
    course = [left(float(shift)) for shift in whole]
    best = int(np.argmin(course))
    inside = 0 < best < whole.size - 1
    shift, least = float(whole[best]), course[best]
    width = 1.0
    while inside and width > 0.03:
        width *= 0.5
        tried = {shift + side * width: left(shift + side * width) for side in (-1.0, 1.0)}
        nearest = min(tried, key=lambda key: tried[key])
        if tried[nearest] < least:
            shift, least = nearest, tried[nearest]
    before = course[_REACH]
    return Lag(
        record.name,
        shift,
        record.ts_s,
        before / max(least, 1e-12 * power),
        float(np.sqrt(least / power)),
        inside,
    )


def _columns(u: Array) -> Array:
    """The command and what plays make of it, ``(K, N)``, all of order one."""
    x = (u - 0.5 * float(u.max() + u.min())) / (0.5 * float(np.ptp(u)))
    thresholds = (np.arange(1, _PLAYS + 1) / (_PLAYS + 1.0)) ** _SPREAD
    plays = np.empty((_PLAYS, u.size))
    play_columns(x, np.zeros_like(x), thresholds, 0.0, np.full(_PLAYS, x[0]), plays)
    return np.vstack([x, plays])


def _left(columns: Array, target: Array, rows: NDArray[np.intp], shift: float) -> float:
    """Sum of squares that the plays leave where they are moved by some samples."""
    whole = int(np.floor(shift))
    part = shift - whole
    moved = columns[:, rows - whole]
    if part:
        moved = (1.0 - part) * moved + part * columns[:, rows - whole - 1]
    # polynomials of the command bend a loop without moving its turning points
    free = [np.ones(rows.size), moved[0]]
    for _ in range(_POWERS - 1):
        free.append(2.0 * moved[0] * free[-1] - free[-2])
    every = np.vstack([*free, moved[1:], target])
    gram = every @ every.T
    known = len(free)
    ridge = 1e-12 * np.trace(gram[:known, :known]) * np.eye(known)
    solved = np.linalg.solve(gram[:known, :known] + ridge, gram[:known, known:])
    rest = gram[known:, known:] - gram[known:, :known] @ solved
    gram, products, power = rest[:-1, :-1], rest[:-1, -1].copy(), float(rest[-1, -1])
    gram = np.ascontiguousarray(gram)
    every = np.ones(len(gram), dtype=np.bool_)
    weights, _ = bounded_least_squares(gram, products, every, 0.0, every)
    return max(float(power - 2.0 * weights @ products + weights @ gram @ weights), 0.0)


_TAPS = 32  # samples to either side from which the linear part is taken
_INVERSE_PLAYS = 12
_ROUNDS = 2  # a third changes nothing
_RIDGE = 1e-9
_LEAST, _MOST_ROWS = 4, 20_000  # samples for each weight that is fitted, and samples of all
_POOR = 0.1  # of the swing: an inverse that misses the known command by more tells nothing


def rebuilt_command(
    record: Record, unknown: BoolArray, bad: BoolArray
) -> tuple[Array, float] | None:
    """Tell from the displacement what was commanded where the recorded command is clipped.

    Notes
    -----
    The plant is taken as play operators followed by a linear filter, its inverse as the inverse
    filter followed by play operators (the inverse of a Prandtl-Ishlinskii model is one, Kuhnen).
    Both are fitted by least squares where the command is known, in turns: the filter from the
    command that is rebuilt so far, the inverse plays from the displacement through that filter.
    What the inverse misses on either side of a stretch is taken from it in a straight line.
    """
    u = record.u_V
    y = record.y_um - record.y_um.mean()
    known = np.flatnonzero(~(unknown | bad) & record.error_mask)
    if known.size < _LEAST * (2 * _TAPS + _INVERSE_PLAYS + 5):
        return None
    rows = known[:: -(-known.size // _MOST_ROWS)]
    slow = np.vander(np.linspace(-1.0, 1.0, u.size), 3)
    near = _near(y, rows)
    weights = _fitted(np.hstack([slow[rows], near]), u[rows])
    inverse = slow @ weights[:3] + _filtered(y, weights[3:])
    command = _joined(inverse, u, unknown)
    others = np.delete(np.arange(2 * _TAPS + 1), _TAPS)
    for _ in range(_ROUNDS):
        plays = _plays(command, first=0)
        apart = y[rows, None] - near[:, others]
        weights = _fitted(np.hstack([apart, slow[rows], plays[rows]]), y[rows])
        taps = np.zeros(2 * _TAPS + 1)
        taps[others] = weights[: others.size]
        taps[_TAPS] = 1.0 - taps.sum()
        before_filter = _filtered(y, taps)
        inverse_plays = _plays(before_filter, first=1)
        columns = [slow[rows], inverse_plays[rows], _near(before_filter, rows)]
        weights = _fitted(np.hstack(columns), u[rows])
        inverse = slow @ weights[:3] + inverse_plays @ weights[3 : 3 + _INVERSE_PLAYS]
        inverse = inverse + _filtered(before_filter, weights[3 + _INVERSE_PLAYS :])
        command = _joined(inverse, u, unknown)
    missed = float(np.sqrt(np.mean((inverse - u)[known] ** 2)))
    return None if missed > _POOR * float(np.ptp(u)) else (command, missed)


def _near(x: Array, rows: np.ndarray[tuple[int], np.dtype[np.intp]]) -> Array:
    """Samples about each of some rows, ``(rows, 2 reach + 1)``; the ends are held."""
    at = np.clip(rows[:, None] + np.arange(-_TAPS, _TAPS + 1), 0, x.size - 1)
    return np.asarray(x[at])


def _filtered(x: Array, weights: Array) -> Array:
    """Weigh the samples about each sample: what `_near` gives, times the weights."""
    return np.asarray(np.correlate(np.pad(x, _TAPS, mode="edge"), weights, "valid"))


def _plays(x: Array, first: int) -> Array:
    """Play operators with thresholds up to half of the swing, ``(N, plays)``, from `first` on."""
    rest = float(np.ptp(x)) * np.linspace(0.0, 0.5, _INVERSE_PLAYS + 1)[first:]
    columns = np.empty((rest.size, x.size))
    play_columns(x, np.zeros(x.size), rest, 0.0, np.zeros(rest.size), columns)
    return columns.T


def _fitted(columns: Array, target: Array) -> Array:
    """Least squares with a ridge that is small beside every column."""
    size = np.sqrt(np.mean(columns**2, axis=0))
    scaled = columns / np.where(size > 0.0, size, 1.0)
    gram = scaled.T @ scaled / len(target) + _RIDGE * np.eye(size.size)
    weights = np.linalg.solve(gram, scaled.T @ target / len(target))
    return np.asarray(weights / np.where(size > 0.0, size, 1.0))


def _joined(inverse: Array, u: Array, unknown: BoolArray) -> Array:
    """The command, and where it is unknown the inverse, moved to meet it at both ends."""
    command = u.copy()
    middle = 0.5 * (float(u.max()) + float(u.min()))
    for first, last in runs(unknown):
        missed = [u[k] - inverse[k] for k in (first - 1, last) if 0 <= k < u.size]
        told = inverse[first:last] + np.linspace(missed[0], missed[-1], last - first + 2)[1:-1]
        beyond = np.maximum if u[first] > middle else np.minimum
        command[first:last] = beyond(told, u[first:last])
    return command
