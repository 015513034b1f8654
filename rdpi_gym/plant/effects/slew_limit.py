"""Slew limit: an amplifier whose current charges the stack at a limited rate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, Look, Picture, parameter, rows
from rdpi_gym.support.arrays import Array

_PHASES = 4
"""Limit, lag, other limit within one ramp, and a rounding at a border."""


@njit(inline="always")
def _follow(last: float, now: float, out: float, up: float, down: float) -> float:
    """Output (V) after a sample, from the last input, this one, the last output, largest steps."""
    change, ahead, towards, against = now - last, out - last, up, down
    if change < 0.0:
        ahead, towards, against = -ahead, down, up
    # Faster than the limit and met on the way: the output turns round where they meet.
    if abs(change) > towards and ahead > 0.0:
        back = min(ahead / (abs(change) + against), 1.0)
        step: float = towards * (1.0 - back) - against * back
        return out + step if change > 0.0 else out - step
    return min(max(now, out - down), out + up)


@njit(cache=True)
def slew_limit_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel, exact for an input linear between samples.

    Row of ``p``: largest step of one sample (V). Rows of the state: last input, last output (V).
    """
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            if np.isnan(state[0, b]):
                state[0, b] = state[1, b] = x[t, b]
            out = _follow(state[0, b], x[t, b], state[1, b], p[0, b], p[0, b])
            state[0, b] = x[t, b]
            state[1, b] = y[t, b] = out


@dataclass(frozen=True)
class SlewLimit(Effect):
    """Amplifier whose voltage follows the command at rate_V_s at most.

    Examples
    --------
    >>> SlewLimit(rate_V_s=1000.0).run([0.0, 4.0, 4.0, 4.0, 4.0, 3.5], 1e-3).tolist()
    [0.0, 1.0, 2.0, 3.0, 4.0, 3.5]
    """

    rate_V_s: float = parameter(
        1e4, "V/s", 1e-9, 1e12, (3e3, 2.5e4), "largest rate of the voltage, R"
    )

    name = "slew_limit"
    slot = "input"
    order = 20
    equation = "u' follows u with |du'/dt| <= R"
    source = (
        "Thorlabs, piezo driver bandwidth tutorial (thorlabs.com, ObjectGroup_ID=1191): "
        "R = I_max / C, 0.5 A into 20 µF take 3 ms for 75 V, which is 25 V/ms."
    )
    signature = (
        "Nothing below a critical product of amplitude and frequency, above it triangles: odd "
        "harmonics and a lag that grow with the rate."
    )
    experiment = "Sines across the critical amplitude x frequency, and steps sampled fast."
    cause = (
        "The amplifier charges a capacitance and its current is limited, so the voltage can "
        "change by I_max / C a second and no faster."
    )
    hardware = (
        "Large stacks (µF) on compact drivers, and every step or fast triangle. Small-signal data "
        "sheets hide it: it depends on amplitude times frequency."
    )
    magnitude = (
        "0.5 A into 20 µF (a 100 µm stack) is 25 V/ms, so 75 V take 3 ms (Thorlabs, piezo driver "
        "bandwidth tutorial). An amplifier that reaches 5.6 kHz at 100 V into 1 µF reaches 560 Hz "
        "into 10 µF (PiezoDrive, PD200 manual, power bandwidth)."
    )
    remedy = (
        "Hardware: more current, or a stack with less capacitance. Compensation: none beyond the "
        "limit; shape the reference so that 2π f A stays below R (rounded corners, longer ramps). "
        "A feedback loop winds up against it and needs anti-windup."
    )
    mistaken_for = ("rate_law", "saturation", "actuator_lag")
    kinked = "rate_V_s"
    picture = Picture(
        {"rate_V_s": 5e3},
        Look("over_time", "A large sine of 50 Hz", "sine-50hz", 0.0, 0.04),
        Look("left_over_time", "What a refit leaves of it", "sine-50hz", 0.0, 0.04),
    )
    block = staticmethod(slew_limit_block)
    state_rows = rows(2)  # last input and last output

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """From a fiftieth of the fastest rate of the command to that rate, closely."""
        return tuple(cls.within_bounds(rate_V_s=scale.fastest_V_s / 1.18**k) for k in range(24))

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Largest step of one sample (V)."""
        return [self.rate_V_s * ts_s]


@njit(cache=True)
def unlike_slew_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel, exact for an input linear between samples.

    Rows of ``p``: largest steps of one sample up and down (V). Rows of the state: last input, last
    output (V).
    """
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            if np.isnan(state[0, b]):
                state[0, b] = state[1, b] = x[t, b]
            out = _follow(state[0, b], x[t, b], state[1, b], p[0, b], p[1, b])
            state[0, b] = x[t, b]
            state[1, b] = y[t, b] = out


