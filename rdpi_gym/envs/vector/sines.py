"""Sines of many numbers, in loops that run on vector units."""

from __future__ import annotations

import numpy as np
from numba import njit

from rdpi_gym.support.arrays import Array

# π in parts of 24 bits: whole multiples of the first two are exact.
_PI_A = float(np.float32(np.pi))
_PI_B = float(np.float32(np.pi - _PI_A))
_PI_C = (np.pi - _PI_A - _PI_B) + 1.2246467991473532e-16
_TAYLOR = tuple((-1.0) ** k / float(np.prod(np.arange(1.0, 2 * k + 2))) for k in range(10))


@njit(cache=True, fastmath={"contract"})
def sines(x: Array) -> None:
    """Replace x by sin x, within two units in the last place; the loop runs on vector units."""
    for b in range(len(x)):
        half_turns = np.rint(x[b] * (1.0 / np.pi))
        r = x[b] - half_turns * _PI_A
        r -= half_turns * _PI_B
        r -= half_turns * _PI_C
        s = r * r
        total = _TAYLOR[9]
        total = total * s + _TAYLOR[8]
        total = total * s + _TAYLOR[7]
        total = total * s + _TAYLOR[6]
        total = total * s + _TAYLOR[5]
        total = total * s + _TAYLOR[4]
        total = total * s + _TAYLOR[3]
        total = total * s + _TAYLOR[2]
        total = total * s + _TAYLOR[1]
        odd = 0.5 * half_turns - np.floor(0.5 * half_turns)  # 0 or 1/2
        x[b] = (r + r * s * total) * (1.0 - 4.0 * odd)
