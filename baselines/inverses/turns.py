"""Where a curve that rises through zero turns round."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

# Coefficients below this share of one bend nothing, and their roots would lie at infinity.
_NOTHING = 1e-12


def turns(slope: ArrayLike) -> tuple[float, float]:
    """Return the zeros of 1 + Σ c_k s^k, k = 1, 2, ..., next to s = 0 on either side."""
    c = np.array(slope, dtype=np.float64)
    zeros = np.roots([*np.where(np.abs(c) < _NOTHING, 0.0, c)[::-1], 1.0])
    real = zeros.real[np.abs(zeros.imag) <= 1e-9 * np.abs(zeros)].tolist()
    below, above = ([s for s in real if s < 0.0], [s for s in real if s > 0.0])
    return max(below, default=-math.inf), min(above, default=math.inf)
