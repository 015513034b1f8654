"""Checks of hysteresis loops: their shape, their branches and what they do at reversals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rdpi_gym.diagnosis.checks.check import Check, Zone, cannot_tell, zone_of
from rdpi_gym.diagnosis.features.cycles import HalfCycles, crossing
from rdpi_gym.diagnosis.features.noise import rough_part
from rdpi_gym.diagnosis.notices import statement
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array

CONGRUENCY_PERCENT = 0.4
"""Change of a loop's height from the middle of the range to its sides (%)."""
_ALIKE = 0.03  # of the span: two commands are the same
_RATE_ALIKE = 0.1
_BIASES_APART = 0.3  # of the span: two biases differ


@dataclass(frozen=True)
class Loop:
    """A closed loop: middle and span (V), mean rate (V/s), gain and its error (µm/V).

    The gain is the height of the loop over its span.
    """

    bias_V: float
    span_V: float
    rate_V_s: float
    gain_um_V: float
    error_um_V: float
    record: str


def congruency(loops: Sequence[Loop]) -> Check:
    """Change of the height of same-span loops with their bias."""
    groups = _groups(loops)
    if not groups:
        return cannot_tell("congruency", "congruency/none", "minor loops")
    values = [_curvature(group) for group in groups]
    best = min(range(len(values)), key=lambda i: values[i][1])
    (value, error), group = values[best], groups[best]
    zone = zone_of(value, error, CONGRUENCY_PERCENT)
    side = "higher" if value > 0 else "lower"
    found = statement(
        f"congruency/{zone}/{side}", span=group[0].span_V, record=group[0].record,
        percent=abs(value),
    )  # fmt: skip
    effects = ("saturation", "congruency") if zone == "yes" and value <= 0 else ("congruency",)
    advice = statement("minor loops") if zone == "cannot tell" else None
    return Check("congruency", value, CONGRUENCY_PERCENT, "%", zone, found, advice, effects)


def closed_loops(record: Record, cycles: HalfCycles) -> list[Loop]:
    """Find pairs of strokes that return to where they began, the first visit of each left out."""
    edges, u, y = cycles.edges, record.u_V, record.y_um
    turns = np.maximum(edges - 1, 0)
    noise = rough_part(y)
    found = []
    at = u[turns]
    span = np.abs(np.diff(at))
    h = np.arange(2, max(edges.size - 2, 2))
    apart = np.maximum(np.abs(at[h + 2] - at[h]), np.abs(at[h - 1] - at[h + 1]))
    closed = (apart <= _ALIKE * span[h]) & cycles.whole[h] & cycles.whole[h + 1]
    for a, b, c in zip(*(turns[h[closed] + i].tolist() for i in range(3)), strict=True):
        # up and down together: a drift cancels
        wide = float(abs(u[b] - u[a]))
        ways = wide + float(abs(u[b] - u[c]))
        gain = float(abs(y[b] - y[a]) + abs(y[b] - y[c])) / ways
        rate = wide / ((b - a) * record.ts_s)
        middle = 0.5 * float(u[a] + u[b])
        found.append(Loop(middle, wide, rate, gain, 2.5 * noise / ways, record.name))
    return found


def _groups(loops: Sequence[Loop]) -> list[list[Loop]]:
    """Loops of one span and rate that stand at three biases or more."""
    groups: list[list[Loop]] = []
    for loop in loops:
        for group in groups:
            like = abs(loop.span_V - group[0].span_V) <= _ALIKE * loop.span_V
            if like and abs(loop.rate_V_s - group[0].rate_V_s) <= _RATE_ALIKE * loop.rate_V_s:
                group.append(loop)
                break
        else:
            groups.append([loop])
    return [group for group in groups if _biases(group) >= 3]


def _biases(group: Sequence[Loop]) -> int:
    places: list[float] = []
    for loop in sorted(group, key=lambda each: each.bias_V):
        if not places or loop.bias_V - places[-1] > _BIASES_APART * loop.span_V:
            places.append(loop.bias_V)
    return len(places)


def _curvature(group: Sequence[Loop]) -> tuple[float, float]:
    """Part of the height that is even in the bias, at the outermost bias (%), and its error."""
    bias = np.array([loop.bias_V for loop in group])
    gain = np.array([loop.gain_um_V for loop in group])
    error = np.array([loop.error_um_V for loop in group])
    middle = 0.5 * (bias.min() + bias.max())
    x = (bias - middle) / (bias.max() - middle)
    rows = np.column_stack([np.ones_like(x), x, x * x])
    inverse = np.linalg.pinv(rows.T @ rows)
    solution = inverse @ (rows.T @ gain)
    misfit = gain - rows @ solution
    freedom = max(len(group) - 3, 1)
    spread = max(float(misfit @ misfit) / freedom, float(np.mean(error**2)))
    return (
        100.0 * float(solution[2] / solution[0]),
        100.0 * float(np.sqrt(inverse[2, 2] * spread) / abs(solution[0])),
    )


