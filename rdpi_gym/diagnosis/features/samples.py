"""Samples of a trace: stretches of a condition, gaps bridged, the recorder's step, the size of the response."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.support.arrays import Array

BoolArray = NDArray[np.bool_]


def runs(at: BoolArray) -> list[tuple[int, int]]:
    """Return where a condition holds without a break: first sample, and one past the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], at, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def longest_run(at: BoolArray) -> tuple[int, int]:
    """Return the longest of them, the first of several; an empty one where there is none."""
    return max(runs(at), key=lambda run: run[1] - run[0], default=(0, 0))


def widened(at: BoolArray, margin: int) -> BoolArray:
    """Widen a mask by some samples to either side."""
    wide = at.copy()
    for shift in range(1, margin + 1):
        wide[shift:] |= at[:-shift]
        wide[:-shift] |= at[shift:]
    return wide


def bridged(x: Array, bad: BoolArray) -> Array:
    """Carry a trace across the samples that are no measurement, in straight lines."""
    if not bad.any() or bad.all():
        return x
    k = np.arange(x.size)
    patched = x.copy()
    patched[bad] = np.interp(k[bad], k[~bad], x[~bad])
    return patched


def smallest_step(x: Array) -> float:
    """Return the smallest change from sample to sample: the step of a recorder that is coarse."""
    if x.size < 2:
        return 0.0
    steps = np.abs(np.diff(x))
    moved = steps[steps > 1e-9 * max(float(np.ptp(x)), 1e-300)]
    return float(moved.min()) if moved.size else 0.0


def gain(u: Array, y: Array) -> float:
    """Return the size of the response over the command, whatever single samples say, with its sign."""
    low, high = np.quantile(y, (0.02, 0.98))
    swing = float(np.ptp(u))
    if swing == 0.0:
        return 0.0
    moment = float(np.mean((u - u.mean()) * (np.clip(y, low, high) - np.median(y))))
    return float(np.sign(moment)) * float(high - low) / swing
