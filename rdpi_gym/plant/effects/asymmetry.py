"""Asymmetry: a stack that stretches and shrinks by different amounts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.cores.play import play
from rdpi_gym.plant.effects.base import DataScale, Effect, Look, Picture, Stateless, parameter, rows
from rdpi_gym.support.arrays import Array


@njit(cache=True)
def asymmetry_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; row of ``p``: c / Y (1/µm). No state."""
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = x[t, b] + p[0, b] * x[t, b] * x[t, b]


@dataclass(frozen=True)
class Asymmetry(Stateless):
    """Quadratic distortion of the hysteretic displacement.

    Where its zero lies does not matter: a shift of it is a change of all weights and of the offset.

    Examples
    --------
    >>> Asymmetry(coefficient=0.05, span_um=20.0).run([-20.0, 0.0, 20.0], 1e-3).tolist()
    [-19.0, 0.0, 21.0]
    """

    coefficient: float = parameter(
        0.03, "1", -0.4, 0.4, (0.01, 0.05),
        "distortion c at the displacement Y, as a share of it", neutral=0.0,
    )  # fmt: skip
    span_um: float = parameter(40.0, "µm", 1e-9, 1e9, (40.0, 40.0), "displacement Y", fixed=True)

    name = "asymmetry"
    slot = "hysteresis"
    order = 20
    equation = "y = y_h + c y_h² / Y"
    source = (
        "Even part of a memoryless curve behind the plays, in the place where Kuhnen's modified "
        "Prandtl-Ishlinskii model has one-sided dead zones; Gu, Zhu, Su (IEEE TIE 61(3), 2014) add "
        "a cubic polynomial of the command instead. 1 to 5 % of the stroke is an estimate."
    )
    signature = (
        "Even harmonics of a half-wave symmetric input, alike on both branches and at every rate; "
        "play operators are odd and leave none."
    )
    experiment = "Sines about zero at two amplitudes or more; the half-wave test needs no model."
    cause = (
        "Poled ceramic is not the same in both directions: strain along the poling direction "
        "grows differently from strain against it, and preload and mechanics bend the curve "
        "further."
    )
    hardware = (
        "Unipolar stacks, benders and tubes driven about an offset; levers and flexures that are "
        "bent far."
    )
    magnitude = (
        "A few per cent of the stroke: 1 to 5 % is an estimate. The measured PICMA record of this "
        "project is described with 8.6 %. Modified Prandtl-Ishlinskii models were made for it "
        "(Gu, Zhu, Su, IEEE TIE 61(3), 2014)."
    )
    remedy = (
        "Hardware: a charge drive, or a sensor and feedback. Compensation: a static inverse of "
        "the curve in front of the inverse of the hysteresis; where y_h² is added, it is the root "
        "of a quadratic."
    )
    mistaken_for = ("congruency", "saturation", "thermal_drift")
    picture = Picture(
        {"coefficient": 0.05},
        Look("loops", "A large sine about zero", "sine-10hz"),
        Look("left_over_command", "What a refit leaves of it", "sine-10hz"),
    )
    block = staticmethod(asymmetry_block)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start, at the measured stroke."""
        return (cls.within_bounds(coefficient=0.01, span_um=scale.stroke_um),)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Coefficient of the square, c / Y (1/µm)."""
        return [self.coefficient / self.span_um]


@njit(cache=True)
def polynomial_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: 1 / Y (1/µm), then c_k from the square on. No state."""
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            share, bent = x[t, b] * p[0, b], 0.0
            for k in range(p.shape[0] - 1, 0, -1):
                bent = (bent + p[k, b]) * share
            y[t, b] = x[t, b] * (1.0 + bent)


@njit(cache=True)
def command_polynomial_block(
    x: Array, u: Array, p: Array, state: Array, ts: float, y: Array
) -> None:
    """Kernel; rows of ``p``: Y (µm), 1 / U (1/V), then c_k from the square on. No state."""
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            share, bent = u[t, b] * p[1, b], 0.0
            for k in range(p.shape[0] - 1, 1, -1):
                bent = (bent + p[k, b]) * share
            y[t, b] = x[t, b] + p[0, b] * share * bent


def _power(default: float, k: int, at: str = "Y") -> Any:
    text = f"share c_{k} of the power {k} at {at}"
    return parameter(default, "1", -1.0, 1.0, (-0.05, 0.05), text, neutral=0.0)


class _Polynomial(Stateless):
    """Polynomial of the hysteretic displacement: its coefficients, then Y."""

    signature = "Even and odd harmonics alike on both branches and at every rate."
    block = staticmethod(polynomial_block)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start, at the measured stroke."""
        return (cls.within_bounds(coefficient_2=0.01, coefficient_3=0.0, span_um=scale.stroke_um),)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """1 / Y (1/µm), then the coefficients of the powers."""
        *powers, span_um = self.values.values()
        return [1.0 / span_um, *powers]


