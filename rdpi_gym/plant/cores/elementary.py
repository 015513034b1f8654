"""Exponentials and powers without branches, which compilers turn into vector instructions.

A call into a mathematics library ends a loop's vectors; these cost a third of it or less.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from rdpi_gym.support.arrays import Array

# log 2 in two parts, so that a multiple of it is taken off without rounding.
_HIGH, _LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_PER_OCTAVE = 1.0 / math.log(2.0)
# Bits of sqrt(1/2): what is above it and below sqrt(2) is the mantissa.
_ROOT, _BITS, _BIAS = 0x3FE6A09E667F3BCD, 52, 1023
_FARTHEST = 700.0
# Below this many lanes a library's call is faster.
VECTOR_LANES = 8


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"contract"})
def _parts(w: float) -> tuple[float, float]:
    """Return 2^k and exp(w) / 2^k - 1, the latter to its last digits."""
    k = math.floor(w * _PER_OCTAVE + 0.5)
    r = (w - k * _HIGH) - k * _LOW
    tail = 1 / 5040 + r * (1 / 40320 + r * (1 / 362880 + r * (1 / 3628800 + r * (
        1 / 39916800 + r * (1 / 479001600 + r / 6227020800)))))  # fmt: skip
    part = r * (
        1.0 + r * (1 / 2 + r * (1 / 6 + r * (1 / 24 + r * (1 / 120 + r * (1 / 720 + r * tail)))))
    )
    return np.int64((np.int64(k) + _BIAS) << _BITS).view(np.float64), part


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"contract"})
def expm1(w: float) -> float:
    """Return exp(w) - 1 for w <= 0, to the last digits near zero too."""
    scale, part = _parts(max(w, -_FARTHEST))
    less: float = (scale - 1.0) + scale * part
    return less


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"contract"})
def _octave(x: float) -> tuple[float, float]:
    """Return k and x / 2^k - 1, within sqrt(1/2) and sqrt(2)."""
    bits = np.float64(x).view(np.int64)
    octave = (bits - _ROOT) >> _BITS
    return float(octave), np.int64(bits - (octave << _BITS)).view(np.float64) - 1.0


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"contract"})
def _log_near_one(more: float) -> float:
    """Return log(1 + more) within sqrt(1/2) and sqrt(2)."""
    s = more / (more + 2.0)
    t = s * s
    tail = 1 / 11 + t * (1 / 13 + t * (1 / 15 + t * (1 / 17 + t / 19)))
    odd = 1.0 + t * (1 / 3 + t * (1 / 5 + t * (1 / 7 + t * (1 / 9 + t * tail))))
    return 2.0 * s * odd


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"contract"})
def log(x: float) -> float:
    """Return log x for x > 0 to fourteen digits of what it is below 1e304; finite at zero too."""
    octave, more = _octave(x)
    found: float = _log_near_one(more) + octave * (_HIGH + _LOW)
    return found


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"contract"})
def log1p(x: float) -> float:
    """Return log(1 + x) for x > -1, to the last digits near zero too; finite at -1 and infinity."""
    octave, more = _octave(1.0 + x)
    near = _log_near_one(x if octave == 0.0 else more)
    found: float = near + octave * (_HIGH + _LOW)
    return found


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"contract"})
def power(x: float, n: float) -> float:
    """Return x^n for x >= 0 to thirteen digits, within 1e-304 and 1e304."""
    scale, part = _parts(min(max(n * log(x), -_FARTHEST), _FARTHEST))
    raised: float = scale + scale * part
    return raised


@njit(cache=True, error_model="numpy")
def expm1_lanes(w: Array, out: Array) -> None:
    """Fill ``out[B]`` with exp(w) - 1 of ``w[B]`` <= 0, another array: one alone would end the vectors."""
    if w.shape[0] < VECTOR_LANES:
        for b in range(w.shape[0]):
            out[b] = math.expm1(w[b])
        return
    for b in range(w.shape[0]):
        out[b] = expm1(w[b])