GAIN_PERCENT = 0.5
"""Fall of the gain from a smaller to a larger loop (%)."""
_LARGER = 1.2
_RATE_SLACK = 1.05
_SLOW = 0.1  # of the fastest loop: lags, resonances and slew limits are far
_FREQUENCY = 3.0  # times: so much may the loops' frequencies differ
_MOST = 80


def gain_over_amplitude(loops: Sequence[Loop]) -> Check:
    """Fall of the gain from a smaller loop to a larger one that is no faster.

    Weights of plays are not negative and thresholds grow with the rate, so a larger loop at the
    same or a smaller rate has a gain that is the same or larger. Saturation alone breaks this.
    """
    fastest = max((loop.rate_V_s for loop in loops), default=0.0)
    slowest = min((loop.rate_V_s for loop in loops), default=0.0)
    limit = max(_SLOW * fastest, 1.1 * slowest)
    slow = [loop for loop in loops if loop.rate_V_s <= limit]
    order = sorted(slow, key=lambda loop: loop.span_V)
    # of many loops, some of each size
    every = max(1, len(order) // _MOST)
    chosen = order[::every]
    changes = [
        (100.0 * (large.gain_um_V / small.gain_um_V - 1.0), _error(small, large), small, large)
        for i, small in enumerate(chosen)
        for large in chosen[i + 1 :]
        if large.span_V > _LARGER * small.span_V
        and large.rate_V_s <= _RATE_SLACK * small.rate_V_s
        and small.gain_um_V > 0.0
        and small.rate_V_s / small.span_V < _FREQUENCY * large.rate_V_s / large.span_V
    ]
    name = "gain over amplitude"
    if not changes:
        return cannot_tell(name, "gain over amplitude/none", "four amplitudes")
    # the deepest fall that is sure; without one, the widest comparison
    falls = [c for c in changes if c[0] < 0.0 and zone_of(c[0], c[1], GAIN_PERCENT) == "yes"]
    change, error, small, large = (
        min(falls, key=lambda c: c[0])
        if falls
        else max(changes, key=lambda c: c[3].span_V / c[2].span_V)
    )
    zone: Zone = "no" if zone_of(change, error, GAIN_PERCENT) == "no" else "cannot tell"
    if falls:
        zone, kind = "yes", "falls"
    elif change > GAIN_PERCENT:
        zone, kind = "cannot tell", "grows"
    else:
        kind = "uncertain" if zone == "cannot tell" else "same"
    found = statement(
        f"gain over amplitude/{kind}", small=small.span_V, first=small.record, large=large.span_V,
        second=large.record, percent=abs(change), change=(change, error),
    )  # fmt: skip
    advice = statement("four amplitudes") if zone == "cannot tell" else None
    effects = ("saturation",) if falls else ()
    return Check(name, change, GAIN_PERCENT, "%", zone, found, advice, effects)


def _error(small: Loop, large: Loop) -> float:
    of_small, of_large = (loop.error_um_V / loop.gain_um_V for loop in (small, large))
    return 100.0 * math.hypot(of_small, of_large)


EXPONENT = 0.15
"""Distance of the exponent from 1."""
_WIDE = 0.9  # of the widest swing: loops that are compared
_APART = 3.0  # times: two rates differ
_GROWTH = 0.02  # of the opening at rest: a rate dependence worth an exponent
_SYSTEMATIC = 1e-4  # of the stroke: creep opens loops by as much more at one rate than at another
_EXPONENTS = np.linspace(0.1, 4.0, 391)


@dataclass(frozen=True)
class Opening:
    """Half of a loop's opening at its middle (µm), with its error, and the rate there (V/s)."""

    rate_V_s: float
    half_um: float
    error_um: float
    record: str


def rate_law(records: Sequence[tuple[Record, HalfCycles]], span_V: float) -> Check:
    """Exponent with which the opening of the widest loops grows with the rate.

    Where every play slides, the displacement at a loop's middle is short of the static one by the
    sum of a_i r_i: Eq. 8 makes it linear in |v|, and so do a delay and a lag.
    """
    openings = [o for r, c in records for o in _openings(r, c, _WIDE * span_V)]
    levels = _levels(openings)
    if len(levels) < 3:
        return cannot_tell("rate law", "rate law/none", "four rates")
    rate = np.array([level.rate_V_s for level in levels])
    half = np.array([level.half_um for level in levels])
    stroke_um = max(float(np.ptp(r.y_um)) for r, _ in records)
    error = np.array([np.hypot(level.error_um, _SYSTEMATIC * stroke_um) for level in levels])
    growth = abs(half[-1] - half[0])
    if growth < max(_GROWTH * abs(half[0]), 10.0 * float(np.hypot(error[0], error[-1]))):
        same = statement("rate law/same", low=rate[0], high=rate[-1])
        return Check("rate law", None, EXPONENT, "", "no", same)
    value, uncertain = _exponent(rate, half, error)
    zone = zone_of(value - 1.0, uncertain, EXPONENT)
    found = statement(f"rate law/{zone}", low=rate[0], high=rate[-1], exponent=(value, uncertain))
    effects = ("slew_limit", "rate_law") if value > 1.0 else ("rate_law",)
    advice = statement("four rates") if zone == "cannot tell" else None
    return Check("rate law", value, EXPONENT, "", zone, found, advice, effects)


def _exponent(rate: Array, half: Array, error: Array) -> tuple[float, float]:
    """Exponent p of w_0 + c v^p by a scan, and its error."""
    weight = 1.0 / error
    costs = []
    for p in _EXPONENTS:
        rows = np.column_stack([np.ones_like(rate), (rate / rate[-1]) ** p]) * weight[:, None]
        left = half * weight - rows @ np.linalg.lstsq(rows, half * weight, rcond=None)[0]
        costs.append(float(left @ left))
    at = int(np.argmin(costs))
    inside = min(max(at, 1), len(costs) - 2)
    bend = costs[inside - 1] - 2.0 * costs[inside] + costs[inside + 1]
    step = float(_EXPONENTS[1] - _EXPONENTS[0])
    freedom = max(len(rate) - 3, 1)
    excess = max(1.0, costs[at] / freedom)
    spread = step * float(np.sqrt(2.0 * excess / bend)) if bend > 0.0 else np.inf
    return float(_EXPONENTS[at]), spread


def _levels(openings: Sequence[Opening]) -> list[Opening]:
    """Mean opening at each rate that is well apart from the others, the slowest first."""
    groups: list[list[Opening]] = []
    for opening in sorted(openings, key=lambda o: o.rate_V_s):
        if groups and opening.rate_V_s < _APART * groups[-1][0].rate_V_s:
            groups[-1].append(opening)
        else:
            groups.append([opening])
    levels = []
    for group in groups:
        # of a group that spreads over rates, the loops that are as fast as its slowest
        alike = [o for o in group if o.rate_V_s < 1.05 * group[0].rate_V_s]
        half = np.array([o.half_um for o in alike])
        noise = group[0].error_um / np.sqrt(len(alike))
        spread = float(half.std() / np.sqrt(len(alike)))
        levels.append(
            Opening(
                float(np.mean([o.rate_V_s for o in alike])), float(half.mean()),
                float(np.hypot(noise, spread)), group[0].record,
            )
        )  # fmt: skip
    return levels


def _openings(record: Record, cycles: HalfCycles, width_V: float) -> list[Opening]:
    edges, u, y = cycles.edges, record.u_V, record.y_um
    noise = rough_part(y)
    found = []
    span = cycles.spans(u)
    wide = cycles.whole & (span >= width_V)
    for h in np.flatnonzero(wide[:-1] & wide[1:]):
        turns = u[edges[h : h + 3] - 1]
        middle = 0.25 * turns[0] + 0.5 * turns[1] + 0.25 * turns[2]
        parts = (slice(int(edges[i]) - 1, int(edges[i + 1])) for i in (h, h + 1))
        one, other = (crossing(u[part], y[part], middle) for part in parts)
        if one is not None and other is not None:
            half = 0.5 * abs(one[0] - other[0])
            rate = 0.5 * (one[1] / record.ts_s + other[1] / record.ts_s)
            found.append(Opening(rate, half, 0.71 * noise, record.name))
    return found


SATURATION_PERCENT = 0.5
"""Fall of the gain from the inner fifths of a branch to its last (%)."""
_WIDE_BRANCH = 0.7  # of the widest swing: branches that count
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
        found = _slopes(record, cycles, _WIDE_BRANCH * span_V)
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
_SLOW_RATE = 0.1  # of the fastest rate: lags shift the start of faster records
_NOISE = 200.0  # per cent: of one sample and of the loop's middle, with some hum
_CLOSED = 1e-6  # of the displacement: a loop that does not open


def initial_memory(records: Sequence[tuple[Record, HalfCycles]]) -> Check:
    """Compare a record's first displacement with the loop that it goes through later.

    Without a past the plays begin in the middle: halfway between the falling and the rising branch
    of a loop that stands about the first command. Effects that are odd or small there (saturation,
    congruency, asymmetry) do not shift it, a remembered excursion does.
    """
    rates = [float(np.max(np.abs(np.diff(r.u_V)))) / r.ts_s for r, _ in records]
    limit = max(_SLOW_RATE * max(rates, default=0.0), min(rates, default=0.0))
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
