"""Creep: displacement that grows by a constant amount per decade of time after a step."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, Look, Picture, parameter
from rdpi_gym.plant.effects.linear import lag_step
from rdpi_gym.support.arrays import Array

PER_DECADE = 2
TIME_CONSTANTS_S = tuple(
    10.0 ** (k / PER_DECADE) for k in range(-2 * PER_DECADE, 3 * PER_DECADE + 1)
)
"""Elements of the ladder (s). One a decade leaves a ripple of 2 % of the creep of a decade on the
step and of 4 % on the frequency response, two leave 0.02 and 0.05 %."""

# Below this many lanes the vector units are better filled with the elements of one lane.
_VECTOR_LANES = 32


@njit(cache=True, fastmath={"reassoc", "contract"}, inline="never")
def _one_lane(x: Array, steps: Array, gain: float, last: float, z: Array, y: Array) -> None:
    decay, before, after = steps[:, 0].copy(), steps[:, 1].copy(), steps[:, 2].copy()
    for t in range(len(x)):
        total = 0.0
        for k in range(len(z)):
            value = decay[k] * z[k] + before[k] * last + after[k] * x[t]
            z[k] = value
            total += value
        last = x[t]
        y[t] = last + gain * total


@njit(cache=True)
def _many_lanes(x: Array, p: Array, state: Array, y: Array) -> None:
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = 0.0
        for k in range((p.shape[0] - 1) // 3):
            # They follow from the sampling time alone: read once, not lane by lane.
            decay, before, after = p[1 + 3 * k, 0], p[2 + 3 * k, 0], p[3 + 3 * k, 0]
            for b in range(x.shape[1]):
                z = decay * state[1 + k, b]
                z += before * state[0, b] + after * x[t, b]
                state[1 + k, b] = z
                y[t, b] += z
        for b in range(x.shape[1]):
            state[0, b] = x[t, b]
            y[t, b] = x[t, b] + p[0, b] * y[t, b]


@njit(cache=True)
def creep_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel, exact for an input linear between samples.

    Rows of ``p``: gain of an element; F, G0, G1 of each, the same in all lanes. Rows of the state:
    last input, elements.
    """
    elements = (p.shape[0] - 1) // 3
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[: elements + 1, b] = x[0, b]
    if x.shape[1] >= _VECTOR_LANES:
        _many_lanes(x, p, state, y)
        return
    for b in range(x.shape[1]):
        z = state[1 : elements + 1, b].copy()
        steps = p[1:, b].copy().reshape(elements, 3)
        _one_lane(x[:, b], steps, p[0, b], state[0, b], z, y[:, b])
        for k in range(elements):
            state[1 + k, b] = z[k]
        state[0, b] = x[-1, b]


