"""How a displacement creeps or drifts while its command rests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rdpi_gym.diagnosis.features.rests import Rest
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
    """How displacement goes on while commands rest; each with its standard error.

    Parameters
    ----------
    creep_per_decade
        Share of each step of the displacement that a decade of time adds (1).
    drift_um_s
        What is added whatever the command did (µm/s).
    gain_drift_per_s
        What is added in proportion to the displacement (1/s).
    rests, decades
        How many rests, and how many decades of time the longest covers.
    level_um
        How far from zero they stand (µm, rms).
    longest_s
        How long the longest lasts (s).
    """

    creep_per_decade: tuple[float, float]
    drift_um_s: tuple[float, float]
    gain_drift_per_s: tuple[float, float]
    rests: int
    decades: float
    level_um: float
    longest_s: float


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
