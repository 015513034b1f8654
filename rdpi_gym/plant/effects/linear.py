"""Linear stages, discretised exactly for an input that is linear between samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, parameter, rows
from rdpi_gym.support.arrays import Array

# Shares of a filter's higher orders below this are none: their poles are out of sight.
_NONE = 1e-4


def lag_step(time_constant_s: float, ts_s: float) -> tuple[float, float, float]:
    """F, G0, G1 of x(k+1) = F x(k) + G0 u(k) + G1 u(k+1) for the lag x' = (u - x) / τ."""
    if time_constant_s == 0.0:
        return 0.0, 0.0, 1.0
    h = ts_s / time_constant_s
    decay = math.exp(-h)
    mean = -math.expm1(-h) / h
    return decay, mean - decay, 1.0 - mean


def pack_modes(
    modes: Sequence[tuple[float, float, float]], static_share: float, ts_s: float
) -> list[float]:
    """Pack modes side by side, y = s u + Σ s_i y_i, y_i'' + 2 ζ_i ω_i y_i' + ω_i² y_i = ω_i² u.

    Notes
    -----
    In closed form: a matrix exponential for each set of parameters costs a fit more than to run it.
    A step of the input moves the states by (1 - F) times those at rest, and its mean over the
    sampling time, A⁻¹ (that / Ts - b), is what a ramp does.
    """
    m = 2 * len(modes)
    f, before, after = np.zeros((m, m)), np.zeros(m), np.zeros(m)
    for i, (_, f0_hz, damping) in enumerate(modes):
        h = 2.0 * math.pi * f0_hz * ts_s
        slower = math.sqrt(1.0 - damping**2)
        decay, angle = math.exp(-damping * h), slower * h
        cosine, sine = decay * math.cos(angle), decay * math.sin(angle) / slower
        k = slice(2 * i, 2 * i + 2)
        f[k, k] = [[cosine + damping * sine, sine], [-sine, cosine - damping * sine]]
        step = np.array([1.0 - f[2 * i, 2 * i], sine])
        after[k] = 1.0 - (step[1] + 2.0 * damping * step[0]) / h, step[0] / h
        before[k] = step - after[k]
    shares = [value for share, _, _ in modes for value in (share, 0.0)]
    return [*f.ravel(), *before, *after, *shares, static_share, *([1.0, 0.0] * len(modes))]


def pack_lag(time_constant_s: float, ts_s: float) -> list[float]:
    """Pack a first-order lag with time constant τ (s) for :func:`linear_block`."""
    return [*lag_step(time_constant_s, ts_s), 1.0, 0.0, 1.0]


def pack_two_lags(first_s: float, second_s: float, ts_s: float) -> list[float]:
    """Pack two lags in a row, τ1 τ2 y'' + (τ1 + τ2) y' + y = u, for :func:`linear_block`.

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


def pack_filter(slow_s: float, shares: Sequence[float], ts_s: float) -> list[float]:
    """Pack the low-pass y = u / (1 + T s (1 + c T s (1 + d T s (1 + ...)))) for :func:`linear_block`.

    Notes
    -----
    Van Loan's block exponential of [a b 0; 0 0 1/Ts; 0 0 0] Ts, by a Taylor series and squaring:
    coefficients, unlike poles, go smoothly from real poles to pairs.
    """
    m = 1 + len(shares)
    f, before, after, rest = np.zeros((m, m)), np.zeros(m), np.zeros(m), np.eye(m)[0]
    if slow_s <= 1e-12 * ts_s:
        return [*f.ravel(), *before, *rest, *rest, 0.0, *rest]
    order = 1 + len(list(takewhile(lambda share: share >= _NONE, shares)))
    h, powers = ts_s / slow_s, [1.0, *np.cumprod([1.0, *shares]).tolist()]
    block = np.zeros((m + 2, m + 2))
    for i in range(order - 1):
        block[i, i + 1] = h
    block[order - 1, :order] = [-h * power / powers[order] for power in powers[:order]]
    block[order - 1, m], block[m, m + 1] = h / powers[order], 1.0
    step = _exponential(block)
    f[:order, :order], after[:order] = step[:order, :order], step[:order, m + 1]
    before = rest - f @ rest - after  # what rests stays there
    return [*f.ravel(), *before, *after, *rest, 0.0, *rest]


def _exponential(a: Array) -> Array:
    """Matrix exponential of a few rows: solvers spread over threads what takes microseconds."""
    halvings = max(0, math.frexp(float(np.abs(a).sum(axis=1).max()))[1] + 2)
    part, one = a / 2.0**halvings, np.eye(len(a))
    total = one
    for k in range(12, 0, -1):
        total = one + part @ total / k
    for _ in range(halvings):
        total = total @ total
    return np.asarray(total, dtype=np.float64)


@njit(cache=True)
def linear_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Run a linear stage; the state is the last input and m states, NaN before the first sample."""
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


