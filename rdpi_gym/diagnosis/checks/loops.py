"""Closed loops: gain and opening over bias, amplitude and rate."""

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
