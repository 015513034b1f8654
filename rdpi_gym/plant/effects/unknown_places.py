"""Kernel of a free block, and its places in the chain."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar, Literal, Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, Parameter, Slot
from rdpi_gym.plant.effects.linear import lag_step
from rdpi_gym.support.arrays import Array

TERMS = (
    "linear", "absolute", "even_1", "even_2", "even_3", "odd_1", "odd_2", "odd_3", "step", "speed",
    "drag", "cross",
)  # fmt: skip
"""Drives of a block, of s and its rate r: s, |s|, the even and the odd quadratic spline with knots
at 0, 1/3 and 2/3, a smooth step at 0, |r|, r |r|, s r."""
POWER = ("weight", "power", "rate_power", "signed", "rate_signed")
"""Numbers of one more term, w |s|^a |r|^b with the sign of s, of r, of both or of none."""
_STEP = 0.15  # half of the width of the step, in spans
_HEAD, _LAG = 7, 3
_MEMORY = _LAG + len(TERMS) + len(POWER)


@njit(inline="always")
def _power(s: float, r: float, w: Array, k: int) -> float:
    """One term with two exponents."""
    value: float = w[k, 15]
    if w[k, 16] > 0.0:
        value *= abs(s) ** w[k, 16] if s != 0.0 else 0.0
    if w[k, 17] > 0.0:
        value *= abs(r) ** w[k, 17] if r != 0.0 else 0.0
    if w[k, 18] > 0.5 and s < 0.0:
        value = -value
    return -value if w[k, 19] > 0.5 and r < 0.0 else value


@njit(cache=True)
def unknown_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel: y = x + (p4 + p5 x + p6 u) Σ_k z_k, where z_k lags behind a sum of terms of s and r.

    s = p0 x + p1 u + p2, and r is p3 times its change from sample to sample. Rows of each memory: F, G0
    and G1 of its lag, the weights of :data:`TERMS`, then w, a, b, o and q of w |s|^a |r|^b, with the
    sign of s where o is 1 and that of r where q is. Rows of the state: s, r, then the drive and z of each memory.
    """
    memories = (p.shape[0] - _HEAD) // _MEMORY
    # lane by lane: its parameters stay in registers, and what the memories share is made once
    w, past = np.empty((memories, _MEMORY)), np.empty((memories, 2))
    for b in range(x.shape[1]):
        of_x, of_u, middle, per_step = p[0, b], p[1, b], p[2, b], p[3, b]
        alone, by_x, by_u = p[4, b], p[5, b], p[6, b]
        last_s, last_r = state[0, b], state[1, b]
        for k in range(memories):
            for j in range(_MEMORY):
                w[k, j] = p[_HEAD + _MEMORY * k + j, b]
            past[k, 0], past[k, 1] = state[2 + 2 * k, b], state[3 + 2 * k, b]
        for t in range(x.shape[0]):
            s = of_x * x[t, b] + of_u * u[t, b] + middle
            begins = np.isnan(last_s)
            if begins:
                last_s, last_r = s, 0.0
            r = per_step * (s - last_s)
            now = 1.5 * r - 0.5 * last_r
            last_s, last_r = s, r
            size = abs(s)
            above, far_above = max(size - 1.0 / 3.0, 0.0), max(size - 2.0 / 3.0, 0.0)
            square, above, far_above = size * size, above * above, far_above * far_above
            step = min(max(s / _STEP, -1.0), 1.0)
            step *= 1.5 - 0.5 * step * step
            total = 0.0
            for k in range(memories):
                # without a lag at the sample itself; a jump is one step for a memory
                rate = r if w[k, 0] > 0.0 else now
                even = w[k, 5] * square + w[k, 6] * above + w[k, 7] * far_above
                odd = w[k, 8] * square + w[k, 9] * above + w[k, 10] * far_above
                drive = w[k, 3] * s + w[k, 4] * size + even + (odd if s > 0.0 else -odd)
                drive += w[k, 11] * step
                drive += w[k, 12] * abs(rate) + w[k, 13] * rate * abs(rate) + w[k, 14] * s * rate
                if w[k, 15] != 0.0:
                    drive += _power(s, rate, w, k)
                if begins:  # at rest
                    past[k, 0], past[k, 1] = drive, drive
                z = w[k, 0] * past[k, 1] + w[k, 1] * past[k, 0] + w[k, 2] * drive
                past[k, 0], past[k, 1] = drive, z
                total += z
            y[t, b] = x[t, b] + (alone + by_x * x[t, b] + by_u * u[t, b]) * total
        state[0, b], state[1, b] = last_s, last_r
        for k in range(memories):
            state[2 + 2 * k, b], state[3 + 2 * k, b] = past[k, 0], past[k, 1]


Place = Literal["before", "in", "behind", "beside"]
"""Where a block stands: it changes the command, the weights of the plays, or the displacement, by the
displacement itself or, beside the hysteresis, by the command."""
Terms = Mapping[str, float]
"""Weights by :data:`~rdpi_gym.plant.effects.unknown_places.TERMS`."""

_STARTS, _SHORTEST, _LONGEST = 6, 5.0, 0.3
"""Time constants that a fit begins with; the least in samples, the largest in longest records."""

