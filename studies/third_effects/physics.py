"""Kernels of the third study's plants: Maxwell-slip elements, differential equations, linear filters."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit

from rdpi_gym.support.arrays import Array


@njit(cache=True)
def slip_sums(u: Array, wider: Array, yields: Array, weights: Array, past: Array) -> Array:
    """Weighted sums of u - s over Maxwell-slip elements whose spring elongation s yields, ``[T, m]``.

    An element begins at rest, or where the commands of `past` left it. `weights` is ``[n, m]``.
    """
    n, m = weights.shape
    s, last = np.zeros(n), 0.0
    out = np.zeros((u.shape[0], m))
    for k in range(-past.shape[0], u.shape[0]):
        now = past[k + past.shape[0]] if k < 0 else u[k]
        more = 0.0 if k < 0 else wider[k]
        for i in range(n):
            limit = yields[i] + more
            s[i] = max(-limit, min(limit, s[i] + now - last))
            if k >= 0:
                for j in range(m):
                    out[k, j] += weights[i, j] * (now - s[i])
        last = now
    return out


@njit(cache=True)
def follow(
    x: Array, tau: float, up: float, down: float, growth: float, centre: float, span: float
) -> Array:
    """Charge a capacitance that grows with its voltage, through a resistance and a current limit.

    Time constant in steps, limits in units a step, both at the centre.
    """
    out, y = np.empty_like(x), x[0]
    for k in range(x.shape[0]):
        c = max(0.1, 1.0 + growth * (y - centre) / span)
        gone = 1.0 if tau <= 0.0 else 1.0 - math.exp(-1.0 / (tau * c))
        y += max(-down / c, min(up / c, gone * (x[k] - y)))
        out[k] = y
    return out


@njit(cache=True)
def soft_mode(x: Array, w: float, damping: float, soft: float) -> Array:
    """Mode whose spring softens with its elongation: Runge-Kutta of order four, `w` in rad a step."""
    out = np.empty_like(x)
    y, v = x[0], 0.0
    out[0] = y
    for k in range(1, x.shape[0]):
        a, b = x[k - 1], x[k]
        middle = 0.5 * (a + b)
        dy1, dv1 = v, _pull(a - y, v, w, damping, soft)
        dy2 = v + 0.5 * dv1
        dv2 = _pull(middle - y - 0.5 * dy1, dy2, w, damping, soft)
        dy3 = v + 0.5 * dv2
        dv3 = _pull(middle - y - 0.5 * dy2, dy3, w, damping, soft)
        dy4 = v + dv3
        dv4 = _pull(b - y - dy3, dy4, w, damping, soft)
        y += (dy1 + 2.0 * dy2 + 2.0 * dy3 + dy4) / 6.0
        v += (dv1 + 2.0 * dv2 + 2.0 * dv3 + dv4) / 6.0
        out[k] = y
    return out


@njit(cache=True)
def _pull(d: float, v: float, w: float, damping: float, soft: float) -> float:
    d = d / (1.0 + soft * abs(d))
    return w * w * d - 2.0 * damping * w * v


@njit(cache=True)
def dragged_gap(x: Array, half: Array, leak: float) -> Array:
    """Gap whose body creeps towards its middle by a share of the way a step."""
    out, y = np.empty_like(x), x[0]
    for k in range(x.shape[0]):
        y += leak * (x[k] - y)
        y = max(x[k] - half[k], min(x[k] + half[k], y))
        out[k] = y
    return out


@njit(cache=True)
def endochronic(
    u: Array, width: float, power: float, share: float, skew: float, pinch: float
) -> Array:
    """Internal variable z of w dz = (1 - |z|^n (share sgn(z du) + 1 - share + skew sgn z)) du.

    Dahl, Bouc-Wen and their unlike branches; `pinch` slows it about z = 0.
    """
    out, z = np.empty_like(u), 0.0
    last = u[0]
    for k in range(u.shape[0]):
        change = u[k] - last
        parts = 1 + int(abs(change) / (0.02 * width))
        way = 1.0 if change > 0.0 else -1.0
        h = change / (parts * width)
        for _ in range(parts):
            middle = z + 0.5 * h * _rate(z, way, power, share, skew, pinch)
            z += h * _rate(middle, way, power, share, skew, pinch)
        out[k] = z
        last = u[k]
    return out


@njit(cache=True)
def _rate(z: float, way: float, power: float, share: float, skew: float, pinch: float) -> float:
    sign = 1.0 if z > 0.0 else -1.0 if z < 0.0 else 0.0
    pull = abs(z) ** power * (share * sign * way + 1.0 - share + skew * sign)
    return float((1.0 - pull) * (1.0 - pinch * math.exp(-25.0 * z * z)))


@njit(cache=True)
def dahl(u: Array, width: float, power: float) -> Array:
    """Dahl's friction: w dz = (1 - z sgn(du))^i du."""
    out, z, last = np.empty_like(u), 0.0, u[0]
    for k in range(u.shape[0]):
        change = u[k] - last
        parts = 1 + int(abs(change) / (0.01 * width))
        way = 1.0 if change > 0.0 else -1.0
        for _ in range(parts):
            z += change / (parts * width) * max(1.0 - z * way, 0.0) ** power
        out[k] = z
        last = u[k]
    return out