def _lags_s(scale: DataScale) -> tuple[float, ...]:
    """Times that a fit of a lag begins with (s): parts and multiples of the shortest sampling time."""
    return tuple(4.0**k * scale.shortest_s for k in range(-1, 4))


@dataclass(frozen=True)
class FirstOrderLag(Effect):
    """Lag, in either place of one."""

    time_constant_s: float = 2e-4

    block = staticmethod(linear_block)
    state_rows = rows(2)  # last input and output

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """From a lag between two samples to one of many."""
        return tuple(cls.within_bounds(time_constant_s=lag_s) for lag_s in _lags_s(scale))

    @property
    def slow_lag_s(self) -> float:
        """The time constant."""
        return self.time_constant_s

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """As :func:`linear_block` reads them."""
        return pack_lag(self.time_constant_s, ts_s)


@dataclass(frozen=True)
class SecondOrderLag(Effect):
    """Two lags in a row, in either place of one."""

    time_constant_s: float = parameter(
        2e-4, "s", 0.0, 0.1, (3e-5, 1e-3), "larger time constant, τ1", neutral=0.0
    )
    second_ratio: float = parameter(
        0.3, "1", 0.0, 1.0, (0.1, 1.0), "second over it, q", neutral=0.0
    )

    form = "second order"
    signature = "As a lag, and beyond both cut-offs the phase goes to 180 degrees: steps begin with no slope."
    block = staticmethod(linear_block)
    state_rows = rows(3)  # last input and what leaves each lag

    @property
    def slow_lag_s(self) -> float:
        """Both time constants."""
        return self.time_constant_s * (1.0 + self.second_ratio)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """From a lag between two samples to one of many, shared unequally."""
        return tuple(
            cls.within_bounds(time_constant_s=lag_s / 1.3, second_ratio=0.3)
            for lag_s in _lags_s(scale)
        )

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The same delay of slow signals, shared unequally and equally."""
        whole = simpler.values["time_constant_s"]
        return tuple(
            cls.within_bounds(time_constant_s=whole / (1.0 + ratio), second_ratio=ratio)
            for ratio in (0.1, 0.7)
        )

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """As :func:`linear_block` reads them."""
        return pack_two_lags(self.time_constant_s, self.second_ratio * self.time_constant_s, ts_s)


@dataclass(frozen=True)
class FourthOrderLag(Effect):
    """Low-pass of up to fourth order, with real poles or pairs, in either place of a lag."""

    time_constant_s: float = parameter(
        2e-4, "s", 0.0, 0.1, (3e-5, 1e-3), "delay of slow signals, T", neutral=0.0
    )
    second_share: float = parameter(
        0.4, "1", 0.0, 1.0, (0.2, 0.5), "of the second order, c", neutral=0.0
    )
    third_share: float = parameter(
        0.2, "1", 0.0, 0.8, (0.1, 0.3), "of the third order, d", neutral=0.0
    )
    fourth_share: float = parameter(
        0.3,
        "1",
        0.0,
        0.8,
        (0.15, 0.4),
        "of the fourth order, over the largest that is stable, e",
        neutral=0.0,
    )

    form = "fourth order"
    equation = "c² d (1 - d) e T⁴ d⁴y/dt⁴ + c d T³ d³y/dt³ + c T² d²y/dt² + T dy/dt + y = y_m"
    source = (
        "Filters of Bessel have c = 1/3 (second order), 0.4 and d = 1/6 (third), 3/7, 2/9 and e = 0.3 "
        "(fourth); of Butterworth 0.5, 1/4 and 0, 0.5, 0.293 and 0.414. The cut-off is an estimate."
    )
    cause = (
        "A filter in front of a converter, which seldom is of first order, or some lags in a row."
    )
    block = staticmethod(linear_block)
    state_rows = rows(5)  # last input and four states

    @property
    def slow_lag_s(self) -> float:
        """The first of its numbers."""
        return self.time_constant_s

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Delays of a filter of Bessel's kind, from one between two samples to one of many."""
        return tuple(
            cls.within_bounds(
                time_constant_s=lag_s, second_share=0.4, third_share=0.17, fourth_share=0.15
            )
            for lag_s in _lags_s(scale)
        )

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The same delay of slow signals, with the poles that were found and of a filter."""
        ratio = simpler.values.get("second_ratio", 0.0)
        slow_s = simpler.values["time_constant_s"] * (1.0 + ratio)
        found = max(0.1, ratio / (1.0 + ratio) ** 2)
        return tuple(
            cls.within_bounds(time_constant_s=slow_s, second_share=c, third_share=d, fourth_share=e)
            for c, d, e in ((found, 0.05, 0.05), (0.4, 0.17, 0.15))
        )

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """As :func:`linear_block` reads them."""
        c, d = self.second_share, self.third_share
        # Routh and Hurwitz: at e = 1 two poles lie on the imaginary axis
        return pack_filter(self.time_constant_s, (c, d, self.fourth_share * c * (1.0 - d)), ts_s)
