"""The kernel of the Bouc-Wen model: lanes along the curves of their branches."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.plant.cores.elementary import VECTOR_LANES, expm1, log, power
from rdpi_gym.support.arrays import Array

Places: TypeAlias = NDArray[np.int64]

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


# Rows of p from which the curves and the inverses stand; the curves by their number.
_END = 9
_CURVE = (_END + NEAR, _END + FAR, _END + BACK)
_OF_RATIO = _END + WAYS
_WAY_BACK = _OF_RATIO + 1
_WAY_NEAR = _WAY_BACK + WAY_BACK
_WAY_FAR = _WAY_NEAR + WAY_NEAR
_FAR, _BACK = 1.0, 2.0
# What s is at most: z is at its limit long before.
_SATURATED = 1e3
# Below this slope a way is as exact as z is.
_LEAST_SLOPE = 1e-6
# All lanes' rows are taken side by side where more than one of so many lanes changes.
_AT_ONCE = 8


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"contract"})
def _less(s: float, curve: float, n: float, kappa: float) -> float:
    """Return w - 1 of a curve, w = s^n or exp(-n s); for n = 1 that of the exponential it is."""
    linear = -(kappa if curve == _BACK else n) * s
    bent = -n * s if curve == _FAR else n * log(s)
    less: float = expm1(linear if n == 1.0 else bent)
    return less


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"contract"})
def _x_of(
    s: float, curve: float, n: float, kappa: float, less: float, w: float, value: float
) -> float:
    """Return x of a curve's polynomial, w over 1 + c w, and what :func:`_less` returns."""
    bent = 1.0 - w * value if curve == _FAR else s * value
    straight = kappa == 0.0
    back = -less / ((1.0 + less) * (1.0 if straight else kappa))
    back = s if straight else back
    linear = back if curve == _BACK else -less
    return linear if n == 1.0 else bent


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"contract"})
def _polynomial(p: Array, first: int, count: int, b: int, y: float) -> float:
    # even and odd powers apart: half as long a chain of products
    square, even, odd = y * y, p[first, b], p[first + 1, b]
    for j in range(first + 2, first + count, 2):
        even, odd = even * square + p[j, b], odd * square + p[j + 1, b]
    total: float = even * y + odd
    return total


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _x_after(s: float, curve: float, p: Array, b: int) -> float:
    """X of one lane after a way s on its way out, or s before zero on its way back."""
    n, kappa, row = p[6, b], p[7, b], _CURVE[int(curve)]
    less = _less(s, curve, n, kappa)
    w = (1.0 + less) / (1.0 + p[row, b] * (1.0 + less))
    value = _polynomial(p, row + 2, DEGREES, b, w * p[row + 1, b] - 1.0)
    x: float = _x_of(s, curve, n, kappa, less, w, value)
    return x


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"contract"})
def _curve_at(s: float, away: bool, end: float) -> float:
    far = 0.0 if s < end else _FAR
    return far if away else _BACK


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _turn(way: float, p: Array, state: Array, b: int) -> None:
    """Count one lane's way from zero anew (row 4 of the state): it begins to move the other way."""
    z = state[2, b]
    away = (z > 0.0) == (way > 0.0) or z == 0.0
    above = z > 0.0 or (z == 0.0 and way > 0.0)
    limit, rate = (p[2, b], p[4, b]) if above else (p[3, b], p[5, b])
    x = min(abs(z) / limit, 1.0)
    raised = power(x, p[6, b])
    if away:
        slope = max(1.0 - raised, 1e-17)
        if raised < 0.5:
            s = x * _polynomial(p, _WAY_NEAR, WAY_NEAR, b, 4.0 * raised - 1.0)
        else:
            s = x * _polynomial(p, _WAY_FAR, WAY_FAR, b, 4.0 * slope - 1.0) - log(slope) / p[6, b]
    else:
        slope = 1.0 + p[7, b] * raised
        ratio = 1.0 - 1.0 / slope
        s = x * _polynomial(p, _WAY_BACK, WAY_BACK, b, ratio * p[_OF_RATIO, b] - 1.0)
    if slope > _LEAST_SLOPE:  # one step of Newton's method, which leaves z where it is
        s = max(s + (x - _x_after(s, _curve_at(s, away, p[_END, b]), p, b)) / slope, 0.0)
    state[4, b] = s / rate if away else -s / rate
    state[5, b] = math.copysign(p[8, b], way)


@njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _turns(u: Array, t: int, p: Array, state: Array, turns: Array) -> float:
    """Mark the lanes that begin to move the other way, and count them."""
    count = 0.0
    for b in range(len(turns)):
        way = u[t, b] - state[3, b]
        other = 0.0 if way * state[5, b] > 0.0 else 1.0
        other = 1.0 if abs(state[5, b]) != p[8, b] else other
        turns[b] = 0.0 if way == 0.0 else other
        count += turns[b]
    return count


@njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _find_curves(s: Array, p: Array, state: Array, last: Array, curve: Array) -> float:
    """Fill ``curve[B]`` with the curve that each lane is on; return how many were on another."""
    changes = 0.0
    for b in range(len(curve)):
        curve[b] = _curve_at(s[b], state[4, b] >= 0.0, p[_END, b])
        changes += 1.0 if curve[b] != last[b] else 0.0
    return changes


@njit(cache=True, error_model="numpy")
def _take_curves(p: Array, curve: Array, last: Array, changes: float, pieces: Array) -> None:
    """Keep the rows of the curve that each lane is on now."""
    near, far, back = _CURVE
    if changes * _AT_ONCE > len(curve):
        for j in range(PIECE):
            for b in range(len(curve)):
                # read before it is chosen: a choice of what to read is no vector instruction
                one, two, three = p[near + j, b], p[far + j, b], p[back + j, b]
                out = one if curve[b] < _FAR else two
                pieces[j, b] = out if curve[b] < _BACK else three
    else:
        for b in range(len(curve)):
            if curve[b] != last[b]:
                first = _CURVE[int(curve[b])]
                for j in range(PIECE):
                    pieces[j, b] = p[first + j, b]
    for b in range(len(curve)):
        last[b] = curve[b]


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _few_lanes(u: Array, p: Array, state: Array, y: Array) -> None:
    last_row = p.shape[0] - 1
    for b in range(u.shape[1]):
        for t in range(u.shape[0]):
            way = u[t, b] - state[3, b]
            if way != 0.0 and not (way * state[5, b] > 0.0 and abs(state[5, b]) == p[8, b]):
                _turn(way, p, state, b)
            state[3, b] = u[t, b]
            if abs(state[5, b]) == p[8, b]:
                c = state[4, b] + abs(way)
                above = state[5, b] > 0.0 if c >= 0.0 else state[5, b] < 0.0
                s = min(abs(c) * (p[4, b] if above else p[5, b]), _SATURATED)
                x = _x_after(s, _curve_at(s, c >= 0.0, p[_END, b]), p, b)
                state[2, b] = min(x, 1.0) * (p[2, b] if above else -p[3, b])
                state[4, b] = c
            y[t, b] = p[0, b] * u[t, b] + p[1, b] * state[2, b] + p[last_row, b]


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def bouc_wen_block(u: Array, v: Array, p: Array, state: Array, y: Array) -> None:
    """Bouc-Wen model in the command, along the curve of each branch, exact to nine digits and more.

    Between two turns z is one curve over the way of the command: it comes back to zero on one side
    and goes away from it on the other. The way from zero is counted, so that it does not matter how
    a way is cut into samples, nor how long it is; a turn counts it anew, from z.
    """
    last_row, lanes = p.shape[0] - 1, u.shape[1]
    if lanes < VECTOR_LANES:
        _few_lanes(u, p, state, y)
        return
    s, curve, less, w = np.empty(lanes), np.empty(lanes), np.empty(lanes), np.empty(lanes)
    place, value, last = np.empty(lanes), np.empty(lanes), np.full(lanes, -1.0)
    pieces = np.empty((PIECE, lanes))
    for t in range(u.shape[0]):
        if _turns(u, t, p, state, value) > 0.0:
            for b in range(lanes):
                if value[b] > 0.0:
                    _turn(u[t, b] - state[3, b], p, state, b)
        for b in range(lanes):
            state[4, b] += abs(u[t, b] - state[3, b])
            state[3, b] = u[t, b]
        for b in range(lanes):
            away = 1.0 if state[4, b] >= 0.0 else -1.0
            over, under = p[4, b], p[5, b]
            way = abs(state[4, b]) * (over if state[5, b] * away > 0.0 else under)
            s[b] = way if way < _SATURATED else _SATURATED
        changes = _find_curves(s, p, state, last, curve)
        if changes > 0.0:
            _take_curves(p, curve, last, changes, pieces)
        for b in range(lanes):
            less[b] = _less(s[b], curve[b], p[6, b], p[7, b])
        for b in range(lanes):
            w[b] = (1.0 + less[b]) / (1.0 + pieces[0, b] * (1.0 + less[b]))
            place[b] = w[b] * pieces[1, b] - 1.0
        for b in range(lanes):
            value[b] = pieces[2, b] * place[b] + pieces[3, b]
        for j in range(4, PIECE, 4):
            for b in range(lanes):
                two = (value[b] * place[b] + pieces[j, b]) * place[b] + pieces[j + 1, b]
                value[b] = (two * place[b] + pieces[j + 2, b]) * place[b] + pieces[j + 3, b]
        for b in range(lanes):
            value[b] = _x_of(s[b], curve[b], p[6, b], p[7, b], less[b], w[b], value[b])
        for b in range(lanes):
            away = 1.0 if state[4, b] >= 0.0 else -1.0
            up, down, last_z = p[2, b], -p[3, b], state[2, b]
            x = value[b] if value[b] < 1.0 else 1.0
            z = x * (up if state[5, b] * away > 0.0 else down)
            state[2, b] = z if abs(state[5, b]) == p[8, b] else last_z
        for b in range(lanes):
            y[t, b] = p[0, b] * u[t, b] + p[1, b] * state[2, b] + p[last_row, b]


