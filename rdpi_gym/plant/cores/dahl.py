"""Dahl's model of dry friction: a force that rises with the way and saturates as it slides."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.elementary import expm1, log1p, power
from rdpi_gym.plant.cores.families import (
    LENGTHS,
    InnerVariable,
    check_gain,
)
from rdpi_gym.plant.parameters import DataScale, Parameter
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

_LEAST = 1e-12
# No way is longer than this, of the limit.
_FAR = 1e300


@njit(cache=True, error_model="numpy", forceinline=True, fastmath={"contract"})
def _fall(q: float, way: float, m: float) -> float:
    """Return by how much q >= 0 falls over a `way` h where dq/dh = -q^(m + 1), to zero at most.

    q^(-m) grows by m h; for m = 0 it is an exponential. Where m is negative it slides, q = 0,
    within a finite way.
    """
    grown = m * way * power(q, m)
    slides = grown <= -1.0
    exponential = m == 0.0
    over = log1p(0.0 if slides else grown) / (1.0 if exponential else m)
    fall = -q * expm1(-(way if exponential else over))
    return q if slides else fall


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def dahl_block(u: Array, v: Array, p: Array, state: Array, y: Array) -> None:
    """Dahl's model in the command, exactly for a command that is linear between samples."""
    last_row, lanes = p.shape[0] - 1, u.shape[1]
    ahead, q, way, fall = np.empty(lanes), np.empty(lanes), np.empty(lanes), np.empty(lanes)
    for t in range(u.shape[0]):
        for b in range(lanes):
            change = u[t, b] - state[3, b]
            ahead[b] = math.copysign(p[1, b], change)
            far = abs(change) / p[1, b]
            way[b] = far if far < _FAR else _FAR
        for b in range(lanes):
            left = 1.0 - state[2, b] / ahead[b]
            left = left if left > 0.0 else 0.0
            q[b] = left if left < 2.0 else 2.0
            state[3, b] = u[t, b]
        for b in range(lanes):
            fall[b] = _fall(q[b], way[b], p[2, b] - 1.0)
        for b in range(lanes):
            z = state[2, b] + ahead[b] * fall[b]
            state[2, b] = z
            y[t, b] = p[0, b] * z + p[last_row, b]


@dataclass(frozen=True)
class Dahl(InnerVariable):
    """Friction before gross sliding: z' = u' (1 - sgn(u') z / zc)^i, y = s z.

    Parameters
    ----------
    s
        Stiffness (µm/V; of a force over a displacement N/m), above zero.
    limit_V
        zc (V): z while it slides, so that the friction saturates at s zc.
    exponent
        i: brittle below one (zero is one stop operator), ductile from one.
    rate_bandwidth_hz
        Not used: the model does not depend on the rate.

    Raises
    ------
    InputError
        The stiffness is not above zero, or another number is beyond its bounds.

    Examples
    --------
    >>> friction = Dahl(s=2.0, limit_V=0.5, exponent=1.0)
    >>> friction.settled((100.0, -100.0)).tolist()
    [-0.5, -100.0]

    Notes
    -----
    For i = 1 it is the Bouc-Wen model of n = 1, γ = 0, k = 0.
    """

    s: float
    limit_V: float
    exponent: float = 1.0
    rate_bandwidth_hz: float | None = None

    name = "dahl"
    block = staticmethod(dahl_block)
    linear = ("s",)
    title = "Dahl model of friction"
    equation = "z' = u' (1 - sgn(u') z / zc)^i, y = s z"
    source = (
        "Dahl, A solid friction model, Aerospace Corporation TOR-0158 (1968); Solid friction damping "
        "of mechanical vibrations, AIAA J. 14 (1976) 1675."
    )
    signature = (
        "A force that saturates at one height on both sides, with clockwise loops, whatever the rate; "
        "it approaches that height over one length after every reversal. Small loops do not close."
    )
    experiment = "Loops within a loop, before sliding; a slow staircase of steps up and down."
    hardware = "Rolling bearings and dry friction before gross sliding, cable guides, dampers."
    shape = (
        Parameter("limit_V", "V", 1e-9, 1e9, (0.1, 10.0), "z while it slides, zc"),
        Parameter("exponent", "1", 0.0, 4.0, (0.5, 2.0), "shape of the approach, i"),
    )
    clockwise = True
    cases: ClassVar[Mapping[str, Mapping[str, float]]] = {"one length, no line": {"exponent": 1.0}}

    def __post_init__(self) -> None:
        super().__post_init__()
        check_gain("s", self.s)
        if not self.s > 0:
            raise InputError(f"s is {self.s}; give a stiffness above 0")

    @property
    def reach_V(self) -> tuple[float, float]:
        """Lowest and highest z (V)."""
        return -self.limit_V, self.limit_V

    @property
    def a0(self) -> float:
        """Stiffness s (µm/V) from rest."""
        return self.s

    @property
    def A(self) -> float:
        """2 s (µm/V): a walk to and fro can carry z up to twice as far as the command goes."""
        return 2.0 * self.s

    def with_gains(self, gains: Sequence[float]) -> Self:
        """Return the model with another stiffness (µm/V), which stays above zero."""
        return replace(self, s=max(float(gains[0]), _LEAST))

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Limits from small to larger than the command's span."""
        shares = [(min(share, 1.0) * scale.span_V, share * scale.span_V) for share in LENGTHS]
        return tuple(cls(scale.stroke_um / way, limit, 1.0) for way, limit in shares)

    def coefficients(self) -> list[float]:
        """Stiffness s (µm/V), limit zc (V), exponent i."""
        return [self.s, self.limit_V, self.exponent]
