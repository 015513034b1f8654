"""The Bouc-Wen models: an inner length that saturates beside a line, alike or unlike on both branches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self
from zlib import crc32

import numpy as np

from rdpi_gym.plant.cores.bouc_wen_kernel import (
    TOGETHER,
    bouc_wen_block,
    bouc_wen_lanes,
    curves,
)
from rdpi_gym.plant.cores.families import (
    LENGTHS,
    InnerVariable,
    check_gain,
)
from rdpi_gym.plant.parameters import DataScale, Parameter
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

# Of k, what the least slope is at least; what k is at least.
_LEAST = 1e-6


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
    lanes_block = staticmethod(bouc_wen_lanes)
    together = TOGETHER
    linear = ("k", "d")
    either_sign = ("d",)
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
        super().__post_init__()
        check_gain("k", self.k)
        check_gain("d", self.d, signed=True)
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
                f"beta + gamma is {quoted(total)}; give a sum above 0, or z has no limit"
            )
        if not (is_finite(A) and A > 0):
            raise InputError(f"A is {quoted(A)}; give a number above 0")
        if not (is_finite(n) and n >= 1):
            raise InputError(f"n is {quoted(n)}; give an exponent from 1")
        limit = (A / total) ** (1.0 / n) / A
        return cls(k, d * A, limit, beta / total, n)

    @property
    def n(self) -> int:
        """Four: z, the last command, the way since z was zero, and whose it is."""
        return 4

    def resting(self, memory: Array, u0_V: Array) -> Array:
        """Z (V) within its reach; it has followed up to the command, and turns next."""
        rest = InnerVariable.resting(self, memory, u0_V)
        return np.concatenate([rest, np.zeros_like(rest)])

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
        """Gains (µm/V), limits (V) and slopes over them (1/V) above and below zero, n, κ; the curves."""
        up, down = self._limits
        over, under = self._slopes
        kappa = 2.0 * self.sigma - 1.0
        shape = (up, down, over / up, under / down, self.exponent, kappa)
        mark = 1.0 + crc32(np.array(shape).tobytes())
        return [self.k, self.d, *shape, mark, *curves(self.exponent, kappa)]

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


@dataclass(frozen=True)
class AsymmetricBoucWen(BoucWen):
    """Bouc-Wen model with one term more: z' = u' (1 + φ sgn z) - β |u'| |z|^(n-1) z - γ u' |z|^n.

    Parameters
    ----------
    k, d, limit_V, sigma, exponent, rate_bandwidth_hz
        As of :class:`~rdpi_gym.plant.cores.bouc_wen.BoucWen`.
    skew
        φ: z saturates at zc (1 + φ)^(1/n) above zero, and at zc (1 - φ)^(1/n) below. Zero is the
        symmetric model.

    Raises
    ------
    InputError
        As of :class:`~rdpi_gym.plant.cores.bouc_wen.BoucWen`; the skew is beyond its bounds.

    Examples
    --------
    >>> AsymmetricBoucWen(k=0.0, d=1.0, limit_V=2.0, skew=0.25).settled((100.0,)).tolist()[:2]
    [2.5, 100.0]
    """

    skew: float = 0.0

    name = "asymmetric_bouc_wen"
    title = "asymmetric Bouc-Wen model"
    equation = "z' = u' (1 + φ sgn z) - β |u'| |z|^(n-1) z - γ u' |z|^n, y = k u + d z"
    source = (
        f"{BoucWen.source} A term for unlike branches: Zhu, Wang, Non-symmetrical Bouc-Wen model for "
        "piezoelectric ceramic actuators, Sens. Actuators A 181 (2012) 51, who write another one."
    )
    signature = (
        "Rising and falling branches that saturate at unlike heights about the middle of the loop; "
        "small loops do not close and drift along a staircase."
    )
    experiment = (
        "A wide loop about rest, for the heights of its branches; loops of one size at unlike bias."
    )
    shape = (
        *BoucWen.shape,
        Parameter("skew", "1", -0.9, 0.9, (-0.3, 0.3), "unlike saturation φ", neutral=0.0),
    )
    cases: ClassVar[Mapping[str, Mapping[str, float]]] = {
        name: {**numbers, "skew": 0.0} for name, numbers in BoucWen.cases.items()
    }

    @property
    def _slopes(self) -> tuple[float, float]:
        return 1.0 + self.skew, 1.0 - self.skew
