"""Linear stages, discretised exactly for an input that is linear between samples."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from rdpi_gym.support.arrays import Array


def first_order_hold(a: Array, b: Array, ts_s: float) -> tuple[Array, Array, Array]:
    """Discretise x' = a x + b u for u linear over each interval.

    Parameters
    ----------
    a : float64[m, m]
        System matrix (1/s).
    b : float64[m]
        Input vector.
    ts_s
        Sampling time (s).

    Returns
    -------
    tuple of float64[m, m], float64[m], float64[m]
        F, G0, G1 of x(k+1) = F x(k) + G0 u(k) + G1 u(k+1).

    Examples
    --------
    >>> f, g0, g1 = first_order_hold(np.array([[-1.0]]), np.array([1.0]), 1e-3)
    >>> float(np.round(f[0, 0] + g0[0] + g1[0], 12))
    1.0

    Notes
    -----
    Van Loan's block exponential of [a b 0; 0 0 1/Ts; 0 0 0] Ts.
    """
    from scipy.linalg import expm

    m = len(b)
    block = np.zeros((m + 2, m + 2))
    block[:m, :m] = a * ts_s
    block[:m, m] = b * ts_s
    block[m, m + 1] = 1.0
    step = expm(block)
    ramp = step[:m, m + 1]
    return step[:m, :m], step[:m, m] - ramp, ramp


def lag_step(time_constant_s: float, ts_s: float) -> tuple[float, float, float]:
    """F, G0, G1 of :func:`first_order_hold` for the lag x' = (u - x) / τ, in closed form.

    Parameters
    ----------
    time_constant_s
        τ (s); zero is no lag.
    ts_s
        Sampling time (s).

    Examples
    --------
    >>> lag_step(0.0, 1e-3)
    (0.0, 0.0, 1.0)
    """
    if time_constant_s == 0.0:
        return 0.0, 0.0, 1.0
    h = ts_s / time_constant_s
    decay = math.exp(-h)
    mean = -math.expm1(-h) / h
    return decay, mean - decay, 1.0 - mean


def pack_linear(a: Array, b: Array, c: Array, feedthrough: float, ts_s: float) -> list[float]:
    """Pack y = c x + d u for :func:`linear_block`.

    Parameters
    ----------
    a, b, c
        Matrices of x' = a x + b u, m states, stable.
    feedthrough
        d.
    ts_s
        Sampling time (s).

    Returns
    -------
    list of float
        F by rows, G0, G1, c, d, and the resting state for u = 1.

    Raises
    ------
    LinAlgError
        A system without a resting state (a pole at zero).

    Examples
    --------
    >>> one = np.array([1.0])
    >>> np.round(pack_linear(np.array([[-1.0]]), one, one, 0.0, 1e-3), 4).tolist()
    [0.999, 0.0005, 0.0005, 1.0, 0.0, 1.0]
    """
    f, g0, g1 = first_order_hold(a, b, ts_s)
    rest = np.linalg.solve(-a, b)
    return [*f.ravel(), *g0, *g1, *c, feedthrough, *rest]


def pack_lag(time_constant_s: float, ts_s: float) -> list[float]:
    """Pack a first-order lag with time constant τ (s) for :func:`linear_block`.

    Examples
    --------
    >>> pack_lag(0.0, 1e-3)
    [0.0, 0.0, 1.0, 1.0, 0.0, 1.0]
    """
    return [*lag_step(time_constant_s, ts_s), 1.0, 0.0, 1.0]


def pack_two_lags(first_s: float, second_s: float, ts_s: float) -> list[float]:
    """Pack two lags in a row, τ1 τ2 y'' + (τ1 + τ2) y' + y = u, for :func:`linear_block`.

    Parameters
    ----------
    first_s, second_s
        Time constants τ1 >= τ2 (s); zero is no lag.
    ts_s
        Sampling time (s).

    Returns
    -------
    list of float
        The states are what leaves the slower lag and what leaves both.

    Examples
    --------
    >>> np.round(pack_two_lags(1e-3, 0.0, 1e-3)[:4], 4).tolist()
    [0.3679, 0.0, 0.3679, 0.0]

    Notes
    -----
    In closed form, as it stays exact where one time constant is far below the sampling time and
    where both are nearly the same: with h_i = Ts / τ_i and δ = h2 - h1, what the second state has
    of the first is φ = h2 exp(-h1) (1 - exp(-δ)) / δ.
    """
    slow, before, after = lag_step(first_s, ts_s)
    if second_s <= 1e-15 * ts_s:
        return [slow, 0.0, slow, 0.0, before, before, after, after, 0.0, 1.0, 0.0, 1.0, 1.0]
    h1, h2 = ts_s / first_s, ts_s / second_s
    delta = h2 - h1
    passed = h2 * slow * (-math.expm1(-delta) / delta if delta else 1.0)
    fast = math.exp(-h2)
    ramp = after - (-math.expm1(-h1) - passed * h1 / h2) / h2
    rest = -math.expm1(-h2) - passed - ramp
    return [slow, 0.0, passed, fast, before, rest, after, ramp, 0.0, 1.0, 0.0, 1.0, 1.0]


@njit(cache=True)
def linear_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Run a linear stage; the state is the last input and m states, NaN before the first sample.

    Parameters
    ----------
    x : float64[T, B]
        Input.
    u : float64[T, B]
        Command; not read.
    p : float64[m² + 4m + 1, B]
        As :func:`pack_linear`.
    state : float64[1 + m, B]
        Last input, states.
    ts : float
        Sampling time (s); not read, the parameters hold it.
    y : float64[T, B]
        Filled with the output.
    """
    m = round(math.sqrt(p.shape[0] + 3.0)) - 2
    lanes = x.shape[1]
    g0, g1 = m * m, m * m + m
    c, rest = m * m + 2 * m, m * m + 3 * m + 1
    for b in range(lanes):
        if np.isnan(state[0, b]):
            state[0, b] = x[0, b]
            for i in range(m):
                state[1 + i, b] = p[rest + i, b] * x[0, b]
    new = np.empty((m, lanes))
    for t in range(x.shape[0]):
        for i in range(m):
            for b in range(lanes):
                new[i, b] = p[g0 + i, b] * state[0, b] + p[g1 + i, b] * x[t, b]
            for j in range(m):
                for b in range(lanes):
                    new[i, b] += p[m * i + j, b] * state[1 + j, b]
        for b in range(lanes):
            state[0, b] = x[t, b]
            y[t, b] = p[rest - 1, b] * x[t, b]
        for i in range(m):
            for b in range(lanes):
                state[1 + i, b] = new[i, b]
                y[t, b] += p[c + i, b] * new[i, b]
