"""The Bouc-Wen model: an inner length that saturates, beside a line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.checks import check_gain, check_rate_bandwidth, check_shape
from rdpi_gym.plant.cores.elementary import VECTOR_LANES, power
from rdpi_gym.plant.cores.inner_variable import LENGTHS, InnerVariable
from rdpi_gym.plant.parameters import DataScale, Parameter
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite, shown
from rdpi_gym.support.errors import InputError

# Of k, what the least slope is at least; what k is at least.
_LEAST = 1e-6
# Longest sub-step over the largest slope of the right-hand side: its error is below 1e-7 of the stroke.
_STEP = 0.08
# Within this many sub-steps of zero the step is taken by the series of the way from zero.
_NEAR, _TERMS, _NEWTON = 4.0, 60, 6
# Sub-steps that lanes take side by side, and the least z over its limit there.
_TOGETHER, _APART = 8.0, 1e-9


@njit(cache=True, error_model="numpy")
def _way_from_zero(x: float, ratio: float, n: float) -> float:
    """Return the integral of 1 / (1 + c ξ^n) from 0 to x, for a ratio -c x^n well below one."""
    term, total = x, x
    for j in range(1, _TERMS):
        term *= ratio
        total += term / (j * n + 1.0)
        if abs(term) < 1e-17:
            break
    return total


@njit(cache=True, error_model="numpy")
def _near(x: float, h: float, c: float, n: float) -> float:
    """Return x after a step h of dx/dh = sgn(h) (1 + c x^n) that stays above zero, near zero."""
    ratio = -c * math.pow(x, n)
    goal = _way_from_zero(x, ratio, n) + h
    found = max(x + h * (1.0 - ratio), 0.0)
    for _ in range(_NEWTON):
        ratio = -c * math.pow(found, n)
        change = (_way_from_zero(found, ratio, n) - goal) * (1.0 - ratio)
        found = max(found - change, 0.0)
        if abs(change) < 1e-8:  # of which the next one is the square
            break
    return found


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"contract"})
def _taylor(x: float, h: float, sign: float, c: float, n: float, raised: float) -> float:
    """Return x after a step h of dx/dh = sign (1 + c x^n), to the fifth order, given x^n."""
    inverse = 1.0 / x
    part = sign * c * raised
    f = sign + part
    f1 = n * part * inverse
    f2 = (n - 1.0) * f1 * inverse
    f3 = (n - 2.0) * f2 * inverse
    f4 = (n - 3.0) * f3 * inverse
    square = f1 * f1
    third = square + f * f2
    fourth = f1 * square + f * (4.0 * f1 * f2 + f * f3)
    fifth = square * square + f * (
        11.0 * square * f2 + f * (4.0 * f2 * f2 + 7.0 * f1 * f3 + f * f4)
    )
    curve = f1 + h * (1 / 3) * (third + h * 0.25 * (fourth + h * 0.2 * fifth))
    return x + h * f * (1.0 + h * 0.5 * curve)


@njit(cache=True, error_model="numpy")
def _taylor_lanes(x: Array, h: Array, sign: Array, c: Array, n: Array, out: Array) -> None:
    """Fill ``out[B]`` with :func:`_taylor` of each lane, one at most."""
    if out.shape[0] < VECTOR_LANES:
        for b in range(out.shape[0]):
            out[b] = min(_taylor(x[b], h[b], sign[b], c[b], n[b], math.pow(x[b], n[b])), 1.0)
        return
    for b in range(out.shape[0]):
        out[b] = min(_taylor(x[b], h[b], sign[b], c[b], n[b], power(x[b], n[b])), 1.0)


@njit(cache=True, error_model="numpy")
def _step(
    z: float,
    way: float,
    up: bool,
    limits: tuple[float, float],
    rates: tuple[float, float],
    n: float,
    kappa: float,
) -> float:
    """Return z after a way of the command in one direction; limits and rates ahead and behind."""
    side = 1.0 if up else -1.0
    if side * z < 0.0:
        x, left = _fall(min(abs(z) / limits[1], 1.0), way * rates[1], kappa, n)
        z = -side * limits[1] * x
        way = left / rates[1]
    if way > 0.0 and side * z >= 0.0:
        z = side * limits[0] * _rise(min(abs(z) / limits[0], 1.0), way * rates[0], n)
    return z


@njit(cache=True, error_model="numpy")
def _rise(x: float, h: float, n: float) -> float:
    """Return x in [0, 1] after a way h of dx/dh = 1 - x^n."""
    if n == 1.0:
        return x - (1.0 - x) * math.expm1(-h)
    if h > 2.0 + 40.0 / n:  # from zero it is within a rounding of one
        return 1.0
    count = math.ceil(h * n / _STEP)
    step = h / max(count, 1)
    for _ in range(count):
        x = (
            _near(x, step, -1.0, n)
            if x < _NEAR * step
            else _taylor(x, step, 1.0, -1.0, n, math.pow(x, n))
        )
        if x >= 1.0:
            return 1.0
    return x


@njit(cache=True, error_model="numpy")
def _fall(x: float, h: float, kappa: float, n: float) -> tuple[float, float]:
    """Return x in [0, 1] after a way h of dx/dh = -(1 + κ x^n), at zero at most, and the way left."""
    if kappa == 0.0:
        return max(x - h, 0.0), max(h - x, 0.0)
    if n == 1.0:
        shrunk = math.expm1(-kappa * h)
        end = x + x * shrunk + shrunk / kappa
        if end > 0.0:
            return end, 0.0
        return 0.0, max(h - math.log1p(kappa * x) / kappa, 0.0)
    longest = _STEP / (n * max(kappa, 1.0))
    while h > 0.0:
        step = min(h, longest)
        if x < _NEAR * step:
            way = _way_from_zero(x, -kappa * math.pow(x, n), n)
            if way <= step:
                return 0.0, h - way
            x = _near(x, -step, kappa, n)
        else:
            x = _taylor(x, step, -1.0, kappa, n, math.pow(x, n))
        h -= step
    return x, 0.0


@njit(cache=True, error_model="numpy")
def bouc_wen_block(u: Array, v: Array, p: Array, state: Array, y: Array) -> None:
    """Bouc-Wen model in the command: exact for n = 1, in bounded sub-steps for others.

    On either side of zero, z over its limit there follows 1 - x^n away from zero, and 1 + κ x^n,
    κ = (β - γ) / (β + γ), towards it; the step that crosses zero is cut there.

    Parameters
    ----------
    u, v : float64[T, B]
        Command (V) and its rate (V/s), which is not read.
    p, state : float64[P, B], float64[S, B]
        Rows of ``p``: k, d (µm/V), limits of z above and below zero (V), slope of z over the
        command at zero above and below, over those limits (1/V), n, κ; last row: offset (µm).
        Rows 2 and 3 of the state, z and the command that it has followed (V), are moved to the end
        of the block.
    y : float64[T, B]
        Filled with the displacement (µm).
    """
    last_row, lanes = p.shape[0] - 1, u.shape[1]
    xs, hs, signs = np.empty(lanes), np.empty(lanes), np.empty(lanes)
    cs, ns, out = np.empty(lanes), p[6].copy(), np.empty(lanes)
    per_up, per_down = 1.0 / p[2], 1.0 / p[3]
    steps, together = np.empty(lanes), np.empty(lanes, dtype=np.bool_)
    for t in range(u.shape[0]):
        most = 0.0
        for b in range(lanes):
            way, z = u[t, b] - state[3, b], state[2, b]
            above = z > 0.0
            back = (way < 0.0) if above else (way > 0.0)
            n = ns[b]
            c, sign = (p[7, b], -1.0) if back else (-1.0, 1.0)
            x = abs(z) * (per_up[b] if above else per_down[b])
            h = abs(way) * (p[4, b] if above else p[5, b])
            step, count = h, 1.0
            needed = h * n * max(c, 1.0) * (1.0 / _STEP)
            if 1.0 < needed <= _TOGETHER:
                count = math.ceil(needed)
                step = h / count
            least = _NEAR * step + _APART + ((1.0 + c) * h if back else 0.0)
            together[b] = n != 1.0 and needed <= _TOGETHER and x > least
            if together[b]:
                most = max(most, count)
            steps[b] = count
            xs[b] = min(max(x, _APART), 1.0)
            hs[b] = step
            signs[b] = sign
            cs[b] = c
        done = 0.0
        while done < most:
            if done > 0.0:
                for b in range(lanes):
                    xs[b] = out[b]
                    if done >= steps[b]:
                        hs[b] = 0.0
            _taylor_lanes(xs, hs, signs, cs, ns, out)
            done += 1.0
        for b in range(lanes):
            way, z = u[t, b] - state[3, b], state[2, b]
            state[3, b] = u[t, b]
            if together[b]:
                z = out[b] * (p[2, b] if z > 0.0 else -p[3, b])
            elif way > 0.0:
                z = _step(z, way, True, (p[2, b], p[3, b]), (p[4, b], p[5, b]), p[6, b], p[7, b])
            elif way < 0.0:
                z = _step(z, -way, False, (p[3, b], p[2, b]), (p[5, b], p[4, b]), p[6, b], p[7, b])
            state[2, b] = z
            y[t, b] = p[0, b] * u[t, b] + p[1, b] * z + p[last_row, b]


@dataclass(frozen=True)
class BoucWen(InnerVariable):
    """Bouc-Wen model: z' = u' - β |u'| |z|^(n-1) z - γ u' |z|^n, y = k u + d z.

    Parameters
    ----------
    k
        Slope (µm/V) of both branches far from a reversal, not negative.
    d
        Gain (µm/V) of z: above zero the loops turn clockwise, as those of a friction force, below
        it counter-clockwise. At least -k / (2 sigma): below it the displacement would fall as the
        command turns upwards.
    limit_V
        zc (V): z far from a reversal, (β + γ)^(-1/n).
    sigma
        β / (β + γ), from one half, below which the model makes energy. For one half the way back
        to z = 0 is straight, for one (γ = 0) it bends from the start.
    exponent
        n, from one: how sharply z turns into its limit.
    rate_bandwidth_hz
        Not used: the model does not depend on the rate.

    Raises
    ------
    InputError
        A gain is not finite, `k` is negative, k + d or the least slope is not above zero, or
        another number is beyond its bounds.

    Examples
    --------
    >>> piezo = BoucWen.from_law(k=1.2, d=-0.4, beta=0.1, gamma=0.05, n=1.0)
    >>> round(piezo.limit_V, 3), round(piezo.sigma, 3), round(piezo.a0, 3)
    (6.667, 0.667, 0.8)

    Notes
    -----
    Normalised as by Ikhouane and Rodellar: z over its limit w follows w' = (u' - σ |u'|
    |w|^(n-1) w + (σ - 1) u' |w|^n) / zc.
    """

    k: float
    d: float
    limit_V: float
    sigma: float = 0.5
    exponent: float = 1.0
    rate_bandwidth_hz: float | None = None

    name = "bouc_wen"
    block = staticmethod(bouc_wen_block)
    title = "Bouc-Wen model"
    equation = "z' = u' - β |u'| |z|^(n-1) z - γ u' |z|^n, y = k u + d z"
    source = (
        "Bouc 1967; Wen, Method for random vibration of hysteretic systems, J. Eng. Mech. Div. ASCE "
        "102 (1976) 249; survey: Ismail, Ikhouane, Rodellar, Arch. Comput. Methods Eng. 16 (2009) "
        "161."
    )
    signature = (
        "Two parallel branches with smooth corners after each reversal; no memory of past extrema, "
        "so that small loops do not close and drift along a staircase."
    )
    experiment = "Loops within a loop, run many times: their drift; a staircase up and down."
    hardware = (
        "Steel frames, base isolators, magnetorheological dampers; piezoelectric stacks, roughly."
    )
    shape: ClassVar[tuple[Parameter, ...]] = (
        Parameter("limit_V", "V", 1e-9, 1e9, (1.0, 30.0), "z far from a reversal, zc"),
        Parameter("sigma", "1", 0.5, 3.0, (0.5, 1.0), "β / (β + γ)"),
        Parameter("exponent", "1", 1.0, 16.0, (1.0, 3.0), "sharpness of the corner, n"),
    )
    clockwise = None
    cases: ClassVar[Mapping[str, Mapping[str, float]]] = {
        "symmetric": {},
        "one length": {"exponent": 1.0, "sigma": 1.0},
        "one length, no line": {"exponent": 1.0, "sigma": 1.0, "k": 0.0},
    }

    def __post_init__(self) -> None:
        check_gain("k", self.k)
        check_gain("d", self.d, signed=True)
        check_shape(self)
        check_rate_bandwidth(self.rate_bandwidth_hz)
        if self.k + self.d <= 0.0:
            raise InputError(f"k + d is {self.k + self.d}; give a gain of small commands above 0")
        if self.k + self._steepest * self.d < 0.0:
            raise InputError(
                f"d is {self.d} with k {self.k}; give a d of at least {-self.k / self._steepest:.6g}, or the displacement falls as the command turns upwards"
            )

    @classmethod
    def from_law(
        cls, k: float, d: float, beta: float, gamma: float, n: float, A: float = 1.0
    ) -> Self:
        """Build the model from the numbers of z' = A u' - β |u'| |z|^(n-1) z - γ u' |z|^n.

        Parameters
        ----------
        k, d
            Gains (µm/V; `d` in µm over the unit of z).
        beta, gamma
            β and γ, per length of z to the power of n; their sum above zero.
        n
            The exponent.
        A
            Scale of z, above zero; the model is that of z / A.

        Raises
        ------
        InputError
            As the class; β + γ or A is not above zero.

        Examples
        --------
        >>> BoucWen.from_law(0.0, 1.0, 0.5, 0.5, 2.0).limit_V
        1.0
        """
        total = beta + gamma
        if not (is_finite(total) and total > 0):
            raise InputError(
                f"beta + gamma is {shown(total)}; give a sum above 0, or z has no limit"
            )
        if not (is_finite(A) and A > 0):
            raise InputError(f"A is {shown(A)}; give a number above 0")
        if not (is_finite(n) and n >= 1):
            raise InputError(f"n is {shown(n)}; give an exponent from 1")
        limit = (A / total) ** (1.0 / n) / A
        return cls(k, d * A, limit, beta / total, n)

    @property
    def reach_V(self) -> tuple[float, float]:
        """Lowest and highest z (V)."""
        up, down = self._limits
        return -down, up

    @property
    def a0(self) -> float:
        """Gain k + d (µm/V) from rest."""
        return self.k + self.d

    @property
    def A(self) -> float:
        """Largest gain (µm/V): a walk to and fro can carry z up to twice as far as the command."""
        return self.k + 2.0 * max(self._slopes) * max(self.d, 0.0)

    @property
    def gains(self) -> tuple[float, ...]:
        """Slope k and gain d of z (µm/V)."""
        return self.k, self.d

    @property
    def signed(self) -> tuple[bool, ...]:
        """The gain of z: its sign is the way the loops turn."""
        return False, True

    def with_gains(self, gains: Sequence[float]) -> Self:
        """Return the model with other k and d (µm/V), d where the displacement rises throughout."""
        k, d = max(float(gains[0]), _LEAST * max(abs(float(gains[1])), _LEAST)), float(gains[1])
        return replace(self, k=k, d=max(d, -(1.0 - _LEAST) * k / self._steepest))

    def with_shape(self, values: Mapping[str, float]) -> Self:
        """Return the model with another shape within its bounds, d where the displacement rises."""
        line = replace(self, k=max(self.k, _LEAST**2), d=0.0)  # which any shape allows
        return InnerVariable.with_shape(line, values).with_gains(self.gains)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Lengths from short to longer than the command's span, away from the bounds of the others."""
        gain = scale.stroke_um / scale.span_V
        return tuple(
            cls(1.2 * gain, -0.4 * gain, share * scale.span_V, 0.7, exponent)
            for share, exponent in zip(LENGTHS, (1.1, 1.4, 1.4), strict=True)
        )

    def coefficients(self) -> list[float]:
        """Gains (µm/V), limits (V) and slopes over them (1/V) above and below zero, n, κ."""
        up, down = self._limits
        over, under = self._slopes
        kappa = 2.0 * self.sigma - 1.0
        return [self.k, self.d, up, down, over / up, under / down, self.exponent, kappa]

    @property
    def _slopes(self) -> tuple[float, float]:
        # of z over the command, at zero, above and below it
        return 1.0, 1.0

    @property
    def _limits(self) -> tuple[float, float]:
        # where the slope of z over the command ends: slope = (β + γ) |z|^n
        over, under = self._slopes
        power = 1.0 / self.exponent
        return self.limit_V * over**power, self.limit_V * under**power

    @property
    def _steepest(self) -> float:
        # largest slope of z over the command: right after a turn at its limit
        return 2.0 * self.sigma * max(self._slopes)
