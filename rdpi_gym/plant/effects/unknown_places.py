"""Where a free block stands: what it reads there, and what it changes."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar, Literal, Self

import numpy as np

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, Parameter, Slot
from rdpi_gym.plant.effects.linear import lag_step
from rdpi_gym.plant.effects.unknown_kernel import POWER, TERMS, unknown_block

Place = Literal["before", "in", "behind", "beside"]
"""Where a block stands: it changes the command, the weights of the plays, or the displacement, by the
displacement itself or, beside the hysteresis, by the command."""
Terms = Mapping[str, float]
"""Weights by :data:`~rdpi_gym.plant.effects.unknown_kernel.TERMS`."""

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
    """What every form of the block shares.

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
        """Of the command."""
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
        """Of the displacement."""
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