@dataclass(frozen=True)
class Cubic(_Polynomial, of=Asymmetry):
    """Quadratic and cubic distortion of the hysteretic displacement.

    Examples
    --------
    >>> effect = Cubic(coefficient_2=0.05, coefficient_3=-0.1, span_um=20.0)
    >>> effect.run([-20.0, 0.0, 20.0], 1e-3).round(6).tolist()
    [-17.0, 0.0, 19.0]
    """

    coefficient_2: float = _power(0.03, 2)
    coefficient_3: float = _power(0.0, 3)
    span_um: float = 40.0

    form = "cubic"
    equation = "y = y_h + Y (c_2 (y_h / Y)² + c_3 (y_h / Y)³)"


@dataclass(frozen=True)
class OfTheCommand(Stateless, of=Asymmetry):
    """Square and cube of the command added to the hysteretic displacement.

    Examples
    --------
    >>> effect = OfTheCommand(0.05, 0.1, span_V=10.0, span_um=20.0)
    >>> effect.run([3.0, 3.0], 1e-3, u=[-10.0, 10.0]).round(6).tolist()
    [2.0, 6.0]
    """

    coefficient_2: float = _power(0.03, 2, "U")
    coefficient_3: float = _power(0.0, 3, "U")
    span_V: float = parameter(40.0, "V", 1e-9, 1e9, (40.0, 40.0), "command U", fixed=True)
    span_um: float = 40.0

    form = "of the command"
    equation = "y = y_h + Y (c_2 (u / U)² + c_3 (u / U)³)"
    source = "Gu, Zhu, Su, IEEE Transactions on Industrial Electronics 61(3), 2014."
    signature = "Even and odd harmonics in phase with the command, whatever the loop's width."
    block = staticmethod(command_polynomial_block)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start, at the measured span and stroke."""
        return (
            cls.within_bounds(
                coefficient_2=0.01, coefficient_3=0.0, span_V=scale.span_V, span_um=scale.stroke_um
            ),
        )

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Y (µm), 1 / U (1/V), then the coefficients of the powers."""
        return [self.span_um, 1.0 / self.span_V, self.coefficient_2, self.coefficient_3]