@dataclass(frozen=True)
class _UnlikeLimits(Effect):
    """Largest rates either way."""

    up_V_s: float = parameter(1e4, "V/s", 1e-9, 1e12, (3e3, 2.5e4), "largest rate upwards, R_u")
    down_V_s: float = parameter(1e4, "V/s", 1e-9, 1e12, (3e3, 2.5e4), "largest rate downwards, R_d")

    state_rows = rows(2)  # last input and last output

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Largest steps of one sample up and down (V)."""
        return [self.up_V_s * ts_s, self.down_V_s * ts_s]


@dataclass(frozen=True)
class UnlikeUpAndDown(_UnlikeLimits, of=SlewLimit):
    """Amplifier whose voltage rises at up_V_s at most and falls at down_V_s at most.

    Examples
    --------
    >>> UnlikeUpAndDown(1000.0, 2000.0).run([0.0, 4.0, 4.0, 4.0, 4.0, 0.0], 1e-3).tolist()
    [0.0, 1.0, 2.0, 3.0, 4.0, 2.0]
    """

    form = "unlike up and down"
    equation = "u' follows u with -R_d <= du'/dt <= R_u"
    source = "An output stage that sources and sinks unlike currents into C: R = I / C each way."
    signature = (
        "Nothing below a critical product of amplitude and frequency, above it saw teeth: even "
        "and odd harmonics."
    )
    block = staticmethod(unlike_slew_block)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Limits below the fastest rate, alike and on either side alone."""
        fastest = scale.fastest_V_s
        return tuple(
            cls.within_bounds(up_V_s=up * fastest, down_V_s=down * fastest)
            for limit in (0.6, 0.25)
            for up, down in ((limit, limit), (limit, 1.0), (1.0, limit))
        )

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The fitted limit, and either way a larger one."""
        if not isinstance(simpler, SlewLimit):
            return cls.starts(scale)
        rate = simpler.rate_V_s
        return tuple(
            cls.within_bounds(up_V_s=up * rate, down_V_s=down * rate)
            for up, down in ((1.0, 1.0), (0.8, 1.25), (1.25, 0.8), (0.5, 2.0), (2.0, 0.5))
        )


@njit(inline="always")
def _charged(ahead: float, slope: float, up: float, down: float, lag: float) -> float:
    """Input less output (V) after a sample, from that before, the input's step, largest steps, lag."""
    high, low, rest, left = up * lag, -down * lag, slope * lag, 1.0
    for _ in range(_PHASES):
        taken = left
        if ahead > high or (ahead == high and slope > up):
            if slope < up:
                taken = min(left, (ahead - high) / (up - slope))
            ahead = high if taken < left else ahead + (slope - up) * taken
        elif ahead < low or (ahead == low and slope < -down):
            if slope > -down:
                taken = min(left, (low - ahead) / (slope + down))
            ahead = low if taken < left else ahead + (slope + down) * taken
        else:
            bound = high if rest > ahead else low
            if rest > high or rest < low:
                taken = min(left, lag * math.log((rest - ahead) / (rest - bound)))
            kept = math.exp(-taken / lag)
            ahead = bound if taken < left else rest + (ahead - rest) * kept
        left -= taken
        if left <= 0.0:
            break
    return ahead


