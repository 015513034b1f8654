"""Creep and drift: displacement at constant command, and under a command that is repeated."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rdpi_gym.diagnosis.checks.check import Check, Zone, cannot_tell, zone_of
from rdpi_gym.diagnosis.features.cycles import Periods
from rdpi_gym.diagnosis.features.recurrence import Rest, same_command, wiped_from
from rdpi_gym.diagnosis.notices import Statement, statement
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array

_BINS = 24
_EARLIER = 0.2  # of a rest
_FEWEST = 10
_PASSES = 3
_AFTER_CORNER = 3  # samples: what follows a corner within them is no creep
_NEAR_ZERO = 0.02  # of a record's swing


@dataclass(frozen=True)
class RestFit:
    """Course of the displacement at constant command; each number with its standard error."""

    # Share of each step of the displacement that a decade of time adds (1)
    creep_per_decade: tuple[float, float]
    drift_um_s: tuple[float, float]  # what is added whatever the command did (µm/s)
    gain_drift_per_s: tuple[float, float]  # what is added in proportion to the displacement (1/s)
    # How many rests, and how many decades of time the longest covers
    rests: int
    decades: float
    level_um: float  # how far from zero they stand (µm, rms)
    longest_s: float  # how long the longest lasts (s)


def fit_rests(rests: Sequence[Rest]) -> RestFit | None:
    """Regress displacement in rests on the logarithm of time since each step, and on the clock.

    Notes
    -----
    Creep by superposition: every increment Δy of the record goes on as g Δy lg(t), whatever the
    command did in between, so moves need not be steps.
    """
    records = {rest.record.name: rest.record for rest in rests}
    longest_s = max((rest.duration_s for rest in rests), default=0.0)
    zeros = {name: zero_um(record) for name, record in records.items()}
    found: RestFit | None = None
    courses = {name: _creep_course(record.y_um) for name, record in records.items()}
    for _ in range(_PASSES):
        blocks = [
            _block(rest, courses[rest.record.name], zeros[rest.record.name]) for rest in rests
        ]
        found = _regress([block for block in blocks if block is not None], longest_s)
        if found is None:
            return None
        for name, record in records.items():  # what has crept so far does not creep again
            crept = found.creep_per_decade[0] * courses[name]
            courses[name] = _creep_course(record.y_um - crept)
    return found


def later(rests: Sequence[Rest]) -> list[Rest]:
    """Return the later part of each rest, in which a lag is over and creep goes on."""
    return [
        replace(rest, first=rest.first + int(_EARLIER * (rest.last - rest.first)))
        for rest in rests
        if rest.first > 0
    ]


def _regress(blocks: Sequence[_Block], longest_s: float) -> RestFit | None:
    if not blocks:
        return None
    rows = [np.column_stack([b.creep, b.clock_s, b.level_um * b.clock_s]) for b in blocks]
    # one offset a rest: its mean, weighted like the rest, is taken out
    left = np.concatenate([_centred(x, b.weight) for x, b in zip(rows, blocks, strict=True)])
    right = np.concatenate([_centred(b.y_um[:, None], b.weight) for b in blocks])[:, 0]
    if len(right) < len(blocks) + 8:
        return None
    values, error = np.zeros(3), np.full(3, np.inf)
    seen = _independent(left)
    if seen:
        scaled = left[:, seen] / np.linalg.norm(left[:, seen], axis=0)
        solution = np.linalg.lstsq(scaled, right, rcond=None)[0]
        misfit = right - scaled @ solution
        variance = float(misfit @ misfit) / (len(right) - len(blocks) - len(seen))
        scale = np.linalg.norm(left[:, seen], axis=0)
        values[seen] = solution / scale
        error[seen] = np.sqrt(np.diag(np.linalg.inv(scaled.T @ scaled)) * variance) / scale
    creep, drift, gain = zip(values.tolist(), error.tolist(), strict=True)
    level = float(np.sqrt(np.mean([b.level_um**2 for b in blocks])))
    return RestFit(
        creep, drift, gain, len(blocks), max(b.decades for b in blocks), level, longest_s
    )


def _independent(columns: Array) -> list[int]:
    """Columns that are no multiple of those before them.

    Nothing has crept in a record that is quiet from its beginning, and in a single rest drift and
    gain drift are the same: the latter is left out.
    """
    kept: list[int] = []
    largest = float(np.max(np.linalg.norm(columns, axis=0)))
    for i in range(columns.shape[1]):
        column = columns[:, i]
        length = float(np.linalg.norm(column))
        if length <= 1e-12 * largest:
            continue
        known = columns[:, kept]
        left = column - known @ np.linalg.lstsq(known, column, rcond=None)[0] if kept else column
        if float(np.linalg.norm(left)) > 1e-6 * length:
            kept.append(i)
    return kept


@dataclass(frozen=True, eq=False)
class _Block:
    """Means of a rest over bins of the logarithm of time."""

    y_um: Array
    creep: Array
    clock_s: Array
    level_um: float
    weight: Array
    decades: float


def _block(rest: Rest, course: Array, zero: float) -> _Block | None:
    r = rest.record
    first = rest.first + (_AFTER_CORNER if rest.first else 0)
    size = rest.last - first
    if size < _FEWEST:
        return None
    edges = np.unique(np.geomspace(1, size + 1, _BINS + 1).round().astype(np.intp)) - 1
    count = np.diff(edges)
    part = slice(first, rest.last)

    def means(x: Array) -> Array:
        return np.asarray(np.add.reduceat(x, edges[:-1]) / count)

    return _Block(
        means(r.y_um[part]),
        means(course[part]),
        means(r.t_s[part]),
        float(r.y_um[part].mean()) - zero,
        np.sqrt(count),
        float(np.log10(size)),
    )


def zero_um(record: Record) -> float:
    """Displacement (µm) about which a gain is counted: at 0 V, or in the middle where 0 V is not met."""
    near = np.abs(record.u_V) <= _NEAR_ZERO * max(float(np.ptp(record.u_V)), 1e-300)
    if near.any():
        return float(np.median(record.y_um[near]))
    return 0.5 * float(record.y_um.min() + record.y_um.max())


def _creep_course(y_um: Array) -> Array:
    """Sum of the increments of y, each times the logarithm of its age."""
    increments = np.diff(y_um, prepend=y_um[0])
    ages = np.log10(1.0 + np.arange(increments.size))
    size = 2 * increments.size
    product = np.fft.rfft(increments, size) * np.fft.rfft(ages, size)
    return np.asarray(np.fft.irfft(product, size)[: increments.size])


def _centred(x: Array, weight: Array) -> Array:
    mean = np.average(x, axis=0, weights=weight**2)
    return np.asarray((x - mean) * weight[:, None])


CREEP_PERCENT = 0.2
"""Creep (% of a step a decade): an actuator has 1 to 2."""
DRIFT_PERCENT_MIN = 0.02
"""Drift (% of the stroke a minute)."""
GAIN_DRIFT_PERCENT_MIN = 0.06
"""Change of the gain (% a minute)."""
MOST_CREEP_PERCENT = 10.0
"""No stack creeps more (% of a step a decade): what does is a lag."""
DRIFT_S = 1.0
"""A rest is so long before a drift by the minute may be read from it (s)."""
_GOES_ON = 0.5  # of the creep: so much of it is there in the later part of the rests
_LEAK = 0.25  # of the other's contribution: what may be mistaken for a drift
_CREEP_LEAK = 0.08  # a minute, of the creep of a decade
_NAMES = ("creep", "drift in holds", "gain drift in holds")


def holds(rests: Sequence[Rest], stroke_um: float) -> tuple[Check, Check, Check]:
    """Creep, drift and gain drift from how displacement goes on at constant command.

    In a rest a play operator gives a constant. Displacement in all rests is regressed on what
    every step before should add to it by lg(t) (creep), on the clock (drift), and on displacement
    times the clock (gain drift).
    """
    found = fit_rests(rests)
    if found is None or stroke_um == 0.0:
        creep, drift, gain = (cannot_tell(name, "holds/none", "stair of holds") for name in _NAMES)
        return creep, drift, gain
    return _creep(found, fit_rests(later(rests))), _drift(found, stroke_um), _gain_drift(found)


def _creep(found: RestFit, late: RestFit | None) -> Check:
    value, error = (100.0 * number for number in found.creep_per_decade)
    zone = zone_of(value, error, CREEP_PERCENT)
    if zone == "yes" and value < 0:
        zone = "cannot tell"
    lags = zone == "yes" and (value > MOST_CREEP_PERCENT or not _goes_on(found, late))
    text = statement(
        "creep/lag" if lags else f"creep/{zone}", rests=found.rests, longest=found.longest_s,
        percent=value, creep=(value, error), least=CREEP_PERCENT,
    )  # fmt: skip
    zone = "cannot tell" if lags else zone
    advice = statement("stair of holds") if zone == "cannot tell" else None
    known = value if math.isfinite(value) else None
    return Check(_NAMES[0], known, CREEP_PERCENT, "%/decade", zone, text, advice, ("creep",))


def _goes_on(found: RestFit, late: RestFit | None) -> bool:
    """Whether creep goes on in the later part of the rests, as far as they tell."""
    if late is None:
        return True
    value, error = late.creep_per_decade
    return not value + 3.0 * error < _GOES_ON * found.creep_per_decade[0]


def _drift(found: RestFit, stroke_um: float) -> Check:
    scale = 6000.0 / stroke_um
    value, error = (scale * number for number in found.drift_um_s)
    leak = _LEAK * scale * abs(found.gain_drift_per_s[0]) * found.level_um
    zone = _beyond(zone_of(value, error, DRIFT_PERCENT_MIN), value, leak, found)
    alone = not math.isfinite(found.gain_drift_per_s[1])
    text = statement(
        f"drift in holds/{zone}/{'alone' if alone else 'of two'}", rests=found.rests,
        drift=(value, error), least=DRIFT_PERCENT_MIN,
    )  # fmt: skip
    advice = statement("quiet minute") if zone == "cannot tell" else None
    effects = ("thermal_drift", "gain_drift") if alone else ("thermal_drift",)
    known = value if math.isfinite(value) else None
    return Check(_NAMES[1], known, DRIFT_PERCENT_MIN, "%/min", zone, text, advice, effects)


def _gain_drift(found: RestFit) -> Check:
    value, error = (6000.0 * number for number in found.gain_drift_per_s)
    level_um = max(found.level_um, 1e-300)
    leak = _LEAK * 6000.0 * abs(found.drift_um_s[0]) / level_um
    zone = _beyond(zone_of(value, error, GAIN_DRIFT_PERCENT_MIN), value, leak, found)
    text = statement(
        f"gain drift in holds/{zone}", rests=found.rests, drift=(value, error),
        least=GAIN_DRIFT_PERCENT_MIN,
    )  # fmt: skip
    advice = statement("repeat at the end") if zone == "cannot tell" else None
    known = value if math.isfinite(value) else None
    effects = ("gain_drift",)
    return Check(_NAMES[2], known, GAIN_DRIFT_PERCENT_MIN, "%/min", zone, text, advice, effects)


def _beyond(zone: Zone, value: float, leak: float, found: RestFit) -> Zone:
    """Take back a yes that another course, or creep that is not quite lg(t), may feign.

    A rest of a fraction of a second says nothing of what happens in a minute.
    """
    if zone == "yes" and found.longest_s < DRIFT_S:
        return "cannot tell"
    creep = _CREEP_LEAK * 100.0 * abs(found.creep_per_decade[0])
    return "cannot tell" if zone == "yes" and abs(value) < leak + creep else zone


GAIN_PERCENT = 0.1
"""Change of the gain (%)."""
OFFSET_PERCENT = 0.05
"""Shift of the displacement (% of its peak to peak)."""
_BLOCKS = 40
_FEWEST_PERIODS = 6


@dataclass(frozen=True)
class Repeat:
    """Changes from one run of a command to the next, with standard errors."""

    pair: Statement  # what was compared
    apart_s: float  # time between the two (s)
    gain: tuple[float, float]  # relative change of the gain (1)
    offset_um: tuple[float, float]  # shift at zero displacement (µm)
    span_um: float  # peak to peak of the displacement (µm)


def repeats(records: Sequence[Record], stretches: Sequence[Periods]) -> tuple[Check, Check]:
    """Drift and gain drift from records with the same command, or from the periods of one."""
    found = _between_records(records) or _between_periods(stretches)
    names = ("drift between repeats", "gain drift between repeats")
    if found is None:
        drift, gain = (
            cannot_tell(name, "repeats/none", "repeat at the very end") for name in names
        )
        return drift, gain
    offset, its_error = (100.0 * number / found.span_um for number in found.offset_um)
    value, error = (100.0 * number for number in found.gain)
    shift = {"least": OFFSET_PERCENT, "shift": found.offset_um[0]}
    return (
        _changed(names[0], found, (offset, its_error), shift, ("thermal_drift", "creep")),
        _changed(names[1], found, (value, error), {"least": GAIN_PERCENT}, ("gain_drift",)),
    )


def _changed(
    name: str, found: Repeat, change: tuple[float, float], values: Mapping[str, float],
    effects: tuple[str, ...],
) -> Check:  # fmt: skip
    zone = zone_of(*change, values["least"])
    text = statement(
        f"{name}/{zone}", pair=found.pair, apart=found.apart_s, percent=change[0], change=change,
        **values,
    )  # fmt: skip
    advice = statement("repeat at the very end") if zone == "cannot tell" else None
    return Check(name, change[0], values["least"], "%", zone, text, advice, effects)


def _between_records(records: Sequence[Record]) -> Repeat | None:
    pairs = [(a, b) for a, b in same_command(records) if b.t_s[0] >= a.t_s[-1]]
    if not pairs:
        return None
    a, b = max(pairs, key=lambda pair: float(pair[1].t_s[0] - pair[0].t_s[0]))
    size = min(a.u_V.size, b.u_V.size)
    known = slice(wiped_from(a.u_V), size)
    pair = statement("two records", first=a.name, second=b.name)
    return _compare(pair, float(b.t_s[0] - a.t_s[0]), a.y_um[known], b.y_um[known], zero_um(a))


def _between_periods(stretches: Sequence[Periods]) -> Repeat | None:
    long = [p for p in stretches if p.count >= _FEWEST_PERIODS]
    if not long:
        return None
    periods = max(long, key=lambda p: p.count * p.length * p.record.ts_s)
    rows = periods.folded(periods.record.y_um)
    few = max(1, (periods.count - 1) // 6)
    first, last = rows[1 : 1 + few].ravel(), rows[-few:].ravel()
    apart_s = (periods.count - 1 - few) / periods.frequency_hz
    pair = statement("two periods", record=periods.record.name)
    return _compare(pair, apart_s, first, last, float(first.mean()))


def _compare(pair: Statement, apart_s: float, a: Array, b: Array, zero: float) -> Repeat | None:
    if a.size < 2 * _BLOCKS or np.ptp(a) == 0.0:
        return None
    rows = np.column_stack([np.ones(a.size), a - zero, np.linspace(-0.5, 0.5, a.size)])
    inverse = np.linalg.pinv(rows.T @ rows)
    solution = inverse @ (rows.T @ (b - a))
    misfit = (b - a) - rows @ solution
    # what is left is no white noise: errors from how blocks of samples pull at the result
    scores = np.stack(
        [part.sum(axis=0) for part in np.array_split(rows * misfit[:, None], _BLOCKS)]
    )
    error = np.sqrt(np.diag(inverse @ (scores.T @ scores) @ inverse))
    return Repeat(
        pair, apart_s, (float(solution[1]), float(error[1])),
        (float(solution[0]), float(error[0])), float(np.ptp(a)),
    )  # fmt: skip