@njit(cache=True)
def enveloped(low: Array, high: Array, widths: Array, weights: Array) -> Array:
    """Weighted sum of plays between a falling and a rising envelope, from rest."""
    out, y = np.zeros_like(low), np.full(widths.shape[0], 0.5 * (low[0] + high[0]))
    for k in range(low.shape[0]):
        for i in range(widths.shape[0]):
            y[i] = max(low[k] - widths[i], min(high[k] + widths[i], y[i]))
            out[k] += weights[i] * y[i]
    return out


@njit(cache=True)
def coleman_hodgdon(u: Array, alpha: float, slope: float, initial: float, bend: float) -> Array:
    """Duhem hysteresis dy = a |du| (f(u) - y) + g du with f(u) = slope tanh(bend u) / bend."""
    out, y = np.empty_like(u), 0.0
    last = u[0]
    for k in range(u.shape[0]):
        change = u[k] - last
        parts = 1 + int(abs(change) * alpha / 0.02)
        h = change / parts
        for j in range(parts):
            at = last + (j + 0.5) * h
            f = slope * math.tanh(bend * at) / bend
            gone = math.exp(-alpha * abs(h))
            y = f + (y - f) * gone + initial * h
        out[k] = y
        last = u[k]
    return out


@njit(cache=True)
def jiles_atherton(u: Array, shape: float, pinning: float, reversible: float) -> Array:
    """Magnetisation (share of saturation) over the field, without coupling between domains."""
    out, m_irr, last = np.empty_like(u), 0.0, u[0]
    for k in range(u.shape[0]):
        change = u[k] - last
        parts = 1 + int(abs(change) / (0.02 * pinning))
        h = change / parts
        way = 1.0 if change > 0.0 else -1.0
        for j in range(parts):
            gap = _langevin((last + (j + 0.5) * h) / shape) - m_irr
            if gap * way > 0.0:  # walls move against the pinning, never back
                m_irr += gap * (1.0 - math.exp(-abs(h) / pinning))
        out[k] = (1.0 - reversible) * m_irr + reversible * _langevin(u[k] / shape)
        last = u[k]
    return out


@njit(cache=True)
def _langevin(x: float) -> float:
    return float(x / 3.0 if abs(x) < 1e-3 else 1.0 / math.tanh(x) - 1.0 / x)


@njit(cache=True)
def bristles(v: Array, s0: float, s1: float, low: float, high: float, slow: float) -> Array:
    """LuGre friction over the speed: displacements `v` a step; exact in each step for the speed."""
    out, z = np.empty_like(v), 0.0
    for k in range(v.shape[0]):
        g = (low + (high - low) * math.exp(-((v[k] / slow) ** 2))) / s0
        before = z
        if v[k] != 0.0:
            way = 1.0 if v[k] > 0.0 else -1.0
            z = way * g + (z - way * g) * math.exp(-abs(v[k]) / g)
        out[k] = s0 * z + s1 * (z - before)
    return out


@njit(cache=True)
def loop_commands(
    wish: Array, noise: Array, gain: float, yields: Array, weights: Array, integral: float,
    proportional: float, low: float, high: float,
) -> Array:  # fmt: skip
    """Commands of a PI controller around Maxwell-slip elements and a noisy sensor, sample by sample."""
    out, s = np.empty_like(wish), np.zeros(yields.shape[0])
    summed, u, last = wish[0] / gain, wish[0] / gain, 0.0
    for k in range(wish.shape[0]):
        out[k] = u
        y = (gain - np.sum(weights)) * u + noise[k]
        for i in range(yields.shape[0]):
            s[i] = max(-yields[i], min(yields[i], s[i] + u - last))
            y += weights[i] * (u - s[i])
        last = u
        error = (wish[k] - y) / gain
        summed = max(low, min(high, summed + integral * error))
        u = max(low, min(high, summed + proportional * error))
    return out


def filtered(x: Array, top: Sequence[float], bottom: Sequence[float], step: float) -> Array:
    """Response of a linear system at rest to a command that is linear between points."""
    from scipy.signal import cont2discrete, lfilter

    b, a, _ = cont2discrete((np.array(top), np.array(bottom)), step, method="foh")
    return np.asarray(x[0] + lfilter(np.ravel(b), a, x - x[0]))


def relaxed(x: Array, tau: float, step: float) -> Array:
    """Response of a first-order low-pass at rest."""
    return filtered(x, [1.0], [tau, 1.0], step)
