"""Congruency violation: plays whose gain depends on the bias of the loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Look, Picture, Stateless, parameter
from rdpi_gym.plant.effects.knots import along_curve, natural_cubics
from rdpi_gym.support.arrays import Array


@njit(cache=True)
def congruency_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: a_0 (µm/V), c / U² (1/V²). No state."""
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            plays = x[t, b] - p[0, b] * u[t, b]
            y[t, b] = x[t, b] + p[1, b] * u[t, b] * u[t, b] * plays


@dataclass(frozen=True)
class Congruency(Stateless):
    """Weights of the plays that grow with the command's distance from zero.

    Examples
    --------
    >>> effect = Congruency(coefficient=0.1, span_V=10.0)
    >>> effect.run([10.0, 15.0], 1e-3, u=[10.0, 10.0]).tolist()
    [10.0, 15.5]
    """

    coefficient: float = parameter(
        0.1, "1", -0.9, 5.0, (0.05, 0.3), "relative change c of the weights at U", neutral=0.0
    )
    span_V: float = parameter(
        40.0, "V", 1e-9, 1e9, (40.0, 40.0), "command U at which it is c", fixed=True
    )

    name = "congruency"
    slot = "hysteresis"
    order = 10
    equation = "y = a_0 u + (1 + c (u / U)²) Σ a_i ξ_i"
    source = (
        "Weights a_i (1 + c u² / U²) in place of a Preisach density; the amount is an estimate."
    )
    signature = "Minor loops of the same span differ in area with the bias at which they stand."
    experiment = "Minor loops of two spans at three biases."
    cause = (
        "Domains switch more easily at some fields than at others, so small loops on different "
        "levels of the same hysteresis are not copies of each other, as play operators say."
    )
    hardware = (
        "Soft ceramics driven bipolar or through their whole range; a scan of small amplitude "
        "whose offset moves across that range."
    )
    magnitude = (
        "Minor loops of the same span differ by some per cent to some tens of per cent in area "
        "between the middle and the ends of the range; 5 to 30 % of the plays' weights at full "
        "range is an estimate. Preisach models exist because of it."
    )
    remedy = (
        "Hardware: keep to a part of the range, or use a charge drive. Compensation: weights that "
        "depend on the command are undone by solving the same sum sample by sample, as the "
        "extended inverse does while the sum still rises."
    )
    mistaken_for = ("saturation", "asymmetry")
    picture = Picture(
        {"coefficient": 0.3},
        Look("loops", "Minor loops at three biases", "minor-loops"),
        Look("left_over_command", "What a refit leaves of it", "minor-loops"),
    )
    block = staticmethod(congruency_block)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start, at the measured span."""
        return (cls.within_bounds(coefficient=0.05, span_V=scale.span_V),)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """a_0 (µm/V) and c / U² (1/V²)."""
        return [hysteresis.a0, self.coefficient / self.span_V**2]


@njit(cache=True)
def congruency_centred_block(
    x: Array, u: Array, p: Array, state: Array, ts: float, y: Array
) -> None:
    """Kernel; rows of ``p``: a_0 (µm/V), c / U² (1/V²), u_c (V). No state."""
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            away = u[t, b] - p[2, b]
            plays = x[t, b] - p[0, b] * u[t, b]
            y[t, b] = x[t, b] + p[1, b] * away * away * plays


@dataclass(frozen=True)
class AboutTheMiddle(Stateless, of=Congruency):
    """Weights of the plays that grow with the command's distance from the middle of its range.

    Examples
    --------
    >>> effect = AboutTheMiddle(coefficient=0.1, span_V=10.0, middle_V=10.0)
    >>> effect.run([10.0, 15.0], 1e-3, u=[10.0, 0.0]).tolist()
    [10.0, 16.5]
    """

    coefficient: float = 0.1
    span_V: float = 40.0
    middle_V: float = parameter(
        0.0, "V", -1e9, 1e9, (0.0, 40.0), "command u_c at which it is 0", fixed=True
    )

    form = "about the middle of the range"
    equation = "y = a_0 u + (1 + c ((u - u_c) / U)²) Σ a_i ξ_i"
    source = "As the simplest form; a drive with one sign of voltage has its range about another."
    signature = (
        "Minor loops of the same span differ in area between the middle of the range and its ends, "
        "alike on both sides."
    )
    block = staticmethod(congruency_centred_block)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start, at the measured span about the middle of the commands."""
        return (cls.within_bounds(coefficient=0.05, span_V=scale.span_V, middle_V=scale.centre_V),)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """a_0 (µm/V), c / U² (1/V²) and u_c (V)."""
        return [hysteresis.a0, self.coefficient / self.span_V**2, self.middle_V]


@njit(cache=True)
def congruency_polynomial_block(
    x: Array, u: Array, p: Array, state: Array, ts: float, y: Array
) -> None:
    """Kernel; rows of ``p``: a_0 (µm/V), 1 / U (1/V), c_k from the first power on. No state."""
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            share, more = u[t, b] * p[1, b], 0.0
            for k in range(p.shape[0] - 1, 1, -1):
                more = (more + p[k, b]) * share
            y[t, b] = x[t, b] + more * (x[t, b] - p[0, b] * u[t, b])