@njit(cache=True)
def weighted_creep_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel of elements with unlike gains, exact for an input linear between samples.

    Rows of ``p``: gain at rest; F and what an element falls behind by, a step of the input, of each.
    Rows of the state: last input, what each element still lacks.
    """
    elements = (p.shape[0] - 1) // 2
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = x[0, b]
            state[1 : elements + 1, b] = 0.0
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = p[0, b] * x[t, b]
        for k in range(elements):
            for b in range(x.shape[1]):
                lack = p[1 + 2 * k, b] * state[1 + k, b]
                lack += p[2 + 2 * k, b] * (x[t, b] - state[0, b])
                state[1 + k, b] = lack
                y[t, b] -= lack
        for b in range(x.shape[1]):
            state[0, b] = x[t, b]


def pack_elements(
    gains: Sequence[float], time_constants_s: Sequence[float], ts_s: float
) -> list[float]:
    """Pack Kelvin-Voigt elements, y = x + Σ g_k z_k and τ_k dz_k/dt + z_k = x."""
    steps = [1.0 + math.fsum(gains)]
    for gain, tau in zip(gains, time_constants_s, strict=True):
        h = ts_s / tau
        steps += [math.exp(-h), gain * -math.expm1(-h) / h]
    return steps


@dataclass(frozen=True)
class Creep(Effect):
    """Spectrum of Kelvin-Voigt elements from 0.01 to 1000 s, in equilibrium at the first sample.

    Examples
    --------
    >>> stretch = Creep(gain_per_decade=0.02).run([0.0] + [50.0] * 1000, 0.1)
    >>> float((stretch[1000] - stretch[100]).round(2))  # from 10 to 100 s: 2 % of 50 µm
    0.98
    """

    gain_per_decade: float = parameter(
        0.015, "1", 0.0, 0.1, (0.01, 0.02),
        "displacement gained in a decade of time, γ", neutral=0.0,
    )  # fmt: skip

    name = "creep"
    slot = "hysteresis"
    order = 30
    equation = (
        "y = y_h + (γ / m) Σ_k z_k, τ_k dz_k/dt + z_k = y_h, m = 2 a decade, τ_k = 0.01 ... 1000 s"
    )
    source = (
        "Physik Instrumente, piezo tutorial, creep (physikinstrumente.com/tutorial/4_21.html): "
        "ΔL (1 + γ lg(t / 0.1 s)), γ of the order of 0.01 to 0.02. It starts well below 1 s "
        "(doi 10.1155/2013/187262)."
    )
    signature = (
        "In a hold y drifts in the direction of the last step, with a constant slope over log t; "
        "the gain falls by γ a decade of frequency."
    )
    experiment = "Stairs of steps up and down with holds over three decades of time."
    cause = (
        "After a step most domains switch at once and the rest go on switching ever more slowly: "
        "the remanent polarisation keeps changing under constant voltage."
    )
    hardware = (
        "Every voltage-driven piezo actuator without position feedback: tubes of scanning probe "
        "microscopes, stacks, benders. Charge drives and closed loops hardly show it."
    )
    magnitude = (
        "1 to 2 % of the last step a decade of time, counted from 0.1 s (Physik Instrumente, "
        "piezo tutorial, creep); a few per cent after some hours."
    )
    remedy = (
        "Hardware: a position sensor and an integral in the loop, or a charge drive. "
        "Compensation: subtract what the model predicts, element by element; the inverse is "
        "stable and needs no preview. Waiting helps slowly: each further decade costs as much."
    )
    mistaken_for = ("thermal_drift", "gain_drift", "initial_memory")
    picture = Picture(
        {"gain_per_decade": 0.02},
        Look("onward", "A hold of 30 s", "stairs", 23.85, 53.8),
        Look("left_over_time", "What a refit leaves of the stairs", "stairs"),
    )
    block = staticmethod(creep_block)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Gain of an element, then F, G0, G1 of each."""
        steps = [value for tau in TIME_CONSTANTS_S for value in lag_step(tau, ts_s)]
        return [self.gain_per_decade / PER_DECADE, *steps]

    def state_rows(self, ts_s: float) -> int:
        """Last input and one row for each element."""
        return 1 + len(TIME_CONSTANTS_S)

    def elements(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the gains, all alike, and the time constants (s)."""
        return [self.gain_per_decade / PER_DECADE] * len(TIME_CONSTANTS_S), TIME_CONSTANTS_S


_GAIN = (0.0, 0.3, (0.005, 0.03))
_TIME = (1e-6, 1e9)


class _Elements(Effect):
    """Kelvin-Voigt elements side by side, in equilibrium at the first sample."""

    block = staticmethod(weighted_creep_block)

    @abstractmethod
    def elements(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the gains and the time constants (s)."""

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Gain at rest; F and the lack by a step of the input of each element."""
        return pack_elements(*self.elements(), ts_s)

    def state_rows(self, ts_s: float) -> int:
        """Last input and one row for each element."""
        return 1 + len(self.elements()[0])


class _TimeConstants(_Elements):
    """A few elements, each with a gain and a time constant (s), in this order."""

    source = "A Kelvin-Voigt element, as in linear viscoelasticity; its size is an estimate."

    def elements(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the gains and the time constants (s)."""
        values = list(self.values.values())
        return values[::2], values[1::2]


@dataclass(frozen=True)
class OneTimeConstant(_TimeConstants, of=Creep):
    """One Kelvin-Voigt element, in equilibrium at the first sample.

    Examples
    --------
    >>> stretch = OneTimeConstant(gain=0.02, time_constant_s=1.0).run([0.0] + [50.0] * 1000, 0.01)
    >>> float((stretch[1000] - 50.0).round(2))  # ten time constants: 2 % of 50 µm
    1.0
    """

    gain: float = parameter(0.02, "1", *_GAIN, "displacement gained at last, g", neutral=0.0)
    time_constant_s: float = parameter(1.0, "s", *_TIME, (0.1, 10.0), "time constant τ")

    form = "one time constant"
    equation = "y = y_h + g z, τ dz/dt + z = y_h"
    signature = (
        "In a hold y drifts in the direction of the last step and comes to rest, as exp(-t/τ)."
    )

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Time constants of a small and of a large part of the longest record."""
        return tuple(
            cls.within_bounds(gain=0.01, time_constant_s=share * scale.longest_s)
            for share in (0.01, 0.2)
        )


@dataclass(frozen=True)
class BetweenTwoTimes(_Elements, of=Creep):
    """Constant slope over log t that begins at one time and ends at another.

    Examples
    --------
    >>> creep = BetweenTwoTimes(gain_per_decade=0.02, shortest_s=0.1, longest_s=10.0)
    >>> stretch = creep.run([0.0] + [50.0] * 10000, 0.1)
    >>> float((stretch[-1] - stretch[0]).round(1))  # 2 % of 50 µm in each of the two decades
    52.0
    """

    gain_per_decade: float = parameter(
        0.015, "1", 0.0, 1.0, (0.01, 0.02),
        "displacement gained in a decade of time, γ", neutral=0.0,
    )  # fmt: skip
    shortest_s: float = parameter(
        0.01, "s", *_TIME, (0.003, 0.1), "time τ_a at which the slope begins"
    )
    longest_s: float = parameter(100.0, "s", *_TIME, (10.0, 1e3), "time τ_b at which it ends")

    form = "between two times"
    equation = (
        "y = y_h + (γ lg(τ_b / τ_a) / 11) Σ_k z_k, τ_k dz_k/dt + z_k = y_h, τ_k in the middle of 11 "
        "equal parts of log τ from τ_a to τ_b"
    )
    signature = (
        "In a hold y drifts with a constant slope over log t between two times, and rests later."
    )

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start: three decades up to the longest record."""
        return (
            cls.within_bounds(
                gain_per_decade=0.015, shortest_s=1e-3 * scale.longest_s, longest_s=scale.longest_s
            ),
        )

    def elements(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the gains and the time constants (s)."""
        first, last = math.log10(self.shortest_s), math.log10(self.longest_s)
        count = len(TIME_CONSTANTS_S)
        taus = [10.0 ** (first + (last - first) * (k + 0.5) / count) for k in range(count)]
        # Two times that change places are the same two times.
        gain = self.gain_per_decade * abs(last - first) / count
        return [gain] * count, taus


@dataclass(frozen=True)
class TwoTimeConstants(_TimeConstants, of=Creep):
    """Two Kelvin-Voigt elements, in equilibrium at the first sample.

    Examples
    --------
    >>> creep = TwoTimeConstants(0.01, 0.3, 0.02, 4.0)
    >>> stretch = creep.run([0.0] + [50.0] * 10000, 0.01)
    >>> float((stretch[-1] - 50.0).round(2))  # 1 % and 2 % of 50 µm
    1.5
    """

    gain_1: float = parameter(
        0.02, "1", *_GAIN, "displacement gained by the first element, g_1", 0.0
    )
    time_constant_1_s: float = parameter(0.3, "s", *_TIME, (0.1, 1.0), "its time constant τ_1")
    gain_2: float = parameter(
        0.02, "1", *_GAIN, "displacement gained by the second element, g_2", 0.0
    )
    time_constant_2_s: float = parameter(3.0, "s", *_TIME, (1.0, 10.0), "its time constant τ_2")

    form = "two time constants"
    equation = "y = y_h + g_1 z_1 + g_2 z_2, τ_k dz_k/dt + z_k = y_h"
    signature = (
        "In a hold y drifts in the direction of the last step, by the sum of two exponentials."
    )

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Two time constants within the longest record, near each other and far apart."""
        return tuple(
            cls.within_bounds(
                **_named([0.01, 0.01], [first * scale.longest_s, second * scale.longest_s])
            )
            for first, second in ((0.003, 0.1), (0.05, 0.5))
        )

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The fitted time constant parted in two, and with a slower or a faster one beside it."""
        if not isinstance(simpler, OneTimeConstant):
            return cls.starts(scale)
        gain, tau = simpler.gain, simpler.time_constant_s
        return tuple(
            cls.within_bounds(
                **_named([share * gain, (1.0 - share) * gain], [faster * tau, slower * tau])
            )
            for share, faster, slower in ((0.5, 0.4, 2.5), (0.8, 1.0, 12.0), (0.2, 1 / 12, 1.0))
        )


@dataclass(frozen=True)
class ThreeTimeConstants(_TimeConstants, of=Creep):
    """Three Kelvin-Voigt elements, in equilibrium at the first sample.

    Examples
    --------
    >>> creep = ThreeTimeConstants(0.01, 0.1, 0.02, 1.0, 0.01, 5.0)
    >>> stretch = creep.run([0.0] + [50.0] * 10000, 0.01)
    >>> float((stretch[-1] - 50.0).round(2))  # 1, 2 and 1 % of 50 µm
    2.0
    """

    gain_1: float = parameter(
        0.02, "1", *_GAIN, "displacement gained by the first element, g_1", 0.0
    )
    time_constant_1_s: float = parameter(0.1, "s", *_TIME, (0.03, 0.3), "its time constant τ_1")
    gain_2: float = parameter(
        0.02, "1", *_GAIN, "displacement gained by the second element, g_2", 0.0
    )
    time_constant_2_s: float = parameter(1.0, "s", *_TIME, (0.3, 3.0), "its time constant τ_2")
    gain_3: float = parameter(
        0.02, "1", *_GAIN, "displacement gained by the third element, g_3", 0.0
    )
    time_constant_3_s: float = parameter(10.0, "s", *_TIME, (3.0, 30.0), "its time constant τ_3")

    form = "three time constants"
    equation = "y = y_h + g_1 z_1 + g_2 z_2 + g_3 z_3, τ_k dz_k/dt + z_k = y_h"
    signature = (
        "In a hold y drifts in the direction of the last step, by the sum of three exponentials."
    )

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start: time constants at even distances within the longest record."""
        taus = [share * scale.longest_s for share in (0.003, 0.04, 0.5)]
        return (cls.within_bounds(**_named([0.01] * 3, taus)),)

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The two fitted time constants and one that is faster, between them, or slower."""
        if not isinstance(simpler, TwoTimeConstants):
            return cls.starts(scale)
        (g1, g2), (tau1, tau2) = simpler.elements()
        between = (
            [0.6 * g1, 0.3 * (g1 + g2), 0.6 * g2],
            [tau1 / 2, math.sqrt(tau1 * tau2), 2 * tau2],
        )
        faster = [0.1 * g1, g1, g2], [tau1 / 12, tau1, tau2]
        slower = [g1, g2, 0.1 * g2], [tau1, tau2, 12 * tau2]
        return tuple(cls.within_bounds(**_named(*each)) for each in (between, faster, slower))


def _named(gains: Sequence[float], time_constants_s: Sequence[float]) -> dict[str, float]:
    pairs = enumerate(zip(gains, time_constants_s, strict=True), start=1)
    return {
        key: value
        for k, (gain, tau) in pairs
        for key, value in ((f"gain_{k}", gain), (f"time_constant_{k}_s", tau))
    }


def _gain_at(time: str, k: int) -> Any:
    return parameter(0.01, "1", *_GAIN, f"displacement gained by the element of {time}, g_{k}", 0.0)


@dataclass(frozen=True)
class Spectrum(_Elements, of=Creep):
    """Kelvin-Voigt elements of any gains, one for each decade from 0.01 to 1000 s.

    Examples
    --------
    >>> stretch = Spectrum(0.0, 0.01, 0.02, 0.0, 0.0, 0.0).run([0.0] + [50.0] * 10000, 0.01)
    >>> float((stretch[-1] - 50.0).round(2))  # 1 % and 2 % of 50 µm
    1.5
    """

    gain_at_10ms: float = _gain_at("10ms", 1)
    gain_at_100ms: float = _gain_at("100ms", 2)
    gain_at_1s: float = _gain_at("1s", 3)
    gain_at_10s: float = _gain_at("10s", 4)
    gain_at_100s: float = _gain_at("100s", 5)
    gain_at_1000s: float = _gain_at("1000s", 6)

    form = "spectrum"
    equation = "y = y_h + Σ_k g_k z_k, τ_k dz_k/dt + z_k = y_h, τ_k = 0.01, 0.1, 1 ... 1000 s"
    signature = "In a hold y drifts in the direction of the last step, ever more slowly."

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start, all gains alike: a constant slope over log t."""
        return (cls(),)

    def elements(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the gains and the time constants (s)."""
        return list(self.values.values()), TIME_CONSTANTS_S[::PER_DECADE]