@njit(cache=True)
def unlike_branches_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: c / Y, d / Y (1/µm), r (V). Rows of the state: last command, stop (V)."""
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b], state[1, b] = u[0, b], 0.0
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            reach = p[2, b]
            stop = state[1, b] + u[t, b] - state[0, b]
            stop = play(stop, -reach, reach)
            state[0, b], state[1, b] = u[t, b], stop
            y[t, b] = x[t, b] + (p[0, b] + p[1, b] * stop / reach) * x[t, b] * x[t, b]


@dataclass(frozen=True)
class UnlikeBranches(Effect, of=Asymmetry):
    """Quadratic distortion that is another on the rising than on the falling branch.

    The branch is told by a stop operator of the command, which goes from one to the other within
    twice its reach after a turn.

    Examples
    --------
    >>> effect = UnlikeBranches(0.05, 0.02, reach_V=5.0, span_um=20.0)
    >>> effect.run([0.0, 20.0, 20.0], 1e-3, u=[0.0, 40.0, 20.0]).round(6).tolist()
    [0.0, 21.4, 20.6]
    """

    coefficient: float = 0.03
    difference: float = parameter(
        0.01, "1", -0.4, 0.4, (-0.02, 0.02),
        "what is more on the rising and less on the falling branch, d", neutral=0.0,
    )  # fmt: skip
    reach_V: float = parameter(
        10.0, "V", 1e-9, 1e9, (5.0, 20.0), "reach r of the stop that tells them"
    )
    span_um: float = 40.0

    form = "unlike branches"
    equation = "y = y_h + (c + d s / r) y_h² / Y, s = stop of u with |s| <= r"
    source = (
        "A stage in the manner of generalised plays, whose branches have envelopes of their own "
        "(Al Janaideh, Rakheja, Su, 2011)."
    )
    signature = "Even harmonics, and branches that are not each other's mirror image."
    block = staticmethod(unlike_branches_block)
    state_rows = rows(2)  # last command and the stop

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start: branches that are alike, told by a stop of a fifth of the span."""
        return (
            cls.within_bounds(
                coefficient=0.01,
                difference=0.0,
                reach_V=0.2 * scale.span_V,
                span_um=scale.stroke_um,
            ),
        )

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Coefficients c / Y and d / Y (1/µm), r (V)."""
        return [self.coefficient / self.span_um, self.difference / self.span_um, self.reach_V]


@dataclass(frozen=True)
class ToTheFifthDegree(_Polynomial, of=Asymmetry):
    """Polynomial of the hysteretic displacement with the powers 2 to 5.

    Examples
    --------
    >>> effect = ToTheFifthDegree(0.05, 0.0, 0.0, -0.1, span_um=20.0)
    >>> effect.run([-20.0, 0.0, 20.0], 1e-3).round(6).tolist()
    [-17.0, 0.0, 19.0]
    """

    coefficient_2: float = _power(0.03, 2)
    coefficient_3: float = _power(0.0, 3)
    coefficient_4: float = _power(0.0, 4)
    coefficient_5: float = _power(0.0, 5)
    span_um: float = 40.0

    form = "to the fifth degree"
    equation = "y = y_h + Y (c_2 (y_h / Y)² + ... + c_5 (y_h / Y)⁵)"


_HEAD = 8  # rows of parameters before the weights


@njit(cache=True, fastmath={"reassoc", "contract"})
def _generalised_plays(u: Array, p: Array, state: Array, ts: float, more: Array) -> None:
    """Fill what plays between the envelopes are more than ordinary ones, ``(T, n)``."""
    n = more.shape[1]
    rest = p[_HEAD + n : _HEAD + 2 * n].copy()
    ordinary, between = state[2 : 2 + n].copy(), state[2 + n : 2 + 2 * n].copy()
    last, rate = state[0], state[1]
    if np.isnan(last):
        last, rate = u[0], 0.0
        ordinary[:], between[:] = 0.0, 0.0
    for t in range(u.shape[0]):
        rate = p[7] * rate + (1.0 - p[7]) * ((u[t] - last) / ts)  # Eq. 5
        last = u[t]
        shift = p[6] * abs(rate)
        s = (last - p[0]) / p[1]
        low = last + p[1] * s * s * (p[2] + p[3] * s)
        high = last + p[1] * s * s * (p[4] + p[5] * s)
        for i in range(n):
            r = rest[i] + shift
            x = play(ordinary[i], last - r, last + r)
            z = play(between[i], low - r, high + r)
            ordinary[i], between[i] = x, z
            more[t, i] = z - x
    state[0], state[1] = last, rate
    for i in range(n):
        state[2 + i], state[2 + n + i] = ordinary[i], between[i]


@njit(cache=True, fastmath={"reassoc", "contract"})
def _add_weighted(x: Array, more: Array, weights: Array, y: Array) -> None:
    for t in range(x.shape[0]):
        total = 0.0
        for i in range(weights.shape[0]):
            total += weights[i] * more[t, i]
        y[t] = x[t] + total


@njit(cache=True)
def unlike_envelopes_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: u_c, U (V), c_2 and c_3 of either branch, δ2, pole, weights, thresholds.

    Rows of the state: last command, rate, ordinary plays, plays between the envelopes. Lanes that
    differ in the weights alone, as a fit makes them, share their plays.
    """
    n = (p.shape[0] - _HEAD) // 2
    more = np.empty((x.shape[0], n))
    begin, end = np.empty(2 + 2 * n), np.empty(2 + 2 * n)
    owner = -1
    for b in range(x.shape[1]):
        shared = owner >= 0
        if shared:
            for k in range(p.shape[0]):
                if p[k, b] != p[k, owner] and not _HEAD <= k < _HEAD + n:
                    shared = False
                    break
        if shared:
            for k in range(begin.size):
                here = state[k, b]
                if here != begin[k] and not (np.isnan(here) and np.isnan(begin[k])):
                    shared = False
                    break
        if shared:
            for t in range(u.shape[0]):
                if u[t, b] != u[t, owner]:
                    shared = False
                    break
        if not shared:
            owner = b
            for k in range(begin.size):
                begin[k] = state[k, b]
                end[k] = begin[k]
            _generalised_plays(u[:, b].copy(), p[:, b].copy(), end, ts, more)
        for k in range(end.size):
            state[k, b] = end[k]
        _add_weighted(x[:, b], more, p[_HEAD : _HEAD + n, b].copy(), y[:, b])


