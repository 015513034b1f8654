"""Stretches in which a channel stands still although the other one moves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rdpi_gym.diagnosis.features.noise import rough_part
from rdpi_gym.diagnosis.hygiene.finding import BoolArray, gain, runs, smallest_step, widened
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array

MARGIN = 3
"""Samples left out on either side of a stretch without a signal: filters smear its edges."""
_FEWEST = 5
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
    long = [(a, b) for a, b in stands if b - a >= _FEWEST]
    if not long:
        return dropout, frozen
    short = sum(b - a - 1 for a, b in stands if b - a < _FEWEST)
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
        if known[first:last].any() or last - first < max(_FEWEST, _LONGER * usual):
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
        ends = {True: float(y.max()), False: float(y.min())} if y.size >= _FEWEST else {}
        extremes.append(ends)
        own.append({up: end for up, end in ends.items() if _is_rail(record, lost, end, up)})
    known = {(up, end) for rails in own for up, end in rails.items()}
    return [{up: end for up, end in ends.items() if (up, end) in known} for ends in extremes]


def _is_rail(record: Record, lost: BoolArray, extreme: float, upper: bool) -> bool:
    y, u = record.y_um, record.u_V
    swing_u, swing_y = float(np.ptp(u)), float(np.ptp(y[~lost]))
    at = (np.abs(y - extreme) <= _SAME * swing_y) & ~lost
    stands = [(a, b) for a, b in runs(at) if b - a >= _FEWEST]
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
    """Where the displacement stands at a rail of its converter, and between two such samples."""
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
            if size < 3 * _FEWEST or first < edge or last + edge > u.size:
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
