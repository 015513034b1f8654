"""One branch of the Bouc-Wen model as a curve over the way of the command, in a few polynomials.

On either side of zero, z over its limit there, x, follows dx/ds = 1 - x^n away from zero and
dx/ds = 1 + κ x^n on the way back, counted from zero. Both solutions are functions of s alone, so
that one branch, however long and however it is cut into samples, is one curve. They are smooth in

- the way out, near: x / s over r = t / (1 + t / T), t = s^n, which puts the pole at t = -T off;
- the way out, far: (1 - x) / v over v = E / (1 + q E), E = exp(-n s), with the poles at v infinite;
- the way back: x / s over s^n;

and so are their inverses, the ways W over x: W / x over p = x^n, for p above one half W + log(1 - p)
/ n, over x as well, over 1 - p; and on the way back W / x over κ p / (1 + κ p).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numba import njit

from rdpi_gym.support.arrays import Array

DEGREES = 14
"""Coefficients of a curve: near and far on the way out, and on the way back; their errors are below
1e-12, at κ of 5 below 1e-7."""
WAY_BACK, WAY_NEAR, WAY_FAR = 12, 8, 8
"""Coefficients of the inverses, which are only where a search begins."""
PIECE = DEGREES + 2
"""Rows of a curve: with w = s^n, or E, a polynomial in f w / (1 + c w) - 1: c, f, coefficients."""
NEAR, FAR, BACK, WAYS = 1, 1 + PIECE, 1 + 2 * PIECE, 1 + 3 * PIECE
"""First rows of each curve, and of the inverses; row 0 is the s at which what is near ends."""
COUNT = WAYS + 1 + WAY_BACK + WAY_NEAR + WAY_FAR

_TERMS, _SERIES, _NEWTON = 64, 400, 60
_LONGEST = 1.6


@njit(cache=True)
def _sum_near(p: float, n: float) -> float:
    """W / x on the way out for p = x^n of at most one half."""
    total, power = 0.0, 1.0
    for j in range(_TERMS):
        total += power / (j * n + 1.0)
        power *= p
    return total


@njit(cache=True)
def _sum_far(w: float, a: float, d0: float) -> float:
    """(W + log(w) / n) / x on the way out for w = 1 - x^n of at most one half."""
    total, factor, d = 0.0, 1.0, d0
    for k in range(_TERMS):
        total += factor * d
        d += 1.0 / (k + 1.0) - 1.0 / (a + k)
        factor *= w * (a + k) / (k + 1.0)
    return a * total


@njit(cache=True)
def _first_difference(n: float, a: float) -> float:
    """ψ(1) - ψ(1 / n), of the digamma function, by the two series at p = 1/2."""
    power: float = a * 2.0**a
    first: float = (_sum_near(0.5, n) - _sum_far(0.5, a, 0.0)) / power - math.log(2.0)
    return first


@njit(cache=True)
def _way_out(x: float, n: float, d0: float) -> float:
    p: float = x**n
    if p <= 0.5:
        near: float = x * _sum_near(p, n)
        return near
    far: float = x * _sum_far(1.0 - p, 1.0 / n, d0) - math.log(1.0 - p) / n
    return far


@njit(cache=True)
def _sum_back(ratio: float, a: float) -> float:
    """W / x (1 + κ p) on the way back for a ratio κ p / (1 + κ p)."""
    total, term = 0.0, 1.0
    for k in range(_SERIES):
        total += term
        term *= ratio * (k + 1.0) / (1.0 + a + k)
        if term < 1e-17:
            break
    return total


@njit(cache=True)
def _way_back(x: float, n: float, kappa: float) -> float:
    power = kappa * x**n
    way: float = x / (1.0 + power) * _sum_back(power / (1.0 + power), 1.0 / n)
    return way


@njit(cache=True)
def _out_after(s: float, n: float, d0: float) -> float:
    """X after a way s out, by a bracketed Newton search."""
    low, high = 0.0, 1.0
    x = math.tanh(s)
    for _ in range(_NEWTON):
        excess = _way_out(x, n, d0) - s
        low, high = (low, x) if excess > 0.0 else (x, high)
        ahead = x - excess * (1.0 - x**n)
        if not low < ahead < high:
            ahead = 0.5 * (low + high)
        if abs(ahead - x) < 1e-16:
            break
        x = ahead
    return x


@njit(cache=True)
def _short_of_one(s: float, n: float, d0: float) -> float:
    """1 - x after a way s out that is far, to its own last digits: a search for log(1 - x^n)."""
    a = 1.0 / n
    level = min(-0.7, n * (1.0 - s))
    for _ in range(_NEWTON):
        w = math.exp(level)
        x = math.exp(a * math.log1p(-w))
        change = (x * _sum_far(w, a, d0) - a * level - s) * (1.0 - w) / (a * x)
        level = min(level + change, -0.3)
        if abs(change) < 1e-15:
            break
    return -math.expm1(a * math.log1p(-math.exp(level)))


@njit(cache=True)
def _back_after(s: float, n: float, kappa: float) -> float:
    """X where the way back to zero is s: Newton's method, which comes from below."""
    x = s
    for _ in range(_NEWTON):
        change = (s - _way_back(x, n, kappa)) * (1.0 + kappa * x**n)
        x += change
        if change < 1e-16:
            break
    return x


