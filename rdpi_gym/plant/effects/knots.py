"""Straight lines between knots in time, for what wanders and follows no law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Clocked, DataScale, Effect, Parameter
from rdpi_gym.support.arrays import Array


@njit(inline="always")
def along_knots(time: float, p: Array, b: int) -> float:
    """Value at a time (s): straight lines from 0 at t = 0 through p[1:] every p[0] s, then level."""
    last = p.shape[0] - 1
    place = time / p[0, b]
    if place >= last:
        return float(p[last, b])
    k = int(place)
    before = p[k, b] if k > 0 else 0.0
    return float(before + (place - k) * (p[k + 1, b] - before))


@dataclass(frozen=True)
class ByKnots(Clocked):
    """Change along straight lines between seven times, the first at t = 0.

    A subclass adds the values at the six others, in order.

    Attributes
    ----------
    probe
        Constant input on which a simpler form shows its change: what leaves it less what entered.
    """

    duration_s: float = 600.0

    probe: ClassVar[float]
    form = "piecewise linear"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "duration_s", "s", 1e-3, 1e7, (600.0, 600.0), "time of the last knot, D", fixed=True
        ),
    )
    source = "A slow random walk at the resolution of seven knots; sizes are an estimate."

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """No drift over the whole experiment: the knots' values act linearly."""
        return (cls.within_bounds(**dict.fromkeys(cls._knots(), 0.0), duration_s=scale.lasts_s),)

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """Knots on the drift of the simpler form."""
        drift = simpler.run(np.full(7, cls.probe), scale.lasts_s / 6.0) - cls.probe
        knots = dict(zip(cls._knots(), drift[1:].tolist(), strict=True))
        return (cls.within_bounds(**knots, duration_s=scale.lasts_s),)

    @classmethod
    def _knots(cls) -> list[str]:
        return [p.name for p in cls.parameters if not p.fixed]

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Time between knots (s), then the values there."""
        duration, *knots = self.values.values()
        return [duration / len(knots), *knots]
