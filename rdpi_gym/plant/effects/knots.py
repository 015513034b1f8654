"""Changes with the time of the experiment: to a limit, along straight lines, along a smooth curve."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
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


@njit(cache=True)
def settling_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel of changes that settle; rows of ``p``: 1 for a relative change, rate (1/s), τ (s) of each.

    Row of the state: samples since t = 0.
    """
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = 0.0
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            time, size = state[0, b] * ts, x[t, b] if p[0, b] > 0.5 else 1.0
            out = x[t, b]
            for k in range(1, p.shape[0], 2):
                out -= p[k, b] * p[k + 1, b] * math.expm1(-time / p[k + 1, b]) * size
            y[t, b] = out
            state[0, b] += 1.0


@njit(cache=True)
def knots_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: 1 for a relative change, then as :func:`along_knots` reads them.

    Row of the state: samples since t = 0.
    """
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = 0.0
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            size = x[t, b] if p[0, b] > 0.5 else 1.0
            y[t, b] = x[t, b] + along_knots(state[0, b] * ts, p[1:], b) * size
            state[0, b] += 1.0


@njit(cache=True)
def curve_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: 1 for a relative change, then as :func:`along_curve` reads them.

    Row of the state: samples since t = 0.
    """
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = 0.0
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            size = x[t, b] if p[0, b] > 0.5 else 1.0
            y[t, b] = x[t, b] + along_curve(state[0, b] * ts, p[1:], b) * size
            state[0, b] += 1.0


def natural_cubics(values: Sequence[float]) -> Array:
    """Return the natural cubic spline from 0 through values that are one interval apart."""
    z, n = np.array([0.0, *values]), len(values)
    steps, bends = np.diff(z), np.zeros(n + 1)
    inner = np.eye(n - 1, k=-1) + 4.0 * np.eye(n - 1) + np.eye(n - 1, k=1)
    bends[1:-1] = np.linalg.solve(inner, 6.0 * np.diff(steps))
    slopes = steps - (2.0 * bends[:-1] + bends[1:]) / 6.0
    return np.stack([z[:-1], slopes, bends[:-1] / 2.0, np.diff(bends) / 6.0], axis=1)


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
        1 for a change relative to the displacement, 0 for one in µm: the constant input on which a
        simpler form shows its change, as what leaves it less what entered.
    """

    duration_s: float = parameter(
        600.0, "s", 1e-3, 1e7, (600.0, 600.0), "time of the last knot, D", fixed=True
    )

    probe: ClassVar[float]
    form = "piecewise linear"
    block = staticmethod(knots_block)
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
        """Whether it is relative, time between knots (s), then the values there."""
        duration, *knots = self.values.values()
        return [self.probe, duration / len(knots), *knots]


class Smooth(ByKnots):
    """Change along a natural cubic spline through fifteen knots, the first at t = 0."""

    form = "smooth curve"
    block = staticmethod(curve_block)
    source = (
        "A slow random walk as a natural cubic spline (de Boor, A Practical Guide to Splines, "
        "chapter IV) through fifteen knots, which holds three turns to and fro within 4 %; sizes are "
        "an estimate."
    )

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Whether it is relative, time between knots (s), the coefficients of each interval's cubic."""
        duration, *knots = self.values.values()
        cubics: list[float] = natural_cubics(knots).ravel().tolist()
        return [self.probe, duration / len(knots), *cubics]
