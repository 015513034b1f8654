"""Signals made of signals: sum, sequence."""

from __future__ import annotations

import math
from collections.abc import Callable
from collections.abc import Sequence as Listed
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from rdpi_gym.signals.base import ROUNDING, Signal, checked, refuse, set_numbers
from rdpi_gym.signals.steps import Constant
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Combination(Signal):
    """A signal with parts.

    The parts are in µm already: here `amplitude_um` is the factor on what they make, 1 to leave it
    as it is.

    Parameters
    ----------
    parts
        The signals it is made of, one or more.
    """

    in_micrometres: ClassVar[bool] = True

    parts: tuple[Signal, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        parts = tuple(self.parts) if isinstance(self.parts, list | tuple) else ()
        if not parts or not all(isinstance(part, Signal) for part in parts):
            raise refuse(self, "parts", "a list of one or more signals")
        object.__setattr__(self, "parts", parts)

    @property
    def has_derivative(self) -> bool:
        """Whether every part is continuous."""
        return all(part.has_derivative for part in self.parts)

    def with_seed(self, seed: int) -> Self:
        """Return the signal with each part drawn anew, from a seed of its own made from `seed`."""
        seeds = np.random.SeedSequence(seed).generate_state(len(self.parts))
        parts = zip(self.parts, seeds, strict=True)
        return replace(self, parts=tuple(part.with_seed(int(own)) for part, own in parts))


@dataclass(frozen=True, kw_only=True)
class Sum(Combination):
    """The sum of its parts.

    Examples
    --------
    >>> from rdpi_gym.signals import Sine
    >>> both = Sum(parts=(Sine(frequency_hz=2.0), Sine(frequency_hz=3.0, amplitude_um=0.5)))
    >>> both.period_s
    1.0
    """

    name: ClassVar[str] = "sum"

    @property
    def period_s(self) -> float | None:
        """The shortest common multiple of the parts' periods (s), ratios to 1:1000; else None."""
        periods = [part.period_s for part in self.parts if not isinstance(part, Constant)]
        known = [period for period in periods if period is not None]
        if not known or len(known) < len(periods):
            return None
        longest = max(known)
        ratios = [Fraction(longest / period).limit_denominator(1000) for period in known]
        if any(
            abs(ratio * period - longest) > 1e-9 * longest
            for ratio, period in zip(ratios, known, strict=True)
        ):
            return None
        return longest * math.lcm(*(ratio.denominator for ratio in ratios))

    def _shape(self, t: Array) -> Array:
        return np.asarray(sum(part(t) for part in self.parts))

    def _shape_rate(self, t: Array) -> Array:
        return np.asarray(sum(part.derivative(t) for part in self.parts))


@dataclass(frozen=True, kw_only=True)
class Sequence(Combination):
    """Its parts one after the other, from the beginning again after the last.

    Each part starts at its own t = 0. Nothing joins the end of one to the start of the next: where
    they differ the signal jumps, and `has_derivative` is False.

    Parameters
    ----------
    durations_s
        Time of each part (s), as many as parts.

    Examples
    --------
    >>> from rdpi_gym.signals import Constant, Sine
    >>> wait = Sequence(parts=(Constant(), Sine(frequency_hz=1.0)), durations_s=(0.5, 2.0))
    >>> wait([0.25, 0.75, 2.5])
    array([0., 1., 0.])
    >>> wait.has_derivative
    True
    """

    name: ClassVar[str] = "sequence"
    durations_s: tuple[float, ...] = field(metadata=checked(set_numbers, count=1))

    def __post_init__(self) -> None:
        super().__post_init__()
        if min(self.durations_s) <= 0.0:
            raise refuse(self, "durations_s", "durations above 0 s")
        if len(self.durations_s) != len(self.parts):
            raise InputError(
                f"sequence: {len(self.parts)} parts and {len(self.durations_s)} durations_s; "
                "give one duration for each part"
            )

    @property
    def has_derivative(self) -> bool:
        """Whether every part is continuous and begins where the one before it ends."""
        starts = [float(part(0.0)) for part in self.parts]
        ends = [
            float(part(duration))
            for part, duration in zip(self.parts, self.durations_s, strict=True)
        ]
        gaps = np.abs(np.subtract(ends, np.roll(starts, -1)))
        scale = max(part.amplitude_um + abs(part.offset_um) for part in self.parts)
        return super().has_derivative and bool(gaps.max() <= 1e-9 * scale)

    @property
    def period_s(self) -> float:
        """Time of all parts (s)."""
        return float(self._ends[-1])

    @cached_property
    def _ends(self) -> Array:
        return np.cumsum(self.durations_s)

    def _shape(self, t: Array) -> Array:
        return self._in_turn(t, [part.__call__ for part in self.parts])

    def _shape_rate(self, t: Array) -> Array:
        return self._in_turn(t, [part.derivative for part in self.parts])

    def _in_turn(self, t: Array, parts: Listed[Callable[[Array], Array]]) -> Array:
        """Evaluate at each time the part whose turn it is, at the time since it began."""
        total = self.period_s
        local = t - total * np.floor(t / total + ROUNDING)
        turn = np.searchsorted(self._ends, local + ROUNDING * min(self.durations_s), "right")
        turn = np.minimum(turn, len(parts) - 1)
        since = np.maximum(local - np.append(0.0, self._ends)[turn], 0.0)
        values = np.empty_like(t)
        for index, part in enumerate(parts):
            mine = turn == index
            values[mine] = part(since[mine])
        return values
