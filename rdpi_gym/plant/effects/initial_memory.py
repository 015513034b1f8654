"""Initial memory: what the plant remembers from before the record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

from numba import njit

from rdpi_gym.plant.effects.base import DataScale, Effect, Look, Picture, Stateless, parameter
from rdpi_gym.support.arrays import Array

TURNS = 6
"""Turns of a decaying history."""


def _decaying(centre_V: float, reach_V: float, ratio: float) -> tuple[float, ...]:
    return tuple(centre_V + reach_V * (-ratio) ** k for k in range(TURNS))


@njit(cache=True)
def identity_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel that passes its input on: the plays carry this effect."""
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = x[t, b]


class _Memory(Stateless):
    """Effect that the plays carry: its kernel passes on what comes, and reads nothing."""

    block = staticmethod(identity_block)


@dataclass(frozen=True)
class InitialMemory(_Memory):
    """Play states left by an extremum of the command before the record starts.

    The plant sets them when it is reset
    (:func:`rdpi_gym.plant.settled_memory` of this one extremum).

    Examples
    --------
    >>> from rdpi_gym.plant import settled_memory
    >>> memory = InitialMemory(extremum_V=5.0)
    >>> settled_memory([1.0, 3.0], [memory.extremum_V]).tolist()
    [4.0, 2.0]
    """

    extremum_V: float = parameter(
        20.0, "V", -2e3, 2e3, (5.0, 40.0),
        "command at which the plant last turned before the record", neutral=0.0,
    )  # fmt: skip

    name = "initial_memory"
    slot = "memory"
    order = 10
    equation = "ξ_i(0) = max(u_e - r_i, min(u_e + r_i, 0))"
    source = "Eq. 4 of the paper, with a walk to u_e in the place of ξ_i(0) = 0."
    signature = (
        "The first excursion of a record is wrong; nothing is left once its largest command so far "
        "has been passed in both directions."
    )
    experiment = "Begin a record with a decaying sine, and compare it with one that does not."
    cause = (
        "The ceramic remembers the extreme commands of its past. A model that starts with all "
        "plays at zero starts from another state than the stage."
    )
    hardware = (
        "Every piezo actuator that was moved before the record began, after a power-up above all: "
        "the first motion differs from all that follow."
    )
    magnitude = (
        "Up to half of the loop's width: hysteresis is about 2 % of the stroke for small and 10 "
        "to 15 % for large signals (PI Ceramic, piezo tutorial, "
        "piceramic.com/piezo_tutorial5.php), so up to 5 to 7 % of the stroke until the memory is "
        "wiped out."
    )
    remedy = (
        "Hardware: nothing to buy; run a sine that decays from the full range to zero before each "
        "experiment, which wipes the memory out. Compensation: start the inverse from the same "
        "past, or move once through the full range."
    )
    mistaken_for = ("creep", "thermal_drift", "backlash")
    picture = Picture(
        {"extremum_V": 25.0},
        Look("over_time", "The first moments of a large sine", "sine-10hz", 0.0, 0.02),
        Look("left_over_time", "What a refit leaves of it", "sine-10hz", 0.0, 0.5),
    )

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Extrema on either side: beyond the last play, or short of the first, is no slope."""
        sizes = (0.08, 0.25, 0.6, -0.08, -0.25, -0.6)
        return tuple(cls.within_bounds(extremum_V=scale.centre_V + k * scale.span_V) for k in sizes)

    def turns_from(self, first_V: float) -> tuple[float, ...]:
        """The extremum (V), wherever the record begins."""
        return (self.extremum_V,)


def _ratio() -> Any:
    text = "size of a turn over that of the turn before, on the other side, q"
    return parameter(0.5, "1", -1.0, 0.98, (0.3, 0.8), text, neutral=-1.0)


def _reach() -> Any:
    text = "outermost turn from the command at which the record begins, u_r"
    return parameter(20.0, "V", -2e3, 2e3, (5.0, 40.0), text, neutral=0.0)


@dataclass(frozen=True)
class DecayingHistory(_Memory, of=InitialMemory):
    """Play states left by a motion to and fro that decayed before the record starts.

    Examples
    --------
    >>> DecayingHistory(extremum_V=16.0, ratio=0.5).turns_from(3.0)
    (16.0, -8.0, 4.0, -2.0, 1.0, -0.5)
    """

    extremum_V: float = 20.0
    ratio: float = _ratio()
    centre_V: float = parameter(
        0.0, "V", -2e3, 2e3, (0.0, 0.0), "command about which it decayed", fixed=True
    )

    form = "decaying history"
    equation = "ξ_i(0) after turns at u_c + (u_e - u_c) (-q)^k, k = 0 ... 5"
    cause = (
        "A controller that settles, a relaxation after power-up or a sine that was faded out leaves "
        "nested memory, from the outermost turn inwards."
    )

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The same outermost turn, and turns back of two sizes."""
        centre, outer = scale.centre_V, 0.6 * scale.span_V
        return tuple(
            cls.within_bounds(extremum_V=turn, ratio=q, centre_V=centre)
            for turn in (simpler.values["extremum_V"], centre + outer, centre - outer)
            for q in (0.3, 0.7)
        )

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Outermost turns on either side."""
        near = InitialMemory.within_bounds(extremum_V=scale.centre_V + 0.25 * scale.span_V)
        return cls.from_simpler(near, scale)

    def turns_from(self, first_V: float) -> tuple[float, ...]:
        """Turns (V), in order, wherever the record begins."""
        return _decaying(self.centre_V, self.extremum_V - self.centre_V, self.ratio)


@dataclass(frozen=True)
class AboutTheStart(_Memory, of=InitialMemory):
    """Play states left by a motion that decayed about the command at which each record begins.

    In volts that is another history for each record that begins elsewhere.

    Examples
    --------
    >>> AboutTheStart(reach_V=16.0, ratio=0.5).turns_from(3.0)
    (19.0, -5.0, 7.0, 1.0, 4.0, 2.5)
    """

    reach_V: float = _reach()
    ratio: float = _ratio()

    form = "about the start"
    equation = "ξ_i(0) after turns at u(0) + u_r (-q)^k, k = 0 ... 5"
    cause = (
        "A stage is moved to where a record begins and settles there: it swings about that command, "
        "or a sine about it is faded out."
    )

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """Turns about the data's centre, taken from the start of each record instead."""
        reach, ratio = _reached(simpler, scale)
        return (cls.within_bounds(reach_V=reach, ratio=ratio),)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Outermost turns of three sizes on either side."""
        return tuple(
            cls.within_bounds(reach_V=k * scale.span_V, ratio=0.4)
            for k in (0.15, 0.5, 1.2, -0.15, -0.5, -1.2)
        )

    def turns_from(self, first_V: float) -> tuple[float, ...]:
        """Turns (V) about the command at which the record begins, in order."""
        return _decaying(first_V, self.reach_V, self.ratio)


@dataclass(frozen=True)
class LastTurns(_Memory, of=InitialMemory):
    """Play states left by three turns before each record, relative to where it begins.

    Examples
    --------
    >>> LastTurns(reach_V=16.0, back=-0.75, third=-0.5).turns_from(3.0)
    (19.0, -9.0, 9.0)
    """

    reach_V: float = _reach()
    back: float = parameter(
        -0.5, "1", -1.0, 1.0, (-0.8, -0.2),
        "the turn back over the outermost, b; below zero on the other side", neutral=1.0,
    )  # fmt: skip
    third: float = parameter(
        -0.5, "1", -1.0, 1.0, (-0.8, -0.2), "the third turn over the second, c", neutral=1.0
    )

    form = "last turns"
    equation = "ξ_i(0) after turns at u(0) + u_r (1, b, b c)"
    cause = (
        "A record that is cut out of a motion, or that begins wherever the stage was left: its last "
        "turns, each within those before, are what the ceramic remembers."
    )

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The first three turns of a decaying history."""
        reach, ratio = _reached(simpler, scale)
        return (cls.within_bounds(reach_V=reach, back=-ratio, third=-ratio),)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Outermost turns on either side, turned back by half, or as far on the other side."""
        return tuple(
            cls.within_bounds(reach_V=k * scale.span_V, back=back, third=third)
            for back, third, sizes in ((-0.5, -0.5, (0.3, 1.0)), (-1.0, -0.3, (0.7,)))
            for size in sizes
            for k in (size, -size)
        )

    def turns_from(self, first_V: float) -> tuple[float, ...]:
        """Turns (V) relative to the command at which the record begins, in order."""
        second = self.reach_V * self.back
        return (first_V + self.reach_V, first_V + second, first_V + second * self.third)


def _reached(simpler: Effect, scale: DataScale) -> tuple[float, float]:
    """Return the outermost turn from where a history settles (V), and its ratio, of any form."""
    values = simpler.values
    if "reach_V" in values:
        reach = values["reach_V"]
    else:
        reach = values["extremum_V"] - values.get("centre_V", scale.centre_V)
    return reach, values.get("ratio", 0.4)
