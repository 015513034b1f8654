"""Straight lines and smooth curves through knots in time, for what wanders and follows no law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import ClassVar, Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Clocked, DataScale, Effect, Parameter, parameter
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


@njit(inline="always")
def along_curve(time: float, p: Array, b: int) -> float:
    """Value at a time (s): cubics p[1:] of the share of an interval of p[0] s, then level."""
    count = (p.shape[0] - 1) // 4
    place = time / p[0, b]
    k = min(int(place), count - 1)
    share, row = min(place - k, 1.0), 1 + 4 * k
    bent = p[row + 1, b] + share * (p[row + 2, b] + share * p[row + 3, b])
    return float(p[row, b] + share * bent)


@cache
def _bending(count: int) -> Array:
    """Matrix of the inner second derivatives of a natural cubic spline through `count` points."""
    return np.asarray(np.eye(count, k=-1) + 4.0 * np.eye(count) + np.eye(count, k=1))


def natural_cubics(values: Sequence[float]) -> Array:
    """Return the natural cubic spline from 0 through values that are one interval apart."""
    z, n = np.array([0.0, *values]), len(values)
    steps, bends = z[1:] - z[:-1], np.zeros(n + 1)
    bends[1:-1] = np.linalg.solve(_bending(n - 1), 6.0 * (steps[1:] - steps[:-1]))
    slopes = steps - (2.0 * bends[:-1] + bends[1:]) / 6.0
    cubics = np.empty((n, 4))
    cubics[:, 0], cubics[:, 1], cubics[:, 2] = z[:-1], slopes, bends[:-1] / 2.0
    cubics[:, 3] = (bends[1:] - bends[:-1]) / 6.0
    return cubics


def at_knots(
    count: int,
    suffix: str,
    unit: str,
    bounds: tuple[float, float],
    typical: tuple[float, float],
    what: str,
) -> tuple[Parameter, ...]:
    """Return the parameters of a curve through knots: the last time, then the values."""
    values = (
        Parameter(
            f"at_{k}{suffix}", unit, *bounds, typical, f"{what} at the time {k} D / {count}, z{k}",
            neutral=0.0,
        )
        for k in range(1, count + 1)
    )  # fmt: skip
    return (*ByKnots.parameters, *values)


@dataclass(frozen=True)
class ByKnots(Clocked):
    """Change along straight lines between seven times, the first at t = 0.

    A subclass adds the values at the six others, in order.

    Attributes
    ----------
    probe
        Constant input on which a simpler form shows its change: what leaves it less what entered.
    """

    duration_s: float = parameter(
        600.0, "s", 1e-3, 1e7, (600.0, 600.0), "time of the last knot, D", fixed=True
    )

    probe: ClassVar[float]
    form = "piecewise linear"
    source = "A slow random walk at the resolution of seven knots; sizes are an estimate."

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """No drift over the whole experiment: the knots' values act linearly."""
        return (cls.within_bounds(**dict.fromkeys(cls._knots(), 0.0), duration_s=scale.lasts_s),)

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """Knots on the drift of the simpler form."""
        names = cls._knots()
        probe = np.full(1 + len(names), cls.probe)
        drift = simpler.run(probe, scale.lasts_s / len(names)) - cls.probe
        knots = dict(zip(names, drift[1:].tolist(), strict=True))
        return (cls.within_bounds(**knots, duration_s=scale.lasts_s),)

    @classmethod
    def one_by_one(cls, scale: DataScale) -> tuple[Effect, ...]:
        """Return a small change at each of the knots in turn, over the whole experiment."""
        (still,) = cls.starts(scale)
        values = {p.name: p.typical[0] for p in cls.parameters if not p.fixed}
        return tuple(still.with_values({name: value}) for name, value in values.items())

    @classmethod
    def bends(cls) -> Array:
        """Second differences: where no record is, the curve goes on as it went."""
        return np.diff(np.eye(len(cls._knots()) + 1)[:, 1:], 2, axis=0)

    @classmethod
    def _knots(cls) -> list[str]:
        return [p.name for p in cls.parameters if not p.fixed]

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Time between knots (s), then the values there."""
        duration, *knots = self.values.values()
        return [duration / len(knots), *knots]


class Smooth(ByKnots):
    """Change along a natural cubic spline through fifteen knots, the first at t = 0."""

    form = "smooth curve"
    source = (
        "A slow random walk as a natural cubic spline (de Boor, A Practical Guide to Splines, "
        "chapter IV) through fifteen knots, which holds three turns to and fro within 4 %; sizes are "
        "an estimate."
    )

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Time between knots (s), then the coefficients of the cubic of each interval."""
        duration, *knots = self.values.values()
        cubics: list[float] = natural_cubics(knots).ravel().tolist()
        return [duration / len(knots), *cubics]
