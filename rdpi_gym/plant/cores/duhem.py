"""The Duhem model of Coleman and Hodgdon: after every reversal an exponential approach to a line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.elementary import expm1_lanes
from rdpi_gym.plant.cores.families import (
    LENGTHS,
    InnerVariable,
    check_gain,
)
from rdpi_gym.plant.parameters import DataScale, Parameter
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

# Of b, what c is at least over one half of it, so that a reversal turns the displacement too.
_LEAST = 1e-6


@njit(cache=True, error_model="numpy")
def duhem_block(u: Array, v: Array, p: Array, state: Array, y: Array) -> None:
    """Coleman-Hodgdon model in the command, exactly for a command that is linear between samples.

    With z = (y - b u) / (c - b) its equation is dz/du = 1 - sgn(u') z / l, which has a solution.
    """
    last_row, lanes = p.shape[0] - 1, u.shape[1]
    limit, way_over, fall = np.empty(lanes), np.empty(lanes), np.empty(lanes)
    for t in range(u.shape[0]):
        for b in range(lanes):
            way = u[t, b] - state[3, b]
            state[3, b] = u[t, b]
            limit[b] = math.copysign(p[2, b], way)
            way_over[b] = -abs(way) / p[2, b]
        expm1_lanes(way_over, fall)
        for b in range(lanes):
            z = state[2, b] - (limit[b] - state[2, b]) * fall[b]
            state[2, b] = z
            y[t, b] = p[0, b] * (u[t, b] - z) + p[1, b] * z + p[last_row, b]


@dataclass(frozen=True)
class Duhem(InnerVariable):
    """Coleman-Hodgdon model with linear functions: y' = α |u'| (b u - y) + c u', α = 1 / length.

    Parameters
    ----------
    b
        Slope (µm/V) of the line that both branches approach, not negative.
    c
        Gain (µm/V) of a small command from rest: at least half of `b`, above zero. Loops turn
        counter-clockwise where it is below `b`, and clockwise above.
    length_V
        1 / α (V): the way of the command over which a branch approaches its line.
    rate_bandwidth_hz
        Not used: the model does not depend on the rate.

    Raises
    ------
    InputError
        A gain is not finite or negative, `c` is below half of `b` (the displacement would fall as
        the command turns upwards), or the length is beyond its bounds.

    Examples
    --------
    >>> piezo = Duhem(b=1.0, c=0.7, length_V=12.0)
    >>> piezo.a0, piezo.A
    (0.7, 1.0)

    Notes
    -----
    With z = (y - b u) / (c - b) it is the Bouc-Wen model of n = 1, γ = 0, k = b, d = c - b.
    """

    b: float
    c: float
    length_V: float
    rate_bandwidth_hz: float | None = None

    name = "duhem"
    block = staticmethod(duhem_block)
    linear = ("b", "c")
    title = "Duhem model of Coleman and Hodgdon"
    equation = "y' = α |u'| (b u - y) + c u', α = 1 / length"
    source = (
        "Duhem 1897; Coleman, Hodgdon, A constitutive relation for rate-independent hysteresis in "
        "ferromagnetically soft materials, Int. J. Eng. Sci. 24 (1986) 897."
    )
    signature = (
        "After every reversal an exponential approach to one straight line, with one length wherever "
        "the reversal stands; small loops do not close, and drift until they lie about that line."
    )
    experiment = "Loops within a loop, run many times: their drift; a staircase up and down."
    hardware = "Soft magnetic cores and magnetostrictive actuators; piezoelectric stacks, roughly."
    shape = (
        Parameter(
            "length_V", "V", 1e-9, 1e9, (1.0, 30.0), "way over which a branch settles, 1 / α"
        ),
    )
    clockwise = None
    cases: ClassVar[Mapping[str, Mapping[str, float]]] = {
        "one length": {},
        "one length, no line": {"b": 0.0},
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        check_gain("b", self.b)
        check_gain("c", self.c)
        if not (self.c > 0 and 2.0 * self.c >= self.b):
            raise InputError(
                f"c is {self.c} with b {self.b}; give a c above 0 and at least b / 2, or the displacement falls as the command turns upwards"
            )

    @property
    def reach_V(self) -> tuple[float, float]:
        """Lowest and highest z (V)."""
        return -self.length_V, self.length_V

    @property
    def a0(self) -> float:
        """Gain c (µm/V) from rest; right after a turn of a wide loop it is 2 c - b."""
        return self.c

    @property
    def A(self) -> float:
        """Largest gain (µm/V): b, or 2 c - b where loops turn clockwise."""
        return max(self.b, 2.0 * self.c - self.b)

    def with_gains(self, gains: Sequence[float]) -> Self:
        """Return the model with other b and c (µm/V), c above one half of b."""
        b, c = (max(float(gain), 0.0) for gain in gains)
        return replace(self, b=b, c=max(c, 0.5 * (1.0 + _LEAST) * b, _LEAST**2))

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Lengths from short to longer than the command's span."""
        gain = scale.stroke_um / scale.span_V
        return tuple(cls(gain, 0.7 * gain, share * scale.span_V) for share in LENGTHS)

    def coefficients(self) -> list[float]:
        """Slopes b and c (µm/V), length (V)."""
        return [self.b, self.c, self.length_V]
