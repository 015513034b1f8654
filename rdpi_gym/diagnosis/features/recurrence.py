"""Where the input rests, and recurrence of a residual where the input's history recurs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.diagnosis.features.cycles import half_cycles, steady_periods
from rdpi_gym.diagnosis.features.noise import rough_part
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array

# The history that has to agree: a period, or two typical cycles, at some delays, denser at the latest.
_DELAYS, _DENSER = 24, 1.5
_APART = 0.9  # of that history: times so far apart in one record are two
_ALIKE = 0.01  # of the record's swing (rms): two histories agree
_NOISY = 3.0  # times the roughness of a measured command
_SHORTEST, _SHARE = 64, 100  # a history without a period: samples, and one in so many of a record
_MOVES = 4.0  # times that tolerance: the command moves within a history
_QUERIES = 1000
_BLOCKS = 16
_FEWEST = 64  # samples of a repetition, or of a stretch at rest
_PIECES = 4  # of a repetition, so that two of them have a spread
_SAME = 5e-3  # of the swing (rms): two records have one command


@dataclass(frozen=True)
class Trace:
    """A record and what a model leaves of it."""

    record: Record
    residual_um: Array  # float64[N]: measured minus simulated displacement (µm)
    # bool[N]: samples of which an answer is wanted; the others are compared with
    asked: NDArray[np.bool_]


@dataclass(frozen=True)
class Recurrence:
    """The residual where the input's history recurs, in blocks of neighbouring samples."""

    share: float  # of the samples that are asked for, those whose history recurs
    counts: Array  # float64[B]: samples of each block that were looked at
    # float64[B]: sums (µm²) of the squared residual, and of its products with the residual that
    # other times of the same history have. Offset and slope of each repetition are taken off. The
    # noise and what does not follow from the input are in the squares and not in the products
    squares: Array
    repeated: Array