def _bend(default: float, k: int, branch: str) -> Any:
    text = f"share of the power {k} in the envelope of the {branch} branch at U"
    return parameter(default, "1", -2.0, 2.0, (-0.05, 0.05), text, neutral=0.0)


@dataclass(frozen=True)
class UnlikeEnvelopes(Effect, of=Asymmetry):
    """Plays between two envelopes of the command, one of the rising and one of the falling branch.

    Its plays are run beside the plant's own, with thresholds that grow with the rate as Eq. 8 says,
    and begin at rest.

    Examples
    --------
    >>> from rdpi_gym.plant import RDPI
    >>> core = RDPI((1.0, 0.5), (2.0,), 0.0)
    >>> effect = UnlikeEnvelopes(rising_2=0.1, falling_2=0.2, centre_V=0.0, span_V=10.0)
    >>> effect.run([0.0, 14.0, 6.0], 1e-3, u=[0.0, 10.0, 5.0], hysteresis=core).tolist()
    [0.0, 14.5, 6.25]
    """

    rising_2: float = _bend(0.03, 2, "rising")
    rising_3: float = _bend(0.0, 3, "rising")
    falling_2: float = _bend(0.02, 2, "falling")
    falling_3: float = _bend(0.0, 3, "falling")
    centre_V: float = parameter(
        0.0, "V", -1e9, 1e9, (0.0, 40.0), "command u_c that is not bent", fixed=True
    )
    span_V: float = parameter(
        40.0, "V", 1e-9, 1e9, (40.0, 40.0), "command U, from u_c on", fixed=True
    )

    form = "unlike envelopes"
    order = 5
    weighs_plays = True
    equation = (
        "y = a_0 u + Σ a_i ξ_i, ξ_i = max(γ_r(u) - r_i, min(γ_f(u) + r_i, ξ_i(k-1))), "
        "γ(u) = u + U (c_2 s² + c_3 s³), s = (u - u_c) / U"
    )
    source = "Generalised plays (Al Janaideh, Rakheja, Su, 2011), with cubic envelopes."
    signature = (
        "Even harmonics, and branches that are not each other's mirror image: loops that are wider "
        "at one end."
    )
    block = staticmethod(unlike_envelopes_block)
    state_rows = rows(2)  # last command and rate; the plays come with the core

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start: envelopes that are alike and slightly bent."""
        return (
            cls.within_bounds(
                rising_2=0.01, rising_3=0.0, falling_2=0.01, falling_3=0.0,
                centre_V=scale.centre_V, span_V=scale.span_V,
            ),
        )  # fmt: skip

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """u_c and U (V), the bends, δ2 (s), the pole of the rate, weights and thresholds."""
        _, *plays, delta2_s = hysteresis.coefficients()
        bends = self.rising_2, self.rising_3, self.falling_2, self.falling_3
        pole = hysteresis.rate_pole(ts_s)
        return [self.centre_V, self.span_V, *bends, delta2_s, pole, *plays]

    def state_rows_with(self, ts_s: float, hysteresis: Core) -> int:
        """Last command and rate, and both sets of plays."""
        return 2 + 2 * hysteresis.n