TOGETHER = _END + 1
"""First of the coefficients that :func:`bouc_wen_lanes` finds lane by lane: all but the ends of the curves."""


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"contract"})
def _picked(own: Array, b: int, row: int, count: int, y: float) -> float:
    """As :func:`_polynomial`, of coefficients that stand lane by lane."""
    first = row - TOGETHER
    square, even, odd = y * y, own[b, first], own[b, first + 1]
    for j in range(first + 2, first + count, 2):
        even, odd = even * square + own[b, j], odd * square + own[b, j + 1]
    total: float = even * y + odd
    return total


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _x_lanes(
    s: Array, curve: Array, n: Array, kappa: Array, at: Places, own: Array, rooms: Array, x: Array
) -> None:
    """Fill ``x[m]`` as :func:`_x_after` for the lanes at some places, loop by loop."""
    less, w, value = rooms[0], rooms[1], rooms[2]
    for j in range(len(s)):
        less[j] = _less(s[j], curve[j], n[j], kappa[j])
    for j in range(len(s)):
        row, raised = _CURVE[int(curve[j])], 1.0 + less[j]
        w[j] = raised / (1.0 + own[at[j], row - TOGETHER] * raised)
        place = w[j] * own[at[j], row + 1 - TOGETHER] - 1.0
        value[j] = _picked(own, at[j], row + 2, DEGREES, place)
    for j in range(len(s)):
        x[j] = _x_of(s[j], curve[j], n[j], kappa[j], less[j], w[j], value[j])


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _turn_lanes(ways: Array, p: Array, own: Array, state: Array, at: Places, rooms: Array) -> None:
    """Do as :func:`_turn` for the lanes at some places, loop by loop."""
    m = len(at)
    n, kappa, x, rate = rooms[3, :m], rooms[4, :m], rooms[5, :m], rooms[6, :m]
    out, slope, s, curve = rooms[7, :m], rooms[8, :m], rooms[9, :m], rooms[10, :m]
    for j in range(m):
        b = at[j]
        z, way = state[2, b], ways[b]
        above = (z > 0.0) | ((z == 0.0) & (way > 0.0))
        limit = p[2, b] if above else p[3, b]
        rate[j] = p[4, b] if above else p[5, b]
        out[j] = 1.0 if (z == 0.0) | ((z > 0.0) == (way > 0.0)) else -1.0
        n[j], kappa[j] = p[6, b], p[7, b]
        x[j] = min(abs(z) / limit, 1.0)
    for j in range(m):
        curve[j] = power(x[j], n[j])
    for j in range(m):
        still = 1.0 - curve[j]
        still = still if still > 1e-17 else 1e-17
        slope[j] = still if out[j] > 0.0 else 1.0 + kappa[j] * curve[j]
    for j in range(m):
        s[j] = log(slope[j]) / n[j]
    for j in range(m):
        if out[j] < 0.0:
            place = (1.0 - 1.0 / slope[j]) * own[at[j], _OF_RATIO - TOGETHER] - 1.0
            s[j] = x[j] * _picked(own, at[j], _WAY_BACK, WAY_BACK, place)
        else:
            near = curve[j] < 0.5
            place = 4.0 * (curve[j] if near else slope[j]) - 1.0
            part = x[j] * _picked(own, at[j], _WAY_NEAR if near else _WAY_FAR, WAY_NEAR, place)
            s[j] = part if near else part - s[j]
    for j in range(m):
        curve[j] = _curve_at(s[j], out[j] > 0.0, p[_END, at[j]])
    found = rooms[11, :m]
    _x_lanes(s, curve, n, kappa, at, own, rooms[:3], found)
    for j in range(m):
        b = at[j]
        nearer = s[j] + (x[j] - found[j]) / slope[j]
        nearer = nearer if nearer > 0.0 else 0.0
        way = nearer if slope[j] > _LEAST_SLOPE else s[j]
        state[4, b] = out[j] * way / rate[j]
        state[5, b] = math.copysign(p[8, b], ways[b])


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def bouc_wen_lanes(u: Array, v: Array, p: Array, state: Array, y: Array) -> None:
    """As :func:`bouc_wen_block` for one sample of many lanes, of which any number may turn."""
    last_row, lanes = p.shape[0] - 1, u.shape[1]
    own = p[TOGETHER : last_row - 1].reshape(lanes, last_row - 1 - TOGETHER)
    rooms, at, count = np.empty((12, lanes)), np.empty(lanes, dtype=np.int64), 0
    s, curve = rooms[3], rooms[4]
    for b in range(lanes):
        way, whose = u[0, b] - state[3, b], state[5, b]
        at[count] = b
        goes_on = (way * whose > 0.0) & (abs(whose) == p[8, b])
        count += 0 if goes_on | (way == 0.0) else 1
    if count:
        _turn_lanes(u[0] - state[3], p, own, state, at[:count], rooms)
    for b in range(lanes):
        at[b] = b
        way, u_V = state[4, b] + abs(u[0, b] - state[3, b]), u[0, b]
        state[4, b], state[3, b] = way, u_V
        positive = (way >= 0.0) == (state[5, b] > 0.0)
        slope = p[4, b] if positive else p[5, b]
        s[b] = min(abs(way) * slope, _SATURATED)
        curve[b] = _curve_at(s[b], way >= 0.0, p[_END, b])
    x = rooms[5]
    _x_lanes(s, curve, p[6], p[7], at, own, rooms[:3], x)
    for b in range(lanes):
        positive = (state[4, b] >= 0.0) == (state[5, b] > 0.0)
        z = min(x[b], 1.0) * (p[2, b] if positive else -p[3, b])
        z = z if abs(state[5, b]) == p[8, b] else state[2, b]
        state[2, b] = z
        y[0, b] = p[0, b] * u[0, b] + p[1, b] * z + p[last_row, b]
