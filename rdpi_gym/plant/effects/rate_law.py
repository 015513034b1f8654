"""Rate law: thresholds that do not grow linearly with the rate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Look, Picture, Stateless, parameter
from rdpi_gym.support.arrays import Array


@njit(cache=True)
def rate_law_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: p - 1, v0 (V/s). No state."""
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            v = x[t, b]
            share = abs(v) / p[1, b]  # 0 too where a decaying rate underflows
            y[t, b] = v * share ** p[0, b] if share > 0.0 else 0.0


@dataclass(frozen=True)
class RateLaw(Stateless):
    """Power law of the rate in place of the |v| of Eq. 8.

    Examples
    --------
    >>> RateLaw(exponent=0.5, reference_rate_V_s=100.0).run([100.0, -400.0], 1e-3).tolist()
    [100.0, -200.0]
    """

    exponent: float = parameter(0.7, "1", 0.2, 3.0, (0.5, 0.8), "p; 1 is Eq. 8", neutral=1.0)
    reference_rate_V_s: float = parameter(
        1e4, "V/s", 1e-12, 1e12, (1e4, 1e4),
        "rate v0 at which the thresholds are those of Eq. 8", fixed=True,
    )  # fmt: skip

    name = "rate_law"
    slot = "rate"
    order = 10
    equation = "r_i = δ1 i + δ2 v0 (|v| / v0)^p"
    source = (
        "Velocity power m in doi 10.5772/58984, a dynamic density in doi 10.1007/s11465-015-0326-1; "
        "the range of p is an estimate."
    )
    signature = (
        "δ2 fitted record by record falls or rises with amplitude x frequency; small signals stay "
        "untouched."
    )
    experiment = (
        "Sines at four rates and two amplitudes, with partners of the same largest rate (A at f, "
        "A/4 at 4f)."
    )
    cause = (
        "Domain walls need time to move, so the width of the loop grows with the rate of the "
        "field; the linear law of Eq. 8 is the simplest of several forms that describe it."
    )
    hardware = (
        "Stacks and tubes that work over more than a decade of frequency; soft ceramics usually show "
        "more of it than hard ones."
    )
    magnitude = (
        "Rate-dependent play models were fitted up to 1 to 1.5 kHz with powers and logarithms of "
        "the rate in place of |v| (doi 10.5772/58984, doi 10.1007/s11465-015-0326-1). Exponents "
        "of 0.5 to 0.8 are an estimate."
    )
    remedy = (
        "Hardware: charge drive, which takes most of the hysteresis away with its rate "
        "dependence. Compensation: put the law into the thresholds of the inverse; its shape "
        "stays the same and only the rate is replaced."
    )
    mistaken_for = ("delay", "sensor_lag", "actuator_lag", "slew_limit")
    picture = Picture(
        {"exponent": 0.5},
        Look("loops", "A large sine of 10 Hz", "sine-10hz"),
        Look("left_over_command", "What a refit leaves", "sine-10hz", "sine-50hz"),
    )
    block = staticmethod(rate_law_block)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Thresholds that grow slower and faster than the rate."""
        return tuple(
            cls.within_bounds(exponent=p, reference_rate_V_s=0.3 * scale.fastest_V_s)
            for p in (0.7, 1.3)
        )

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """The exponent of the factor on v, and v0 (V/s)."""
        return [self.exponent - 1.0, self.reference_rate_V_s]


@njit(cache=True)
def logarithmic_rate_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; row of ``p``: v0 (V/s). No state."""
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            v, v0 = x[t, b], p[0, b]
            y[t, b] = math.copysign(v0 * math.log1p(abs(v) / v0), v)


@dataclass(frozen=True)
class LogarithmicRateLaw(Stateless, of=RateLaw):
    """Logarithm of the rate in place of the |v| of Eq. 8, which it follows far below v0.

    Examples
    --------
    >>> law = LogarithmicRateLaw(bend_rate_V_s=100.0)
    >>> law.run([1.0, -100.0, 1e4], 1e-3).round(2).tolist()
    [1.0, -69.31, 461.51]
    """

    bend_rate_V_s: float = parameter(
        3e3, "V/s", 1e-12, 1e12, (1e3, 1e4), "rate v0 at which the growth slackens"
    )

    form = "logarithm"
    equation = "r_i = δ1 i + δ2 v0 ln(1 + |v| / v0)"
    source = "Logarithmic dynamic densities, doi 10.1007/s11465-015-0326-1."
    signature = "δ2 fitted record by record falls with amplitude x frequency from some rate on."
    block = staticmethod(logarithmic_rate_block)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start: growth that slackens somewhat below the fastest rate."""
        return (cls.within_bounds(bend_rate_V_s=0.15 * scale.fastest_V_s),)


@njit(cache=True)
def piecewise_rate_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: V (V/s), ln of the width of a part, p_k - 1 from fast to slow.

    No state.
    """
    last = p.shape[0] - 1
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            v, width = x[t, b], p[1, b]
            share = abs(v) / p[0, b]
            if share == 0.0:  # 0 too where a decaying rate underflows
                y[t, b] = 0.0
                continue
            below, power = -math.log(share), 0.0
            for k in range(2, last):
                part = min(below, width)
                power += p[k, b] * part
                below -= part
            power += p[last, b] * below
            y[t, b] = v * math.exp(-power)


_PER_DECADE = 2


def _exponent(k: int) -> Any:
    text = f"p_{k}, of rates between V / 10^{(k - 1) / 2:g} and V / 10^{k / 2:g}"
    return parameter(0.7, "1", 0.05, 4.0, (0.5, 1.0), text, neutral=1.0)


@dataclass(frozen=True)
class PiecewiseRateLaw(Stateless, of=RateLaw):
    """Power of the rate with another exponent in each half decade below the fastest rate.

    The thresholds grow with the rate everywhere; the uppermost exponent holds above it too, and the
    lowest for all slower rates.

    Examples
    --------
    >>> law = PiecewiseRateLaw(0.5, 0.5, 1.0, 1.0, fastest_V_s=1e4)
    >>> law.run([1e4, -1e3, 1e2], 1e-3).round(1).tolist()
    [10000.0, -3162.3, 316.2]
    """

    exponent_1: float = _exponent(1)
    exponent_2: float = _exponent(2)
    exponent_3: float = _exponent(3)
    exponent_4: float = _exponent(4)
    fastest_V_s: float = parameter(
        1e4, "V/s", 1e-12, 1e12, (1e4, 1e4), "fastest rate V", fixed=True
    )

    form = "piecewise power"
    equation = (
        "r_i = δ1 i + δ2 w(|v|), w(V) = V, d(ln w) / d(ln |v|) = p_k in the half decade k below V"
    )
    source = "A monotone table on logarithmic axes."
    signature = "δ2 fitted record by record follows no one power of amplitude x frequency."
    block = staticmethod(piecewise_rate_block)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start: thresholds that grow a little slower than the rate."""
        exponents = {f"exponent_{k}": 0.8 for k in range(1, 5)}
        return (cls.within_bounds(**exponents, fastest_V_s=scale.fastest_V_s),)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """V (V/s), ln of the width of a part, and the exponents of the factor on v."""
        exponents = self.exponent_1, self.exponent_2, self.exponent_3, self.exponent_4
        return [self.fastest_V_s, math.log(10.0) / _PER_DECADE, *(p - 1.0 for p in exponents)]
