"""Samples that stand alone: far from what the samples on either side say."""

from __future__ import annotations

import numpy as np

from rdpi_gym.diagnosis.hygiene.finding import BoolArray, bridged, smallest_step
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
    """How far the group of samples that begins at each one stands out; 0 where it does not."""
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
    """How far a sample at an end, k from it, stands out from the level and slope of those inside."""
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
    """What a corner or a jump of the command may make of the response (µm)."""
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