@njit(cache=True)
def charging_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel, exact for an input linear between samples.

    Rows of ``p``: largest steps of one sample up and down (V), time constant (samples). Rows of the
    state: last input, last output (V).
    """
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            if np.isnan(state[0, b]):
                state[0, b] = state[1, b] = x[t, b]
            last, out = state[0, b], state[1, b]
            ahead = _charged(last - out, x[t, b] - last, p[0, b], p[1, b], p[2, b])
            state[0, b] = x[t, b]
            state[1, b] = y[t, b] = x[t, b] - ahead


@dataclass(frozen=True)
class Charging(_UnlikeLimits, of=SlewLimit):
    """Amplifier whose limited current charges the stack through its output resistance.

    Examples
    --------
    >>> amplifier = Charging(up_V_s=1000.0, down_V_s=1000.0, time_constant_s=1e-3)
    >>> amplifier.run([0.0, 0.0, 4.0, 4.0, 4.0, 4.0, 4.0], 1e-3).round(2).tolist()
    [0.0, 0.0, 0.86, 1.86, 2.86, 3.58, 3.84]
    """

    time_constant_s: float = parameter(
        1e-4, "s", 1e-9, 10.0, (1e-5, 1e-3), "time constant of small signals, τ = R C"
    )

    form = "through a resistance"
    equation = "du'/dt = (u - u') / τ, within -R_d and R_u"
    source = (
        "A source of limited current behind a resistance R into C: PiezoDrive, PD200 manual, small "
        "signal bandwidth of a load and its power bandwidth. Time constants are an estimate."
    )
    signature = (
        "A lag of small signals, triangles of large ones; after a step the limit is left "
        "gradually, with that lag."
    )
    block = staticmethod(charging_block)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Limits below the fastest rate, with a lag of a sample."""
        return tuple(
            cls.within_bounds(
                up_V_s=share * scale.fastest_V_s, down_V_s=share * scale.fastest_V_s,
                time_constant_s=scale.shortest_s,
            )
            for share in (0.9, 0.5, 0.25)
        )  # fmt: skip

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The fitted limits, and larger ones as they begin with a lag; one of a sample and a longer one."""
        rates = list(simpler.values.values())
        return tuple(
            cls.within_bounds(
                up_V_s=more * rates[0], down_V_s=more * rates[-1],
                time_constant_s=samples * scale.shortest_s,
            )
            for more in (1.0, 1.3)
            for samples in (1.0, 4.0)
        )  # fmt: skip

    @property
    def slow_lag_s(self) -> float:
        """The time constant: below its limits the current charges the stack linearly."""
        return self.time_constant_s

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Largest steps of one sample up and down (V), time constant (samples)."""
        return [*super().coefficients(ts_s, hysteresis), self.time_constant_s / ts_s]


_STEPS = 4  # Steps of the integration in a sample


@njit(inline="always")
def _settling(
    behind: float, at: float, slope: float, limits: tuple[float, float], lag: float, power: float
) -> tuple[float, float]:
    """Rate of input less output (V a sample), and of its decay (1 a sample), linearised at a place."""
    share = max(abs(at) / (lag * (limits[0] if at > 0.0 else limits[1])), 1e-30)
    size = math.log(share)
    kept = -math.log(1.0 + math.exp(-power * abs(size))) / power - max(size, 0.0)
    # in saturation nothing decays
    decay = max(math.exp((1.0 + power) * kept) / lag, 1e-6)
    return slope - at * math.exp(kept) / lag - decay * (behind - at), decay


@njit(cache=True)
def soft_charging_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel, exponential and linearised at the middle of each step, for an input linear between samples.

    Rows of ``p``: largest steps of one sample up and down (V), time constant (samples), sharpness.
    Rows of the state: last input, last output (V).
    """
    h = 1.0 / _STEPS
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            if np.isnan(state[0, b]):
                state[0, b] = state[1, b] = x[t, b]
            limits, lag, power = (p[0, b], p[1, b]), p[2, b], p[3, b]
            behind, slope = state[0, b] - state[1, b], x[t, b] - state[0, b]
            for _ in range(_STEPS):
                rate, decay = _settling(behind, behind, slope, limits, lag, power)
                middle = behind - rate * math.expm1(-0.5 * h * decay) / decay
                rate, decay = _settling(behind, middle, slope, limits, lag, power)
                behind -= rate * math.expm1(-h * decay) / decay
            step = x[t, b] - behind - state[1, b]
            state[0, b] = x[t, b]
            state[1, b] += min(max(step, -limits[1]), limits[0])
            y[t, b] = state[1, b]


@dataclass(frozen=True)
class SoftLimit(Charging, of=SlewLimit):
    """Amplifier whose current is limited gradually, with a knee of any sharpness.

    Examples
    --------
    >>> amplifier = SoftLimit(up_V_s=1000.0, down_V_s=1000.0, time_constant_s=1e-3, sharpness=2.0)
    >>> amplifier.run([0.0, 0.0, 4.0, 4.0, 4.0, 4.0, 4.0], 1e-3).round(2).tolist()
    [0.0, 0.0, 0.76, 1.7, 2.58, 3.29, 3.71]
    """

    sharpness: float = parameter(2.0, "1", 1.0, 20.0, (1.5, 6.0), "sharpness of the knee, p")

    form = "with a soft limit"
    equation = (
        "du'/dt = r / (1 + |r / R|^p)^(1/p), r = (u - u') / τ, R = R_u upwards, R_d downwards"
    )
    source = "Rapp's model of amplifiers, of the current: its numbers are an estimate."
    signature = "A lag that grows with the rate, without bound as it nears the limit."
    block = staticmethod(soft_charging_block)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Largest steps of one sample up and down (V), time constant (samples), sharpness."""
        return [*super().coefficients(ts_s, hysteresis), self.sharpness]