VOLTS = (
    Parameter("centre_V", "V", -1e9, 1e9, (0.0, 40.0), "command u_c at which s is 0", fixed=True),
    Parameter("span_V", "V", 1e-9, 1e9, (40.0, 40.0), "distance U from there at which s is 1", fixed=True),
    Parameter("rate_V_s", "V/s", 1e-12, 1e12, (1e4, 1e4), "rate at which r is 1", fixed=True),
)  # fmt: skip
"""Scales of a block that reads the command; they are those of the data."""
MICROMETRES = (
    Parameter("centre_V", "V", -1e9, 1e9, (0.0, 40.0), "command u_c: s is 0 at A u_c", fixed=True),
    Parameter("span_um", "µm", 1e-9, 1e9, (40.0, 40.0), "distance Y from there at which s is 1", fixed=True),
    Parameter("rate_um_s", "µm/s", 1e-12, 1e12, (1e4, 1e4), "rate at which r is 1", fixed=True),
)  # fmt: skip
"""Scales of one that reads the displacement."""


class Block(Effect):
    """Base class of all forms of the block.

    Attributes
    ----------
    place
        Where it stands.
    """

    place: ClassVar[Place]
    block = staticmethod(unknown_block)

    @abstractmethod
    def memories(self) -> list[tuple[float, Terms]]:
        """Return of each memory its time constant (s; 0: none) and its drive, by :data:`TERMS`."""

    @abstractmethod
    def ends(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Return the head of the kernel's parameters."""

    @classmethod
    @abstractmethod
    def scales(cls, scale: DataScale) -> dict[str, float]:
        """Return centre, span and rate of the data."""

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """The head, then of each memory its lag and the weights of its drive."""
        column = self.ends(ts_s, hysteresis)
        for time_constant_s, drive in self.memories():
            column += [*lag_step(time_constant_s, ts_s), *(drive.get(name, 0.0) for name in TERMS)]
            column += [drive.get(name, 0.0) for name in POWER]
        return column

    def state_rows(self, ts_s: float) -> int:
        """The last s and its rate; drive and state of each memory."""
        return 2 + 2 * len(self.memories())

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start that changes nothing; where there is a memory one for each of some time constants."""
        weights = {p.name: 0.0 for p in cls.parameters if p.neutral is not None}
        slow = [p.name for p in cls.parameters if p.unit == "s"]
        if not slow:
            return (cls.within_bounds(**weights, **cls.scales(scale)),)
        shortest = _SHORTEST * scale.shortest_s
        grid = np.geomspace(shortest, max(_LONGEST * scale.longest_s, 2.0 * shortest), _STARTS)
        return tuple(
            cls.within_bounds(
                **weights, **dict(zip(slow, taus, strict=True)), **cls.scales(scale)
            )
            for taus in combinations(grid.tolist(), len(slow))
        )  # fmt: skip


@dataclass(frozen=True)
class OfTheCommand(Block):
    """A block that reads the command: centre u_c (V), span U (V) and fastest rate (V/s) of the data."""

    centre_V: float = 0.0
    span_V: float = 40.0
    rate_V_s: float = 1e4

    @classmethod
    def scales(cls, scale: DataScale) -> dict[str, float]:
        """Scales of the command."""
        return {
            "centre_V": scale.centre_V,
            "span_V": scale.span_V,
            "rate_V_s": scale.fastest_V_s,
        }

    def _middle(self) -> float:
        return -self.centre_V / self.span_V

    def _rate(self, ts_s: float) -> float:
        return self.span_V / (ts_s * self.rate_V_s)


class Before(OfTheCommand):
    """A block that changes the command which the plays see."""

    place: ClassVar[Place] = "before"
    slot: ClassVar[Slot] = "input"
    order = 90

    def ends(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Reads the command, and adds U times the sum to it."""
        ends = [self.span_V, 0.0, 0.0]
        return [1.0 / self.span_V, 0.0, self._middle(), self._rate(ts_s), *ends]


class In(OfTheCommand):
    """A block that changes the weights of the plays."""

    place: ClassVar[Place] = "in"
    slot: ClassVar[Slot] = "hysteresis"
    order = 4

    def ends(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Reads the command, and adds the sum times the displacement less a_0 u."""
        ends = [0.0, 1.0, -hysteresis.a0]
        return [0.0, 1.0 / self.span_V, self._middle(), self._rate(ts_s), *ends]


class Beside(OfTheCommand):
    """A block of the command whose output is added to the displacement."""

    place: ClassVar[Place] = "beside"
    slot: ClassVar[Slot] = "output"
    order = 2

    def ends(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Reads the command, and adds A U times the sum to the displacement."""
        ends = [hysteresis.A * self.span_V, 0.0, 0.0]
        return [0.0, 1.0 / self.span_V, self._middle(), self._rate(ts_s), *ends]


@dataclass(frozen=True)
class Behind(Block):
    """A block of the displacement: centre u_c (V), span Y (µm) and fastest rate (µm/s) of the data."""

    centre_V: float = 0.0
    span_um: float = 40.0
    rate_um_s: float = 1e4

    place: ClassVar[Place] = "behind"
    slot: ClassVar[Slot] = "output"
    order = 2

    @classmethod
    def scales(cls, scale: DataScale) -> dict[str, float]:
        """Scales of the displacement."""
        gain = scale.stroke_um / max(scale.span_V, 1e-300)
        return {
            "centre_V": scale.centre_V,
            "span_um": scale.stroke_um,
            "rate_um_s": gain * scale.fastest_V_s,
        }

    def ends(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Reads the displacement, and adds Y times the sum to it."""
        span_um = self.span_um
        return [
            1.0 / span_um, 0.0, -hysteresis.A * self.centre_V / span_um, span_um / (ts_s * self.rate_um_s),
            span_um, 0.0, 0.0,
        ]  # fmt: skip
