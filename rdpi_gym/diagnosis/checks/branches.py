"""Gain along a branch: a play model's never falls, so a fall is saturation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rdpi_gym.diagnosis.checks.check import Check, cannot_tell, zone_of
from rdpi_gym.diagnosis.features.half_cycles import HalfCycles
from rdpi_gym.diagnosis.features.noise import rough_part
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.words import digits

NAME = "saturation"
THRESHOLD_PERCENT = 0.5
"""Fall of the gain from the inner fifths of a branch to its last (%)."""
_WIDE = 0.7  # of the widest swing: branches that count
_FIFTHS = 5
_FEWEST = 8  # samples in a fifth
_BACK, _NOISY = 0.01, 8.0  # of the way; times the roughness of a measured command
_AS_LONG = 0.9  # of the time of an earlier fifth: the last is no faster
_EXPERIMENT = "Take a slow triangle over the full range, and over a half of it."


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
        return cannot_tell(
            NAME,
            "No record goes up and down over most of the range, so the gain cannot be followed "
            "along a branch.",
            _EXPERIMENT,
        )
    _, slope, error, name = best
    inner = int(np.argmax(np.abs(slope[2:4]))) + 2
    change = 100.0 * (slope[4] / slope[inner] - 1.0)
    uncertain = 100.0 * float(np.hypot(error[4], error[inner])) / abs(slope[inner])
    zone = zone_of(change, uncertain, THRESHOLD_PERCENT)
    where = (
        f"Along the wide branches of {name} the gain changes by {digits(change)} % towards the end"
    )
    if zone == "yes" and change < 0:
        text = f"{where}: a play model's gain only grows along a branch, so the actuator saturates."
    elif zone == "no":
        text = f"{where}: no saturation."
    elif change > 0:
        zone = "cannot tell"
        text = f"{where}: plays may grow so, and a weak saturation could hide under it."
    else:
        zone = "cannot tell"
        text = f"{where}, not safely more than its noise."
    step = _EXPERIMENT if zone == "cannot tell" else ""
    return Check(NAME, float(change), THRESHOLD_PERCENT, "%", zone, text, step, ("saturation",))


def _slopes(
    record: Record, cycles: HalfCycles, width_V: float
) -> tuple[float, Array, Array] | None:
    """Fastest rate (V/s), and slope with its error in each fifth of wide branches (µm/V)."""
    noise = rough_part(record.y_um)
    by_way: dict[bool, list[tuple[Array, Array]]] = {True: [], False: []}
    rate = 0.0
    span = np.abs(np.diff(record.u_V[np.maximum(cycles.edges - 1, 0)]))
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