def _power(default: float, k: int) -> Any:
    text = f"relative change c_{k} of the weights at U with the power {k}"
    return parameter(default, "1", -5.0, 5.0, (-0.2, 0.2), text, neutral=0.0)


class _Polynomial(Stateless):
    """Weights of the plays that change by a polynomial of the command: its coefficients, then U."""

    source = "Weights that depend on the command in place of a Preisach density."
    signature = "Minor loops of the same span differ in area on either side of the range."
    block = staticmethod(congruency_polynomial_block)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start, at the measured span."""
        return (cls.within_bounds(coefficient_1=0.0, coefficient_2=0.05, span_V=scale.span_V),)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """a_0 (µm/V), 1 / U (1/V), then the coefficients of the powers."""
        *powers, span_V = self.values.values()
        return [hysteresis.a0, 1.0 / span_V, *powers]


@dataclass(frozen=True)
class OddAndEven(_Polynomial, of=Congruency):
    """Weights of the plays that change with the command and with its square.

    Examples
    --------
    >>> effect = OddAndEven(coefficient_1=-0.2, coefficient_2=0.1, span_V=10.0)
    >>> effect.run([10.0, 15.0], 1e-3, u=[10.0, 10.0]).tolist()
    [10.0, 14.5]
    """

    coefficient_1: float = _power(0.05, 1)
    coefficient_2: float = _power(0.1, 2)
    span_V: float = 40.0

    form = "odd and even"
    equation = "y = a_0 u + (1 + c_1 u / U + c_2 (u / U)²) Σ a_i ξ_i"


@dataclass(frozen=True)
class ToTheFourthDegree(_Polynomial, of=Congruency):
    """Weights of the plays that change by a polynomial of the command with the powers 1 to 4.

    Examples
    --------
    >>> effect = ToTheFourthDegree(-0.2, 0.1, 0.0, 0.1, span_V=10.0)
    >>> effect.run([10.0, 15.0], 1e-3, u=[10.0, 10.0]).tolist()
    [10.0, 15.0]
    """

    coefficient_1: float = _power(0.05, 1)
    coefficient_2: float = _power(0.1, 2)
    coefficient_3: float = _power(0.0, 3)
    coefficient_4: float = _power(0.0, 4)
    span_V: float = 40.0

    form = "to the fourth degree"
    equation = "y = a_0 u + (1 + c_1 u / U + ... + c_4 (u / U)⁴) Σ a_i ξ_i"


@njit(cache=True)
def congruency_curve_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: a_0 (µm/V), lowest command (V), then as ``along_curve``. No state."""
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            more = along_curve(max(u[t, b] - p[1, b], 0.0), p[2:], b)
            y[t, b] = x[t, b] + more * (x[t, b] - p[0, b] * u[t, b])


def _knot(default: float, k: int) -> Any:
    text = f"relative change of the weights at u_c - U + {k} U / 4, z{k}"
    return parameter(default, "1", -5.0, 5.0, (-0.2, 0.2), text, neutral=0.0)


@dataclass(frozen=True)
class AlongACurve(Stateless, of=Congruency):
    """Weights of the plays that change along a natural cubic spline over the range of the command.

    The spline has nine knots, the first, where the change is zero, at the lower end.

    Examples
    --------
    >>> effect = AlongACurve(*[0.1 * k for k in range(1, 9)], centre_V=8.0, span_V=8.0)
    >>> effect.run([10.0] * 3, 1e-3, u=[0.0, 2.0, 16.0]).round(6).tolist()  # plays 10, 8 and -6 µm
    [10.0, 10.8, 5.2]
    """

    at_1: float = _knot(0.0, 1)
    at_2: float = _knot(0.0, 2)
    at_3: float = _knot(0.0, 3)
    at_4: float = _knot(0.1, 4)
    at_5: float = _knot(0.0, 5)
    at_6: float = _knot(0.0, 6)
    at_7: float = _knot(0.0, 7)
    at_8: float = _knot(0.0, 8)
    centre_V: float = parameter(
        0.0, "V", -1e9, 1e9, (0.0, 40.0), "middle u_c of the range", fixed=True
    )
    span_V: float = parameter(40.0, "V", 1e-9, 1e9, (40.0, 40.0), "half U of the range", fixed=True)

    form = "along a curve"
    equation = (
        "y = a_0 u + (1 + z(u)) Σ a_i ξ_i, z a natural cubic spline, z(u_c - U + k U / 4) = zk"
    )
    source = _Polynomial.source
    signature = "Minor loops of the same span differ in area with the bias at which they stand."
    block = staticmethod(congruency_curve_block)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start, no change over the measured range: the knots' values act linearly."""
        knots = {p.name: 0.0 for p in cls.parameters if not p.fixed}
        return (cls.within_bounds(**knots, centre_V=scale.centre_V, span_V=scale.span_V),)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """a_0 (µm/V), lowest command (V), distance of the knots (V), the cubics between them."""
        *knots, centre_V, span_V = self.values.values()
        cubics: list[float] = natural_cubics(knots).ravel().tolist()
        return [hysteresis.a0, centre_V - span_V, 2.0 * span_V / len(knots), *cubics]
