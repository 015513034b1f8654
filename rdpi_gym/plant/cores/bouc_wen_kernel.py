"""The kernel of the Bouc-Wen model: lanes along the curves of their branches."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.bouc_wen_curves import (
    BACK,
    DEGREES,
    FAR,
    NEAR,
    PIECE,
    WAY_BACK,
    WAY_FAR,
    WAY_NEAR,
    WAYS,
)
from rdpi_gym.plant.cores.elementary import VECTOR_LANES, expm1, log, power
from rdpi_gym.support.arrays import Array

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
    last[:] = curve


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
