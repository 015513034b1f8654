"""The pieces of a foreign plant on a fine grid: memory of turning points, linear systems, limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from rdpi_gym.support.arrays import Array


@njit(cache=True)
def _branch(x: float, rest: Array, weights: Array) -> float:
    """Sum of w_i max(x - r_i, 0): the virgin curve of the plays, for x >= 0."""
    total = 0.0
    for i in range(rest.shape[0]):
        if x <= rest[i]:
            break
        total += weights[i] * (x - rest[i])
    return total


@njit(cache=True)
def _turns(u: Array, rest: Array, weights: Array, history: Array) -> Array:
    turns = np.empty(u.shape[0] + history.shape[0] + 1)
    levels = np.empty(turns.shape[0])  # displacement at each turn that is remembered
    out = np.empty(u.shape[0])
    turns[0], levels[0], depth = 0.0, 0.0, 0  # at rest
    last = 0.0
    way = 0
    for k in range(-history.shape[0], u.shape[0]):
        now = history[k + history.shape[0]] if k < 0 else u[k]
        if now != last:
            turned = 1 if now > last else -1
            if way != 0 and turned != way:
                depth += 1
                turns[depth] = last
                levels[depth] = _level(last, turns, levels, depth - 1, rest, weights)
            way = turned
            # a loop that is left again is forgotten, with both of its turns; the virgin curve is
            # left for good only beyond the largest excursion
            while depth >= 2 and (now - turns[depth - 1]) * way >= 0.0:
                depth -= 2
            if depth == 1 and (now + turns[1]) * way >= 0.0:
                depth = 0
            last = now
        if k >= 0:
            out[k] = _level(now, turns, levels, depth, rest, weights)
    return out


@njit(cache=True)
def _level(
    u: float, turns: Array, levels: Array, depth: int, rest: Array, weights: Array
) -> float:  # fmt: skip
    if depth == 0:
        virgin = _branch(abs(u), rest, weights)
        return float(virgin if u >= 0.0 else -virgin)
    way = 1.0 if u >= turns[depth] else -1.0
    half = 0.5 * abs(u - turns[depth])
    return float(levels[depth] + 2.0 * way * _branch(half, rest, weights))


def plays_by_turning_points(
    u_V: Array, thresholds_V: Array, weights: Array, history_V: Sequence[float] = ()
) -> Array:
    """Sum of weighted plays of constant thresholds, from the turning points that count.

    A Prandtl-Ishlinskii operator is its virgin curve, and on every later branch twice that curve
    of half the distance from the last turning point that is not wiped out. No play is simulated.
    """
    past = np.asarray(history_V, dtype=np.float64)
    return np.asarray(_turns(u_V, thresholds_V, weights, past))


@njit(cache=True)
def _envelopes(
    low: Array, high: Array, shift: Array, rest: Array, weights: Array, history: Array
) -> Array:
    xi = np.zeros(rest.shape[0])
    for k in range(history.shape[0]):
        for i in range(rest.shape[0]):
            xi[i] = max(history[k] - rest[i], min(history[k] + rest[i], xi[i]))
    out = np.empty(low.shape[0])
    for k in range(low.shape[0]):
        total = 0.0
        for i in range(rest.shape[0]):
            r = rest[i] + shift[k]
            x = max(low[k] - r, min(high[k] + r, xi[i]))
            xi[i] = x
            total += weights[i] * x
        out[k] = total
    return out


def plays_by_substeps(
    low_V: Array, high_V: Array, shift_V: Array, thresholds_V: Array, weights: Array,
    history_V: Sequence[float] = (),
) -> Array:  # fmt: skip
    """Sum of weighted plays between two envelopes whose thresholds move."""
    past = np.asarray(history_V, dtype=np.float64)
    return np.asarray(_envelopes(low_V, high_V, shift_V, thresholds_V, weights, past))


def linear(
    x: Array, numerator: Sequence[float], denominator: Sequence[float], step_s: float
) -> Array:
    """Response of a linear system of gain 1 at rest, by the matrix exponential of one step."""
    from scipy.linalg import expm

    order = len(denominator) - 1
    # companion form in units of the step, so that high orders stay near one
    lead = denominator[0]
    scaled = [c / lead * step_s**k for k, c in enumerate(denominator)]
    top = [0.0] * (order + 1 - len(numerator)) + list(numerator)
    row = np.array([c / lead * step_s**k for k, c in enumerate(top)][1:])
    # state, input, and slope of the input over one step
    whole = np.zeros((order + 2, order + 2))
    whole[0, :order] = -np.array(scaled[1:])
    whole[1:order, : order - 1] = np.eye(order - 1)
    whole[0, order] = 1.0
    whole[order, order + 1] = 1.0
    moved = np.asarray(expm(whole), dtype=np.float64)[:order]
    now, slope = moved[:, order] - moved[:, order + 1], moved[:, order + 1]
    out = _recur(x - x[0], np.ascontiguousarray(moved[:, :order]), now, slope, row)
    return np.asarray(x[0] + out)


@njit(cache=True)
def _recur(x: Array, step: Array, now: Array, after: Array, row: Array) -> Array:
    state, out = np.zeros(row.shape[0]), np.empty_like(x)
    moved = np.empty_like(state)
    out[0] = 0.0
    for k in range(1, x.shape[0]):
        total = 0.0
        for i in range(state.shape[0]):
            moved[i] = now[i] * x[k - 1] + after[i] * x[k]
            for j in range(state.shape[0]):
                moved[i] += step[i, j] * state[j]
        for i in range(state.shape[0]):
            state[i] = moved[i]
            total += row[i] * moved[i]
        out[k] = total
    return out


@njit(cache=True)
def limited_rate(x: Array, up: float, down: float) -> Array:
    """Follow `x` by `up` at most a point of the grid upwards, and by `down` downwards."""
    out = np.empty_like(x)
    now = x[0]
    for k in range(x.shape[0]):
        now = now + min(max(x[k] - now, -down), up)
        out[k] = now
    return out


@njit(cache=True)
def charged_softly(x: Array, up: float, down: float, softness: float) -> Array:
    """Follow `x` at a rate R tanh(e / (s R)) a point of the grid, by Runge-Kutta of order four."""
    out = np.empty_like(x)
    now = x[0]
    out[0] = now
    for k in range(1, x.shape[0]):
        a, b = x[k - 1], x[k]
        slopes = np.empty(4)
        for j in range(4):
            at = a if j == 0 else (b if j == 3 else 0.5 * (a + b))
            gone = 0.0 if j == 0 else (slopes[j - 1] if j == 3 else 0.5 * slopes[j - 1])
            e = at - now - gone
            limit = up if e > 0.0 else down
            slopes[j] = limit * np.tanh(e / (softness * limit))
        now += (slopes[0] + 2.0 * slopes[1] + 2.0 * slopes[2] + slopes[3]) / 6.0
        out[k] = now
    return out


@njit(cache=True)
def gap(x: Array, half_width: float) -> Array:
    """Play of one half width, in the middle of its gap at the first point."""
    out = np.empty_like(x)
    now = x[0]
    for k in range(x.shape[0]):
        now = max(x[k] - half_width, min(x[k] + half_width, now))
        out[k] = now
    return out


@njit(cache=True)
def stuck_and_slipped(x: Array, sticks: float, slips: float) -> Array:
    """Body on a spring that holds until it is `sticks` behind and then jumps to `slips` behind."""
    out = np.empty_like(x)
    now = x[0]
    for k in range(x.shape[0]):
        behind = x[k] - now
        if abs(behind) > sticks:
            now = x[k] - (slips if behind > 0.0 else -slips)
        out[k] = now
    return out


@njit(cache=True)
def duhem(u: Array, alpha: float, slope: float, initial: float) -> Array:
    """Coleman-Hodgdon: dy/du = a (b u - y) sgn(du) + c, solved exactly over each step in u."""
    out = np.empty_like(u)
    y, last = 0.0, 0.0
    for k in range(u.shape[0]):
        change = u[k] - last
        if change != 0.0:
            way = 1.0 if change > 0.0 else -1.0
            # with e = y - b u: de/du = -a sgn(du) e + c - b
            e = y - slope * last
            settled = way * (initial - slope) / alpha
            e = settled + (e - settled) * np.exp(-alpha * abs(change))
            y = e + slope * u[k]
            last = u[k]
        out[k] = y
    return out


@njit(cache=True)
def integrated(
    reference: Array, start_V: float, gain: float, low_V: float, high_V: float, a0: float,
    rest: Array, weights: Array, disturbance: Array,
) -> Array:  # fmt: skip
    """Commands of an integrator that follows a reference (µm) around plays and a disturbance (µm)."""
    out, xi, u = np.empty_like(reference), np.zeros(rest.shape[0]), start_V
    for k in range(reference.shape[0]):
        out[k] = u
        y = a0 * u + disturbance[k]
        for i in range(rest.shape[0]):
            x = max(u - rest[i], min(u + rest[i], xi[i]))
            xi[i] = x
            y += weights[i] * x
        u = min(max(u + gain * (reference[k] - y), low_V), high_V)
    return out
