"""Samples that are no measurement: outliers, dropouts, frozen and clipped stretches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rdpi_gym.diagnosis.features.cycles import (
    BoolArray,
    bridged,
    gain,
    runs,
    smallest_step,
    widened,
)
from rdpi_gym.diagnosis.features.noise import rough_part
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array

FAR = 6.5
"""Times the local noise: so far a sample lies from all that its neighbours say."""
_STEPS = 3.0  # smallest steps of the recorder
_LEAST = 1e-4  # of the swing, where there is no noise
_BLOCK = 64
_WIDTHS = (1, 2)  # samples
_ROUNDS = 3
_END = 0.5  # of what stands out at an end, where one side alone says so
_MOST = 0.1  # of a record: more is no outlier
_BEFORE, _AFTER = 20, 2  # samples around a corner of the command
_AROUND, _CALM = 6, 0.8  # samples to either side; of the excursion, how much they may range
_GAUSSIAN = 0.6744897501960817 * np.sqrt(20.0)


def spikes(record: Record) -> tuple[BoolArray, float]:
    """Find single samples, or pairs, that stand out from those before and after.

    A sample counts where it lies on the same side of the way from its three neighbours before it
    to its three after it, and of the slopes of both, by more than the local noise explains. A step
    and a corner agree with one side's slope, and a round crest lies above the way and below the
    slopes; what the command's own corners can excite is left alone, and so is ringing.
    """
    y = record.y_um
    found = np.zeros(y.size, dtype=np.bool_)
    if y.size < _BLOCK:
        return found, 0.0
    swing = float(np.ptp(record.u_V))
    excited = _excited(record.u_V, float(np.ptp(y)) / swing if swing > 0.0 else 0.0)
    low, high = np.quantile(y, (0.01, 0.99))
    least = max(_STEPS * smallest_step(y), _LEAST * float(high - low))
    farthest, clean = 0.0, y
    for _ in range(_ROUNDS):
        noise = _local_noise(clean)
        limit = np.maximum(np.maximum(FAR * noise, least), excited)
        new = np.zeros_like(found)
        for width in _WIDTHS:
            out = _outstanding(clean, width)
            at = np.flatnonzero(out > limit[: out.size])
            if at.size:
                farthest = max(farthest, float(np.max(out[at] / np.maximum(noise[at], least / 3))))
            for shift in range(width):
                new[at + shift] = True
        if not (new & ~found).any():
            break
        found |= new
        clean = bridged(y, found)
    found &= _alone(y, found)
    if not found.any() or found.mean() > _MOST:
        return np.zeros_like(found), 0.0
    return found, farthest


def _alone(y: Array, found: BoolArray) -> BoolArray:
    """Whether what lies around each of them is calm: a burst of ringing is no outlier."""
    at = np.flatnonzero(found)
    alone = np.zeros_like(found)
    x = np.arange(-_AROUND, _AROUND + 1)
    near = np.clip(at[:, None] + x, 0, y.size - 1)
    weight = (~found[near]).astype(np.float64)
    values = y[near] - np.median(y[near], axis=1, keepdims=True)
    powers = np.stack([(x / _AROUND) ** n for n in range(3)], axis=1)
    gram = np.einsum("kj,ja,jb->kab", weight, powers, powers) + 1e-9 * np.eye(3)
    right = np.einsum("kj,ja,kj->ka", weight, powers, values)
    course = np.linalg.solve(gram, right[..., None])[..., 0] @ powers.T
    apart = values - course
    around = np.where(weight > 0.0, apart, 0.0)
    alone[at] = np.abs(apart[:, _AROUND]) > np.ptp(around, axis=1) / _CALM
    return alone


def _outstanding(y: Array, width: int) -> Array:
    """Distance by which the group of samples that begins at each one stands out; 0 where it does not."""
    size = y.size - width - 5
    before = [y[2 - j : 2 - j + size] for j in range(3)]  # nearest first
    after = [y[3 + width + j : 3 + width + j + size] for j in range(3)]
    levels = [np.median(np.stack(side), axis=0) for side in (before, after)]
    # both levels are carried along the way from the one to the other
    tilt = (levels[1] - levels[0]) / (width + 3)
    apart = []
    for i in range(width):
        here = y[3 + i : 3 + i + size]
        apart += [here - (levels[0] + (i + 2) * tilt)]
        for side, distance in ((before, i + 2), (after, width - i + 1)):
            slope = 0.5 * (side[0] - side[2])
            apart += [here - (sum(side) / 3.0 + distance * slope)]
    stacked = np.stack(apart)
    found = np.zeros(y.size)
    found[3 : 3 + size] = np.maximum(np.maximum(stacked.min(axis=0), (-stacked).min(axis=0)), 0.0)
    if width == 1:
        for x, ends in ((y[:6], found[:3]), (y[::-1][:6], found[::-1][:3])):
            ends[:] = [_END * _at_end(x, k) for k in range(3)]
    return found


def _at_end(x: Array, k: int) -> float:
    """Distance of a sample at an end, k from it, from the level and slope of those inside."""
    inside = x[k + 1 : k + 4]
    level = float(np.median(inside))
    line = float(inside.mean()) + (inside[0] - inside[2])
    above, below = min(x[k] - level, x[k] - line), min(level - x[k], line - x[k])
    return max(float(above), float(below), 0.0)


def _local_noise(y: Array) -> Array:
    """Roughness of the block that holds each sample, or of its neighbour where that is larger."""
    third = np.abs(np.diff(y, 3))
    blocks = max(third.size // _BLOCK, 1)
    size = third.size // blocks
    levels = np.median(third[: blocks * size].reshape(blocks, size), axis=1) / _GAUSSIAN
    padded = np.pad(levels, 1, mode="edge")
    wide = np.maximum(np.maximum(padded[:-2], padded[1:-1]), padded[2:])
    of_sample = np.minimum(np.arange(y.size) // size, blocks - 1)
    # a stretch that stands still tells nothing of the noise
    return np.asarray(np.maximum(wide[of_sample], 0.5 * float(np.median(levels))))


def _excited(u: Array, gain_um_V: float) -> Array:
    """Response that a corner or a jump of the command may excite (µm)."""
    bends = np.abs(np.diff(u, 2, prepend=u[:1], append=u[-1:]))
    usual = 6.0 * float(np.median(bends))
    bends = np.maximum(bends - usual, 0.0)
    largest = bends.copy()
    span = 1
    # the largest of the samples before, by doubling
    while span < _BEFORE:
        step = min(span, _BEFORE - span)
        largest[step:] = np.maximum(largest[step:], largest[:-step])
        span += step
    for shift in range(1, _AFTER + 1):
        largest[:-shift] = np.maximum(largest[:-shift], bends[shift:])
    return np.asarray(gain_um_V * largest)


MARGIN = 3
"""Samples left out on either side of a stretch without a signal: filters smear its edges."""
_FEWEST_EQUAL = 5
_LONGER = 4.0  # times a usual run of equal values
_COARSE = 0.01  # of the samples: so many repeat where the recorder's step is larger than the noise
_RESOLVED = 0.25  # of a step: noise that moves a reading
_MOVES = 0.03  # of the command's swing
_JUMP_NOISE, _JUMP_STEPS, _JUMP_USUAL, _JUMP_COMMAND = 8.0, 4.0, 6.0, 3.0
_NEAR = 40  # samples in which a move is usual, or the command may have caused it
_SAME = 1e-9  # of the swing
_FORWARD, _BACK = 0.4, 0.3  # of the rate outside, at either end of a command that was clipped


def silent(record: Record, known: BoolArray) -> tuple[BoolArray, BoolArray]:
    """Find where the displacement holds one value exactly and nothing of the kind is usual."""
    y, u = record.y_um, record.u_V
    dropout, frozen = np.zeros(y.size, dtype=np.bool_), np.zeros(y.size, dtype=np.bool_)
    equal = np.diff(y) == 0.0
    stands = [(first, last + 1) for first, last in runs(equal)]
    long = [(a, b) for a, b in stands if b - a >= _FEWEST_EQUAL]
    if not long:
        return dropout, frozen
    short = sum(b - a - 1 for a, b in stands if b - a < _FEWEST_EQUAL)
    inside = sum(b - a for a, b in long)
    coarse = short > _COARSE * max(y.size - inside, 1)
    # runs of all lengths, single samples too: what is usual of this recorder
    ends = np.flatnonzero(np.concatenate([~equal, [True]]))
    usual = float(np.quantile(np.diff(ends, prepend=-1), 0.95))
    noise = rough_part(y)
    swing = float(np.ptp(y))
    noisy = not coarse and noise > 1e-6 * swing and inside < 0.5 * y.size
    step = smallest_step(y) if coarse else 0.0
    slope = abs(gain(u, y))
    moves_u, moves_y = np.abs(np.diff(u)), np.abs(np.diff(y))
    for first, last in long:
        if known[first:last].any() or last - first < max(_FEWEST_EQUAL, _LONGER * usual):
            continue
        entry = _jump(moves_y, moves_u, first - 1, step, noise, slope)
        leave = _jump(moves_y, moves_u, last - 1, step, noise, slope)
        missed = slope * float(np.ptp(u[first:last])) > 3.0 * step
        if entry and (leave or noisy or y[first] == 0.0):
            dropout[first:last] = True
        elif noisy or (leave and missed):
            frozen[first:last] = True
    return dropout, frozen


def _jump(moves_y: Array, moves_u: Array, at: int, step: float, noise: float, slope: float) -> bool:
    """Whether the displacement jumps there, more than it usually does and the command explains."""
    if not 0 <= at < moves_y.size:
        return False
    around = slice(max(at - _NEAR, 0), at + _NEAR)
    moving = moves_y[around]
    usual = float(np.median(moving[moving > 0.0])) if np.any(moving > 0.0) else 0.0
    caused = slope * float(np.max(moves_u[max(at - _NEAR, 0) : at + 6], initial=0.0))
    limit = max(
        _JUMP_STEPS * step, _JUMP_NOISE * noise, _JUMP_USUAL * usual, _JUMP_COMMAND * caused
    )
    return bool(moves_y[at] > limit)


Rails = dict[bool, float]


def output_rails(records: Sequence[Record], bad: Sequence[BoolArray]) -> list[Rails]:
    """Return the extreme values at which a converter holds each displacement, upper and lower.

    A stage that saturates still shows the sensor's noise; a converter that clips shows none. A record
    that ends where another one clips is clipped too; one that goes further has another range.
    """
    own: list[Rails] = []
    extremes: list[Rails] = []
    for record, lost in zip(records, bad, strict=True):
        y = record.y_um[~lost]
        ends = {True: float(y.max()), False: float(y.min())} if y.size >= _FEWEST_EQUAL else {}
        extremes.append(ends)
        own.append({up: end for up, end in ends.items() if _is_rail(record, lost, end, up)})
    known = {(up, end) for rails in own for up, end in rails.items()}
    return [{up: end for up, end in ends.items() if (up, end) in known} for ends in extremes]


def _is_rail(record: Record, lost: BoolArray, extreme: float, upper: bool) -> bool:
    y, u = record.y_um, record.u_V
    swing_u, swing_y = float(np.ptp(u)), float(np.ptp(y[~lost]))
    at = (np.abs(y - extreme) <= _SAME * swing_y) & ~lost
    stands = [(a, b) for a, b in runs(at) if b - a >= _FEWEST_EQUAL]
    if not stands:
        return False
    step = smallest_step(y[~lost])
    inner = y[(y > y[~lost].min()) & (y < y[~lost].max()) & ~lost]
    repeats = float(np.mean(np.diff(inner) == 0.0)) if inner.size > 1 else 0.0
    noise, slope = rough_part(y), gain(u, y)
    if repeats < _COARSE and noise > max(_RESOLVED * step, 1e-6 * swing_y):
        moves_y, moves_u = np.abs(np.diff(y)), np.abs(np.diff(u))
        # a sensor that drops out jumps to its value
        return any(not _jump(moves_y, moves_u, a - 1, step, noise, abs(slope)) for a, _ in stands)
    stands = [(a, b) for a, b in stands if np.ptp(u[a:b]) > _MOVES * swing_u]
    outward = (1.0 if upper else -1.0) * float(np.sign(slope))
    # a stage that lost motion stands still too, but only while the command comes back
    return any(
        abs(slope) * float(np.max(outward * (u[a:b] - u[a]))) > max(4.0 * step, _MOVES * swing_y)
        for a, b in stands
    )


def at_rail(record: Record, rails: Rails) -> BoolArray:
    """Mask of samples at a rail of the converter, and between two such samples."""
    y = record.y_um
    near = _SAME * max(float(np.ptp(y)), 1e-300)
    at = np.zeros(y.size, dtype=np.bool_)
    for upper, rail in rails.items():
        at |= (y >= rail - near) if upper else (y <= rail + near)
    return widened(at, 1) if at.any() else at


def clipped_command(record: Record, bad: BoolArray) -> BoolArray:
    """Find where the recorded command stands at its extreme while the displacement goes on.

    Where the command was clipped in the recorder alone, the displacement goes on at the rate it
    had, turns, and comes back at the rate with which it will go on; where the command itself
    rests, it creeps, rings or stands. Where one stretch shows it, every sample at that extreme is
    clipped, however short its stretch.
    """
    u, y = record.u_V, record.y_um
    found = np.zeros(u.size, dtype=np.bool_)
    swing = float(np.ptp(u))
    slope = gain(u, y)
    noise = rough_part(y)
    least = max(8.0 * noise, 4.0 * smallest_step(y) if noise == 0.0 else 0.0)
    least = max(least, 3.0 * abs(slope) * smallest_step(u[np.abs(u - u.mean()) < 0.4 * swing]))
    for extreme, outward in ((float(u.max()), 1.0), (float(u.min()), -1.0)):
        at = np.abs(u - extreme) <= _SAME * swing
        for first, last in runs(at):
            size = last - first
            edge = max(size // 6, 2)
            if size < 3 * _FEWEST_EQUAL or first < edge or last + edge > u.size:
                continue
            if bad[first - edge : last + edge].any():
                continue
            z = outward * float(np.sign(slope)) * y[first - edge : last + edge]
            if _goes_on(z, edge, least):
                found |= at
                break
    return found


def _goes_on(z: Array, edge: int, least: float) -> bool:
    """Whether a trace, with `edge` samples on either side, rises, turns and falls in between."""
    inside = z[edge:-edge]
    peak = float(np.mean(np.sort(inside)[-max(inside.size // 10, 2) :]))
    begin, end = float(np.mean(inside[:2])), float(np.mean(inside[-2:]))
    if peak - begin < least or peak - end < least:
        return False
    before, after = z[edge] - z[0], z[-1] - z[-1 - edge]
    enters = z[2 * edge] - z[edge]
    leaves = z[-1 - edge] - z[-1 - 2 * edge]
    return bool(before > 0 > after and enters > _FORWARD * before and leaves < _BACK * after)
