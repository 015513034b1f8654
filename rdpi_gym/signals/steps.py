"""Signals that hold a level, then go to the next: constant, steps, random steps."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from rdpi_gym.signals.base import (
    ROUNDING,
    Signal,
    number,
    numbers,
    positive,
    refuse,
    smoothstep,
    smoothstep_rate,
    whole,
)
from rdpi_gym.support.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Constant(Signal):
    """One displacement, ``offset_um + amplitude_um level``.

    Parameters
    ----------
    level
        Where between ``offset_um - amplitude_um`` (-1) and ``offset_um + amplitude_um`` (1).

    Examples
    --------
    >>> float(Constant(offset_um=20.0)(0.1))
    20.0
    """

    name: ClassVar[str] = "constant"
    level: float = number(0.0)

    def _shape(self, t: Array) -> Array:
        return np.full_like(t, self.level)

    def _shape_rate(self, t: Array) -> Array:
        return np.zeros_like(t)


@dataclass(frozen=True, kw_only=True)
class Staircase(Signal):
    """Levels held one after the other, from the beginning again after the last.

    Parameters
    ----------
    rise_s
        Time that the smooth way (a quintic, as in the smooth start) to the next level takes at the
        end of each hold (s), at most the hold; 0: a jump.
    """

    rise_s: float = number(0.0, minimum=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rise_s > self._hold_s:
            raise refuse(self, "rise_s", f"at most the time of one hold, {self._hold_s:g} s")

    @property
    @abstractmethod
    def _hold_s(self) -> float:
        """Time from one level to the next (s)."""

    @property
    @abstractmethod
    def _stairs(self) -> Array:
        """The levels of one period."""

    @property
    def has_derivative(self) -> bool:
        """Whether the way from level to level takes time."""
        return self.rise_s > 0.0

    @property
    def period_s(self) -> float:
        """Time of all levels (s)."""
        return self._hold_s * self._stairs.size

    def _shape(self, t: Array) -> Array:
        here, change, s = self._stair(t)
        return here + change * smoothstep(s)

    def _shape_rate(self, t: Array) -> Array:
        if self.rise_s == 0.0:
            return np.zeros_like(t)
        _, change, s = self._stair(t)
        return change * smoothstep_rate(s) / self.rise_s

    def _stair(self, t: Array) -> tuple[Array, Array, Array]:
        """Return the level, the change to the next one, and how far on the way, 0 to 1."""
        stairs = self._stairs
        hold = np.floor(t / self._hold_s + ROUNDING)
        index = np.mod(hold, stairs.size).astype(np.intp)
        here = stairs[index]
        if self.rise_s == 0.0:
            return here, np.zeros_like(t), np.zeros_like(t)
        to_go = (hold + 1.0) * self._hold_s - t
        return here, np.roll(stairs, -1)[index] - here, 1.0 - to_go / self.rise_s


@dataclass(frozen=True, kw_only=True)
class Steps(Staircase):
    """Given levels, each held for the same time.

    Parameters
    ----------
    levels
        The levels, in units of the amplitude.
    hold_s
        Time for each level (s).

    Examples
    --------
    >>> Steps(levels=(0.0, 1.0), hold_s=0.1)([0.0, 0.1, 0.15, 0.2])
    array([0., 1., 1., 0.])
    """

    name: ClassVar[str] = "steps"
    levels: tuple[float, ...] = numbers((0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5), count=1)
    hold_s: float = positive(0.1)

    @property
    def _hold_s(self) -> float:
        return self.hold_s

    @cached_property
    def _stairs(self) -> Array:
        return np.array(self.levels)


@dataclass(frozen=True, kw_only=True)
class RandomSteps(Staircase):
    """Levels drawn from -1 to 1, each as likely as any other.

    Parameters
    ----------
    seed
        Seed of the levels, 0 or more.
    hold_s
        Time for each level (s).
    count
        How many levels are drawn before they come again.

    Examples
    --------
    >>> stairs = RandomSteps(seed=3, hold_s=0.05, count=200)
    >>> stairs.period_s
    10.0
    """

    name: ClassVar[str] = "random-steps"
    seed: int = whole(0, minimum=0)
    hold_s: float = positive(0.1)
    count: int = whole(64, minimum=1, maximum=10_000_000)

    @property
    def _hold_s(self) -> float:
        return self.hold_s

    @cached_property
    def _stairs(self) -> Array:
        return np.random.default_rng(self.seed).uniform(-1.0, 1.0, self.count)
