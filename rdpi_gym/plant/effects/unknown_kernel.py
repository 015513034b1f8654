"""The kernel of a free block: memories, each driven by a sum of terms of a signal and its rate."""

from __future__ import annotations

import numpy as np
from numba import njit

from rdpi_gym.support.arrays import Array

TERMS = (
    "linear", "absolute", "even_1", "even_2", "even_3", "odd_1", "odd_2", "odd_3", "step", "speed",
    "drag", "cross",
)  # fmt: skip
"""What drives a block, of s and its rate r: s, |s|, the even and the odd quadratic spline with knots
at 0, 1/3 and 2/3, a smooth step at 0, |r|, r |r|, s r."""
POWER = ("weight", "power", "rate_power", "signed", "rate_signed")
"""Numbers of one more term, w |s|^a |r|^b with the sign of s, of r, of both or of none."""
_STEP = 0.15  # half of the width of the step, in spans
_HEAD, _LAG = 7, 3
_MEMORY = _LAG + len(TERMS) + len(POWER)


@njit(inline="always")
def _power(s: float, r: float, w: Array, k: int) -> float:
    """One term with two exponents."""
    value: float = w[k, 15]
    if w[k, 16] > 0.0:
        value *= abs(s) ** w[k, 16] if s != 0.0 else 0.0
    if w[k, 17] > 0.0:
        value *= abs(r) ** w[k, 17] if r != 0.0 else 0.0
    if w[k, 18] > 0.5 and s < 0.0:
        value = -value
    return -value if w[k, 19] > 0.5 and r < 0.0 else value


@njit(cache=True)
def unknown_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel: y = x + (p4 + p5 x + p6 u) Σ_k z_k, where z_k lags behind a sum of terms of s and r.

    s = p0 x + p1 u + p2, and r is p3 times its change from sample to sample. Rows of each memory: F, G0
    and G1 of its lag, the weights of :data:`TERMS`, then w, a, b, o and q of w |s|^a |r|^b, with the
    sign of s where o is 1 and that of r where q is. Rows of the state: s, r, then the drive and z of each memory.
    """
    memories = (p.shape[0] - _HEAD) // _MEMORY
    # lane by lane: its parameters stay in registers, and what the memories share is made once
    w, past = np.empty((memories, _MEMORY)), np.empty((memories, 2))
    for b in range(x.shape[1]):
        of_x, of_u, middle, per_step = p[0, b], p[1, b], p[2, b], p[3, b]
        alone, by_x, by_u = p[4, b], p[5, b], p[6, b]
        last_s, last_r = state[0, b], state[1, b]
        for k in range(memories):
            for j in range(_MEMORY):
                w[k, j] = p[_HEAD + _MEMORY * k + j, b]
            past[k, 0], past[k, 1] = state[2 + 2 * k, b], state[3 + 2 * k, b]
        for t in range(x.shape[0]):
            s = of_x * x[t, b] + of_u * u[t, b] + middle
            begins = np.isnan(last_s)
            if begins:
                last_s, last_r = s, 0.0
            r = per_step * (s - last_s)
            now = 1.5 * r - 0.5 * last_r
            last_s, last_r = s, r
            size = abs(s)
            above, far_above = max(size - 1.0 / 3.0, 0.0), max(size - 2.0 / 3.0, 0.0)
            square, above, far_above = size * size, above * above, far_above * far_above
            step = min(max(s / _STEP, -1.0), 1.0)
            step *= 1.5 - 0.5 * step * step
            total = 0.0
            for k in range(memories):
                # without a lag at the sample itself; a jump is one step for a memory
                rate = r if w[k, 0] > 0.0 else now
                even = w[k, 5] * square + w[k, 6] * above + w[k, 7] * far_above
                odd = w[k, 8] * square + w[k, 9] * above + w[k, 10] * far_above
                drive = w[k, 3] * s + w[k, 4] * size + even + (odd if s > 0.0 else -odd)
                drive += w[k, 11] * step
                drive += w[k, 12] * abs(rate) + w[k, 13] * rate * abs(rate) + w[k, 14] * s * rate
                if w[k, 15] != 0.0:
                    drive += _power(s, rate, w, k)
                if begins:  # at rest
                    past[k, 0], past[k, 1] = drive, drive
                z = w[k, 0] * past[k, 1] + w[k, 1] * past[k, 0] + w[k, 2] * drive
                past[k, 0], past[k, 1] = drive, z
                total += z
            y[t, b] = x[t, b] + (alone + by_x * x[t, b] + by_u * u[t, b]) * total
        state[0, b], state[1, b] = last_s, last_r
        for k in range(memories):
            state[2 + 2 * k, b], state[3 + 2 * k, b] = past[k, 0], past[k, 1]
