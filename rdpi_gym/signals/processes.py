"""Random walks within the amplitude: Wiener and Laplace processes."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.signals.base import ROUNDING, Signal
from rdpi_gym.signals.checks import set_integer, set_positive
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

MOST_INCREMENTS = 10_000_000


@dataclass(frozen=True, kw_only=True)
class RandomWalk(Signal):
    """Independent increments on a grid, linear in between, reflected at -1 and 1; from 0 at t = 0.

    It is drawn for `duration_s`, after which it is retraced backwards, then forwards again, and so
    on: any time has its value, and a longer duration goes on from a shorter one.

    Parameters
    ----------
    seed
        Seed of the increments, 0 or more.
    interval_s
        Time from one increment to the next (s).
    spread_s
        Time in which the standard deviation grows to the amplitude where nothing reflects (s).
    duration_s
        Time that is drawn (s), at least `interval_s`.
    """

    seed: int = 0
    interval_s: float = 0.01
    spread_s: float = 1.0
    duration_s: float = 60.0

    def __post_init__(self) -> None:
        super().__post_init__()
        set_integer(self, "seed", minimum=0)
        set_positive(self, "interval_s", "spread_s", "duration_s")
        if not 1 <= self._increments <= MOST_INCREMENTS:
            raise InputError(
                f"{self.name}: duration_s = {self.duration_s:g} holds {float(self._increments):g} intervals "
                f"of interval_s = {self.interval_s:g}; choose them for 1 to {MOST_INCREMENTS}"
            )

    @property
    def period_s(self) -> float:
        """Time forwards and backwards (s)."""
        return 2.0 * self._increments * self.interval_s

    @property
    def _increments(self) -> int:
        return math.floor(self.duration_s / self.interval_s + ROUNDING)

    @abstractmethod
    def _draw(self, rng: np.random.Generator, count: int) -> Array:
        """Return `count` increments of unit variance."""

    @cached_property
    def _knots(self) -> Array:
        """The walk on its grid: the free walk, folded into -1 to 1."""
        increments = self._draw(np.random.default_rng(self.seed), self._increments)
        free = np.cumsum(np.append(0.0, increments)) * math.sqrt(self.interval_s / self.spread_s)
        folded: Array = np.abs(np.mod(free - 1.0, 4.0) - 2.0) - 1.0
        return folded

    def _shape(self, t: Array) -> Array:
        position, _, index = self._place(t)
        knots = self._knots
        return knots[index] + (position - index) * (knots[index + 1] - knots[index])

    def _shape_rate(self, t: Array) -> Array:
        _, direction, index = self._place(t)
        knots = self._knots
        return direction / self.interval_s * (knots[index + 1] - knots[index])

    def _place(self, t: Array) -> tuple[Array, Array, NDArray[np.intp]]:
        """Return the place on the grid, the direction (1 or -1), and the knot to the left."""
        count = self._increments
        cycle: Array = np.mod(t / self.interval_s + ROUNDING, 2 * count)
        direction = np.where(cycle < count, 1.0, -1.0)
        rounded = np.where(cycle < count, cycle, 2 * count - cycle)
        index = np.minimum(np.floor(rounded), count - 1).astype(np.intp)
        return rounded - direction * ROUNDING, direction, index


@dataclass(frozen=True, kw_only=True)
class WienerProcess(RandomWalk):
    """A random walk with normally distributed increments.

    Examples
    --------
    >>> walk = WienerProcess(amplitude_um=20.0, interval_s=1e-3, spread_s=0.5, seed=4)
    >>> bool((abs(walk([1.0, 5.0, 20.0])) <= 20.0).all())
    True
    """

    name: ClassVar[str] = "wiener"

    def _draw(self, rng: np.random.Generator, count: int) -> Array:
        return rng.standard_normal(count)


@dataclass(frozen=True, kw_only=True)
class LaplaceProcess(RandomWalk):
    """A random walk with Laplace distributed increments: long calm, now and then a large move.

    Examples
    --------
    >>> LaplaceProcess(seed=1) == LaplaceProcess().with_seed(1)
    True
    """

    name: ClassVar[str] = "laplace"

    def _draw(self, rng: np.random.Generator, count: int) -> Array:
        return rng.laplace(scale=math.sqrt(0.5), size=count)
