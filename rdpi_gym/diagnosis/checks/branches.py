"""Branches between reversals: saturation, and memory from before a record."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rdpi_gym.diagnosis.checks.check import Check, cannot_tell, zone_of
from rdpi_gym.diagnosis.features.cycles import HalfCycles, crossing
from rdpi_gym.diagnosis.features.noise import rough_part
from rdpi_gym.diagnosis.notices import statement
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array

SATURATION_PERCENT = 0.5
"""Fall of the gain from the inner fifths of a branch to its last (%)."""
_WIDE = 0.7  # of the widest swing: branches that count
_FIFTHS = 5
_FEWEST = 8  # samples in a fifth
_BACK, _NOISY = 0.01, 8.0  # of the way; times the roughness of a measured command
_AS_LONG = 0.9  # of the time of an earlier fifth: the last is no faster


def saturation(records: Sequence[tuple[Record, HalfCycles]], span_V: float) -> Check:
    """Fall of the gain towards the end of wide, slow branches.

    After a reversal more and more plays slide, each with a weight that is not negative, so the
    slope of displacement over command grows along a branch. The mean of rising and falling
    branches is taken, in which a quadratic asymmetry cancels.
    """
    best: tuple[float, Array, Array, str] | None = None
    for record, cycles in records:
        found = _slopes(record, cycles, _WIDE * span_V)
        if found is not None and (best is None or found[0] < best[0]):
            best = (*found, record.name)
    if best is None or not np.any(best[1][2:4]):
        return cannot_tell("saturation", "saturation/none", "slow triangles")
    _, slope, error, name = best
    inner = int(np.argmax(np.abs(slope[2:4]))) + 2
    change = 100.0 * (slope[4] / slope[inner] - 1.0)
    uncertain = 100.0 * float(np.hypot(error[4], error[inner])) / abs(slope[inner])
    zone = zone_of(change, uncertain, SATURATION_PERCENT)
    kind = zone if zone == "no" or (zone == "yes" and change < 0) else "cannot tell"
    way = "grows" if kind == "cannot tell" and change > 0 else "falls"
    text = statement(f"saturation/{kind}/{way}", record=name, percent=change)
    advice = statement("slow triangles") if kind == "cannot tell" else None
    return Check(
        "saturation", float(change), SATURATION_PERCENT, "%", kind, text, advice, ("saturation",)
    )


def _slopes(
    record: Record, cycles: HalfCycles, width_V: float
) -> tuple[float, Array, Array] | None:
    """Fastest rate (V/s), and slope with its error in each fifth of wide branches (µm/V)."""
    noise = rough_part(record.y_um)
    by_way: dict[bool, list[tuple[Array, Array]]] = {True: [], False: []}
    rate = 0.0
    span = cycles.spans(record.u_V)
    for h in np.flatnonzero(cycles.whole & (span >= width_V)):
        part = slice(int(cycles.edges[h]), int(cycles.edges[h + 1]))
        u, y = record.u_V[part], record.y_um[part]
        if u.size >= _FIFTHS * _FEWEST:
            slopes = _by_fifth(u, y)
            if slopes is not None:
                by_way[bool(cycles.rising[h])].append(slopes)
                rate = max(rate, float(np.max(np.abs(np.diff(u)))) / record.ts_s)
    if not (by_way[True] and by_way[False]):
        return None
    ways = []
    for way in by_way.values():
        slope = np.mean([s for s, _ in way], axis=0)
        spread = noise * np.sqrt(np.mean([e for _, e in way], axis=0) / len(way))
        ways.append((slope, spread))
    slope = 0.5 * (ways[0][0] + ways[1][0])
    return rate, slope, 0.5 * np.hypot(ways[0][1], ways[1][1])


def _by_fifth(u: Array, y: Array) -> tuple[Array, Array] | None:
    """Slope in each fifth of the way, and the inverse of the sum of squares that it rests on.

    None where the command comes back in between, or is faster in the last fifth: thresholds that
    grow with the rate let the gain fall there.
    """
    way = (u - u[0]) / (u[-1] - u[0])
    slack = _BACK + _NOISY * rough_part(way)
    if float(np.max(np.maximum.accumulate(way) - way)) > slack:
        return None
    fifth = np.clip((way * _FIFTHS).astype(np.intp), 0, _FIFTHS - 1)
    taken = np.bincount(fifth, minlength=_FIFTHS)
    if taken[4] < _AS_LONG * max(taken[2], taken[3]):
        return None
    slope, inverse = np.empty(_FIFTHS), np.empty(_FIFTHS)
    for i in range(_FIFTHS):
        here = fifth == i
        if np.count_nonzero(here) < _FEWEST:
            return None
        x = u[here] - u[here].mean()
        squares = float(x @ x)
        if squares == 0.0:
            return None
        slope[i], inverse[i] = float(x @ y[here]) / squares, 1.0 / squares
    return slope, inverse


MEMORY_PERCENT = 5.0
"""Distance of a record's start from where it should be (% of half the loop's opening)."""
_ROUGH_PERCENT = 15.0  # the same, where the stage comes from 0 V, far from the loop's middle
_CENTRED = 0.03  # of the swing: the loop stands about the record's start
_REACH = 0.3  # of the swing: it goes at least so far to both sides
_AT_ZERO = 0.02  # of the swing: a start at 0 V
_FROM_AFAR = 0.45  # of the swing: so far from 0 V the stage comes along a whole branch
_SLOW = 0.1  # of the fastest rate: lags shift the start of faster records
_NOISE = 200.0  # per cent: of one sample and of the loop's middle, with some hum
_CLOSED = 1e-6  # of the displacement: a loop that does not open


def initial_memory(records: Sequence[tuple[Record, HalfCycles]]) -> Check:
    """Compare a record's first displacement with the loop that it goes through later.

    Without a past the plays begin in the middle: halfway between the falling and the rising branch
    of a loop that stands about the first command. Effects that are odd or small there (saturation,
    congruency, asymmetry) do not shift it, a remembered excursion does.
    """
    rates = [float(np.max(np.abs(np.diff(r.u_V)))) / r.ts_s for r, _ in records]
    limit = max(_SLOW * max(rates, default=0.0), min(rates, default=0.0))
    found = []
    for (record, cycles), rate in zip(records, rates, strict=True):
        place = _place(record, cycles) if rate <= limit else None
        if place is not None:
            found.append((*place, record.name))
    if not found:
        return cannot_tell("initial memory", "initial memory/none", "decaying sine")
    sure = [entry for entry in found if entry[1] < entry[2]]
    value, error, threshold, name = max(sure or found, key=lambda e: abs(e[0]) / e[2])
    zone = zone_of(value, error, threshold)
    text = statement(f"initial memory/{zone}", record=name, percent=abs(value))
    advice = None if zone == "no" else statement("decaying sine")
    return Check("initial memory", value, threshold, "%", zone, text, advice, ("initial_memory",))


def _place(record: Record, cycles: HalfCycles) -> tuple[float, float, float] | None:
    """Start above where it should be (% of half the loop's opening), its error and threshold."""
    u, edges = record.u_V, cycles.edges
    start, swing = float(u[0]), float(np.ptp(u))
    if abs(start) < _AT_ZERO * swing:
        expected, threshold = 0.0, MEMORY_PERCENT
    elif abs(start) > _FROM_AFAR * swing:
        expected, threshold = -100.0 * float(np.sign(start)), _ROUGH_PERCENT
    else:
        return None
    turns = u[np.maximum(edges - 1, 0)] - start
    size = np.abs(turns)
    so_far = np.maximum.accumulate(np.abs(u - start))[edges[2:] - 1]
    lesser = np.minimum(size[:-1], size[1:])
    about = (turns[:-1] * turns[1:] < 0) & (np.abs(np.diff(size)) < _CENTRED * swing)
    # before the loop has gone as far as anything did, it still holds the past
    widest = (lesser[:-1] > so_far - _CENTRED * swing) & (lesser[:-1] > _REACH * swing)
    moving = cycles.whole[:-1] & cycles.whole[1:]
    for h in np.flatnonzero(about[:-1] & widest & moving)[:1]:
        first, second = (slice(int(edges[i]) - 1, int(edges[i + 1])) for i in (h, h + 1))
        return _in_loop(record, first, second, bool(cycles.rising[h]), expected, threshold)
    return None


def _in_loop(
    record: Record,
    first: slice,
    second: slice,
    first_rises: bool,
    expected: float,
    threshold: float,
) -> tuple[float, float, float] | None:
    u, y, start = record.u_V, record.y_um, float(record.u_V[0])
    one, other = (crossing(u[part], y[part], start) for part in (first, second))
    if one is None or other is None:
        return None
    a, b = one[0], other[0]
    falling, rising = (b, a) if first_rises else (a, b)
    half, noise = 0.5 * (falling - rising), rough_part(y)
    if abs(half) <= max(5.0 * noise, _CLOSED * float(np.ptp(y))):
        return None
    value = 100.0 * (float(y[0]) - 0.5 * (a + b)) / half - expected
    return value, _NOISE * noise / abs(half), threshold