def recurrence(traces: Sequence[Trace]) -> Recurrence | None:
    """Compare a residual with itself at other times with the same recent history of the input.

    Notes
    -----
    The nearest neighbours in a space of delays, as in Kennel, Brown, Abarbanel, "Determining
    embedding dimension for phase-space reconstruction using a geometrical construction", Phys. Rev.
    A 45, 1992. A mean over one cycle is taken off the residual, so that slow drift repeats nothing.
    A disturbance that is locked to the command's cycle, as hum may be, repeats like its effect.
    """
    lengths = [_cycle(t.record) for t in traces]
    flat = [_levelled(t, n) for t, n in zip(traces, lengths, strict=True)]
    step = max(1, sum(int(np.count_nonzero(t.asked)) for t in traces) // _QUERIES)
    spans_s = [n * t.record.ts_s for t, n in zip(traces, lengths, strict=True)]
    octaves = [round(math.log2(span_s)) for span_s in spans_s]
    looked, rows = 0, []
    for octave in sorted(set(octaves)):
        members = [k for k, other in enumerate(octaves) if other == octave]
        pool = _pool(traces, flat, max(spans_s[k] for k in members))
        for k in members:
            wanted = np.flatnonzero(traces[k].asked & np.isfinite(flat[k]))[::step]
            looked += len(wanted)
            if pool is not None:
                rows.append(pool.products(traces[k].record, k, wanted, spans_s[k]))
    found = np.concatenate(rows) if rows else np.zeros((0, 2))
    if len(found) < _FEWEST:
        return None
    blocks = np.array_split(found, _BLOCKS)
    return Recurrence(
        len(found) / looked,
        np.array([float(len(block)) for block in blocks]),
        np.array([float(block[:, 0].sum()) for block in blocks]),
        np.array([float(block[:, 1].sum()) for block in blocks]),
    )


@dataclass(frozen=True)
class _Pool:
    """All samples with a history: its vector, whose it is, where it stands, and the residual."""

    vectors: Array
    owners: NDArray[np.intp]
    places: NDArray[np.intp]
    values: Array

    def products(
        self, record: Record, owner: int, wanted: NDArray[np.intp], span_s: float
    ) -> Array:
        """Square and product with the mean of the others (µm²) of the samples that recur, ``(N, 2)``."""
        from scipy.spatial import cKDTree

        own = np.flatnonzero((self.owners == owner) & np.isin(self.places, wanted))
        swing = max(_ALIKE * float(np.ptp(record.u_V)), _NOISY * rough_part(record.u_V))
        # while the command rests every sample is like every other, and nothing recurs
        own = own[np.ptp(self.vectors[own], axis=1) > _MOVES * swing]
        near = cKDTree(self.vectors).query_ball_point(self.vectors[own], swing * math.sqrt(_DELAYS))
        apart = _APART * span_s / record.ts_s
        found = []
        for at, others in zip(own, near, strict=True):
            other = np.array(others)
            far = np.abs(self.places[other] - self.places[at]) >= apart
            other = other[far | (self.owners[other] != owner)]
            if other.size:
                value = float(self.values[at])
                found.append((value * value, value * float(self.values[other].mean())))
        return np.array(found).reshape(-1, 2)


def _pool(traces: Sequence[Trace], values: Sequence[Array], span_s: float) -> _Pool | None:
    vectors, owners, places, kept = [], [], [], []
    for k, (trace, value) in enumerate(zip(traces, values, strict=True)):
        u, ts_s = trace.record.u_V, trace.record.ts_s
        delays = np.round(span_s * np.linspace(0.0, 1.0, _DELAYS) ** _DENSER / ts_s)
        at = np.flatnonzero(np.isfinite(value))
        at = at[at >= delays[-1]]
        vectors.append(u[at[:, None] - delays.astype(np.intp)])
        owners.append(np.full(at.size, k))
        places.append(at)
        kept.append(value[at])
    if not sum(map(len, places)):
        return None
    return _Pool(
        np.concatenate(vectors),
        np.concatenate(owners),
        np.concatenate(places),
        np.concatenate(kept),
    )


def _cycle(record: Record) -> int:
    """Samples of a period of the command, or of a typical cycle twice where it has none."""
    cycles = half_cycles(record.u_V, record.ts_s)
    periods = steady_periods(record, cycles)
    if periods is not None:
        return round(periods.length)
    # of a command without a period, more than a few samples: too many stretches are like those
    size, strokes = record.u_V.size, max(1, len(cycles.rising))
    return min(size, max(_SHORTEST, size // _SHARE, 4 * size // strokes))


def _levelled(trace: Trace, length: int) -> Array:
    """Residual without its mean over a cycle around each sample; NaN where it does not count."""
    counted = trace.record.error_mask
    sums = np.concatenate([[0.0], np.cumsum(np.where(counted, trace.residual_um, 0.0))])
    numbers = np.concatenate([[0.0], np.cumsum(counted, dtype=np.float64)])
    at = np.arange(counted.size)
    low, high = np.maximum(at - length // 2, 0), np.minimum(at + (length + 1) // 2, counted.size)
    mean = (sums[high] - sums[low]) / np.maximum(numbers[high] - numbers[low], 1.0)
    return np.where(counted, trace.residual_um - mean, np.nan)


def unrepeated_um2(traces: Sequence[Trace]) -> Array:
    """Mean squares (µm²) by which the residual differs between repetitions of the same input."""
    found = []
    for trace in traces:
        periods = steady_periods(trace.record, half_cycles(trace.record.u_V, trace.record.ts_s))
        if periods is None or periods.length < _FEWEST:
            continue
        rows = periods.folded(np.where(trace.record.error_mask, trace.residual_um, np.nan))
        rows = rows[min(periods.count // 2, periods.count - 2) :]
        found += [_half_square(b - a) for a, b in pairwise(rows)]
    own = {id(trace.record): trace for trace in traces}
    for first, second in same_command([trace.record for trace in traces]):
        a, b = own[id(first)], own[id(second)]
        size = min(first.u_V.size, second.u_V.size)
        counted = first.error_mask[:size] & second.error_mask[:size]
        differ = np.where(counted, b.residual_um[:size] - a.residual_um[:size], np.nan)
        found.append(_half_square(differ[wiped_from(first.u_V) :]))
    return np.concatenate(found) if found else np.zeros(0)


def _half_square(differ: Array) -> Array:
    """Half of the mean square of the pieces of a difference, its offset and slope taken off."""
    differ = differ[np.isfinite(differ)]
    if differ.size < _FEWEST:
        return np.zeros(0)
    x = np.linspace(-1.0, 1.0, differ.size)
    line = np.polynomial.polynomial.polyfit(x, differ, 1)
    left = differ - np.polynomial.polynomial.polyval(x, line)
    lost = left.size / (left.size - 2.0)
    return np.array([0.5 * lost * float(np.mean(p**2)) for p in np.array_split(left, _PIECES)])


def same_command(records: Sequence[Record]) -> list[tuple[Record, Record]]:
    """Find records with the same command: the first of each kind with each later one."""
    kinds: list[Record] = []
    pairs = []
    for record in sorted(records, key=lambda r: float(r.t_s[0])):
        like = next((other for other in kinds if _same(other, record)), None)
        if like is None:
            kinds.append(record)
        else:
            pairs.append((like, record))
    return pairs


def _same(a: Record, b: Record) -> bool:
    size = min(a.u_V.size, b.u_V.size)
    if abs(a.ts_s - b.ts_s) > 1e-3 * a.ts_s or size < 0.98 * max(a.u_V.size, b.u_V.size):
        return False
    span = float(np.ptp(a.u_V))
    return bool(np.sqrt(np.mean((a.u_V[:size] - b.u_V[:size]) ** 2)) <= _SAME * span)


def wiped_from(u_V: Array) -> int:
    """First sample at which the largest excursion to either side has been passed.

    What the plays remembered from before is wiped out there, as far as the record ever will.
    """
    margin = 0.01 * float(np.ptp(u_V))
    high = int(np.argmax(u_V >= u_V.max() - margin))
    low = int(np.argmax(u_V <= u_V.min() + margin))
    return max(high, low)


_FLAT = 1e-4  # of the command's widest swing: a rest stays within it
_NOISY_REST = 8.0  # times the roughness of a measured command
_FEWEST_AT_REST = 20
_BEFORE = 20.0  # times the tolerance: a move that ends in a rest is so large
_STOPS, _FEWEST_BEFORE = 4, 5  # of the rest's length; samples: within this it comes so far


@dataclass(frozen=True, eq=False)
class Rest:
    """A stretch of constant command."""

    record: Record  # where it stands
    # Its samples are ``first`` to ``last - 1``
    first: int
    last: int
    # Net change of the command in the move that ended in it; 0 at a record's beginning
    move_V: float

    @property
    def duration_s(self) -> float:
        """Duration from the first to the last sample (s)."""
        return (self.last - 1 - self.first) * self.record.ts_s


@njit(cache=True)
def _flat_runs(u: Array, tolerance: float, fewest: int) -> NDArray[np.intp]:
    runs = np.empty((u.shape[0] // fewest + 1, 2), dtype=np.intp)
    count = start = 0
    low = high = u[0]
    for k in range(1, u.shape[0] + 1):
        if k < u.shape[0]:
            low_k, high_k = min(low, u[k]), max(high, u[k])
            if high_k - low_k <= tolerance:
                low, high = low_k, high_k
                continue
        if k - start >= fewest:
            runs[count, 0], runs[count, 1] = start, k
            count += 1
        if k < u.shape[0]:
            start, low, high = k, u[k], u[k]
    return runs[:count]


def find_rests(record: Record, span_V: float) -> list[Rest]:
    """Find where a record's command rests; the crest of a slow wave is no rest, nor its shoulder."""
    u = record.u_V
    if u.size < _FEWEST_AT_REST:
        return []
    tolerance = max(_FLAT * span_V, _NOISY_REST * rough_part(u))
    rests: list[Rest] = []
    for first, last in _flat_runs(np.ascontiguousarray(u), tolerance, _FEWEST_AT_REST):
        # a move that ends in a rest stops; a shoulder of a wave, however flat, does not
        before = u[max(0, first - max((last - first) // _STOPS, _FEWEST_BEFORE)) : first]
        far = before.size > 0 and float(np.max(np.abs(before - u[first]))) > _BEFORE * tolerance
        if first == 0 or far:
            end = rests[-1].last - 1 if rests else 0
            rests.append(Rest(record, int(first), int(last), float(u[first] - u[end])))
    return rests