@njit(cache=True)
def _values(n: float, kappa: float, d0: float, head: Array, places: Array, out: Array) -> None:
    """Fill ``out`` with what the polynomials go through at their places, 0 to 1."""
    a, i = 1.0 / n, 0
    per_T, r_end, v_end, back_end, ratio_end, q = head
    for j in range(i, i + DEGREES):
        r = places[j] * r_end
        s = (r / (1.0 - r * per_T)) ** a
        out[j] = _out_after(s, n, d0) / s
    i += DEGREES
    for j in range(i, i + DEGREES):
        v = places[j] * v_end
        out[j] = _short_of_one(-math.log(v / (1.0 - q * v)) / n, n, d0) / v
    i += DEGREES
    for j in range(i, i + DEGREES):
        s = back_end * places[j] ** a
        out[j] = _back_after(s, n, kappa) / s
    i += DEGREES
    for j in range(i, i + WAY_BACK):
        ratio = places[j] * ratio_end
        out[j] = (1.0 - ratio) * _sum_back(ratio, a)
    i += WAY_BACK
    for j in range(i, i + WAY_NEAR):
        out[j] = _sum_near(0.5 * places[j], n)
    i += WAY_NEAR
    for j in range(i, i + WAY_FAR):
        out[j] = _sum_far(0.5 * places[j], a, d0)


def _through(count: int) -> tuple[Array, Array]:
    """Two matrices that make a polynomial in -1 ... 1, highest power first, of values at its places.

    By Chebyshev's polynomials: in one matrix large numbers would cancel.
    """
    places = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    shares: Array = np.array(2.0 / count * np.polynomial.chebyshev.chebvander(places, count - 1).T)
    shares[0] *= 0.5
    powers = np.zeros((count, count))
    for m in range(count):
        powers[: m + 1, m] = np.polynomial.chebyshev.cheb2poly(np.eye(count)[m, : m + 1])
    return shares, powers[::-1]


_COUNTS = (DEGREES, DEGREES, DEGREES, WAY_BACK, WAY_NEAR, WAY_FAR)
_PLACES = np.concatenate([0.5 + 0.5 * np.cos(np.pi * (np.arange(k) + 0.5) / k) for k in _COUNTS])
_MATRICES = {count: _through(count) for count in set(_COUNTS)}


@lru_cache(maxsize=4096)
def curves(n: float, kappa: float) -> tuple[float, ...]:
    """Return the numbers of both curves and of their inverses, as the kernel reads them."""
    d0 = _first_difference(n, 1.0 / n)
    pole = (math.pi / n) / math.sin(math.pi / n)
    near_end = min(pole, _LONGEST)
    t = near_end**n
    q = math.exp(math.pi / math.tan(math.pi / n)) if n > 1.0 else 0.0
    E = math.exp(-n * near_end)
    back_end, ratio_end = _way_back(1.0, n, kappa), kappa / (1.0 + kappa)
    r_end, v_end = t / (1.0 + t * pole**-n), E / (1.0 + q * E)
    values = np.empty(len(_PLACES))
    ends = np.array([pole**-n, r_end, v_end, back_end, ratio_end, q])
    _values(n, kappa, d0, ends, _PLACES, values)
    heads: tuple[tuple[float, ...], ...] = (
        (pole**-n, 2.0 / r_end), (q, 2.0 / v_end), (0.0, 2.0 / back_end**n),
        (2.0 / ratio_end if kappa > 0.0 else 0.0,), (), (),
    )  # fmt: skip
    found, begin = [near_end], 0
    for count, head in zip(_COUNTS, heads, strict=True):
        shares, powers = _MATRICES[count]
        found += [*head, *(powers @ (shares @ values[begin : begin + count])).tolist()]
        begin += count
    return tuple(found)
