"""Unknown: a free block for an error that no effect of the catalogue explains, in any place of the chain."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from types import new_class
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, Slot, parameter
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
"""Where a block acts: on the command, the weights of the plays, or the displacement, driven by the
displacement itself or, beside the hysteresis, by the command."""
Terms = Mapping[str, float]
"""Weights by :data:`TERMS`."""

_STARTS, _SHORTEST, _LONGEST = 6, 5.0, 0.3
"""Time constants that a fit begins with; the least in samples, the largest in longest records."""
_APART = 5.0  # ratio of the time constants of two memories that a fit begins with


class Block(Effect):
    """Base class of all forms of the block."""

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
            column += lag_step(time_constant_s, ts_s)
            column += [drive.get(name, 0.0) for name in (*TERMS, *POWER)]
        return column

    def state_rows(self, ts_s: float) -> int:
        """The last s and its rate; drive and state of each memory."""
        return 2 + 2 * len(self.memories())

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start that changes nothing; with a memory one for each of some time constants."""
        fixed = {p.name: 0.0 for p in cls.parameters if p.neutral is not None} | cls.scales(scale)
        slow = [p.name for p in cls.parameters if p.unit == "s"]
        shortest = _SHORTEST * scale.shortest_s
        grid = np.geomspace(shortest, max(_LONGEST * scale.longest_s, 2.0 * shortest), _STARTS)
        chosen = combinations(grid.tolist(), len(slow))
        return tuple(
            cls.within_bounds(**fixed, **dict(zip(slow, taus, strict=True))) for taus in chosen
        )


def _centre(text: str) -> Any:
    return parameter(0.0, "V", -1e9, 1e9, (0.0, 40.0), text, fixed=True)


@dataclass(frozen=True)
class OfTheCommand(Block):
    """Block that reads the command: centre u_c (V), span U (V) and fastest rate (V/s) of the data."""

    centre_V: float = _centre("command u_c at which s is 0")
    span_V: float = parameter(
        40.0, "V", 1e-9, 1e9, (40.0, 40.0), "distance U from there at which s is 1", fixed=True
    )
    rate_V_s: float = parameter(
        1e4, "V/s", 1e-12, 1e12, (1e4, 1e4), "rate at which r is 1", fixed=True
    )

    @classmethod
    def scales(cls, scale: DataScale) -> dict[str, float]:
        """Scales of the command."""
        return {"centre_V": scale.centre_V, "span_V": scale.span_V, "rate_V_s": scale.fastest_V_s}

    @abstractmethod
    def sizes(self, hysteresis: Core) -> list[float]:
        """Return the factor of the block's output: its constant, and its parts per µm and per V."""

    def ends(self, ts_s: float, hysteresis: Core) -> list[float]:
        """The head of a block that reads the command, then its size."""
        span = self.span_V
        reads = [0.0, 1.0 / span, -self.centre_V / span, span / (ts_s * self.rate_V_s)]
        return [*reads, *self.sizes(hysteresis)]


class Before(OfTheCommand):
    """Block that changes the command which the plays see, by U times its output."""

    place: ClassVar[Place] = "before"
    slot: ClassVar[Slot] = "input"
    order = 90

    def sizes(self, hysteresis: Core) -> list[float]:
        """The span U."""
        return [self.span_V, 0.0, 0.0]

    def ends(self, ts_s: float, hysteresis: Core) -> list[float]:
        """The head of a block whose input is the command."""
        _, per_V, *rest = super().ends(ts_s, hysteresis)
        return [per_V, 0.0, *rest]


class In(OfTheCommand):
    """Block that changes the weights of the plays: its output times the displacement less a_0 u."""

    place: ClassVar[Place] = "in"
    slot: ClassVar[Slot] = "hysteresis"
    order = 4

    def sizes(self, hysteresis: Core) -> list[float]:
        """The displacement less a_0 u."""
        return [0.0, 1.0, -hysteresis.a0]


class Beside(OfTheCommand):
    """Block of the command that adds A U times its output to the displacement."""

    place: ClassVar[Place] = "beside"
    slot: ClassVar[Slot] = "output"
    order = 2

    def sizes(self, hysteresis: Core) -> list[float]:
        """The displacement A U of the span."""
        return [hysteresis.A * self.span_V, 0.0, 0.0]


@dataclass(frozen=True)
class Behind(Block):
    """Block of the displacement: centre u_c (V), span Y (µm) and fastest rate (µm/s) of the data."""

    centre_V: float = _centre("command u_c: s is 0 at A u_c")
    span_um: float = parameter(
        40.0, "µm", 1e-9, 1e9, (40.0, 40.0), "distance Y from there at which s is 1", fixed=True
    )
    rate_um_s: float = parameter(
        1e4, "µm/s", 1e-12, 1e12, (1e4, 1e4), "rate at which r is 1", fixed=True
    )

    place: ClassVar[Place] = "behind"
    slot: ClassVar[Slot] = "output"
    order = 2

    @classmethod
    def scales(cls, scale: DataScale) -> dict[str, float]:
        """Scales of the displacement."""
        rate_um_s = scale.stroke_um / max(scale.span_V, 1e-300) * scale.fastest_V_s
        return {"centre_V": scale.centre_V, "span_um": scale.stroke_um, "rate_um_s": rate_um_s}

    def ends(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Reads the displacement, and adds Y times the sum to it."""
        span, rate = self.span_um, self.span_um / (ts_s * self.rate_um_s)
        return [1.0 / span, 0.0, -hysteresis.A * self.centre_V / span, rate, span, 0.0, 0.0]


def is_even(name: str) -> bool:
    """Whether a weight belongs to an even term."""
    return name.rstrip("_0123456789") in ("absolute", "even", "speed", "cross")


def weight(default: float, text: str, most: float = 5.0) -> Any:
    """Return the field of a share that may be of either sign, `most` at most."""
    return parameter(default, "1", -most, most, (-0.05, 0.05), text, neutral=0.0)


def _spline(default: float, parity: str, k: int) -> Any:
    text = (
        f"share of the {parity} part that begins at {k - 1} / 3 of the span, quadratic from there"
    )
    return weight(default, text)


def _step() -> Any:
    return weight(0.0, "share of a step about the middle")


def _speed() -> Any:
    # the fastest record is not the one that lasts: a memory sees a small part of its rate
    return weight(0.0, "share of the absolute rate |r|", 1e3)


def _lag(default: float) -> Any:
    return parameter(default, "s", 1e-6, 1e9, (0.1, 10.0), "time constant τ of its lag")


class AtOnce(Block):
    """Without a memory."""

    def memories(self) -> list[tuple[float, Terms]]:
        """No memory, one drive."""
        return [(0.0, self.values)]


@dataclass(frozen=True)
class Static(AtOnce):
    """A curve: an even and an odd quadratic spline, and a step."""

    even_1: float = _spline(0.02, "even", 1)
    even_2: float = _spline(0.0, "even", 2)
    even_3: float = _spline(0.0, "even", 3)
    odd_1: float = _spline(0.02, "odd", 1)
    odd_2: float = _spline(0.0, "odd", 2)
    odd_3: float = _spline(0.0, "odd", 3)
    step: float = _step()


@dataclass(frozen=True)
class OfTheRate(AtOnce):
    """Terms of the rate, without memory."""

    speed: float = weight(0.02, "share of the absolute rate |r|")
    drag: float = weight(0.02, "share of r |r|")
    cross: float = weight(0.0, "share of the product s r")


@dataclass(frozen=True)
class WithMemory(Block):
    """A lag of a sum of terms."""

    linear: float = weight(0.0, "share of s")
    absolute: float = weight(0.0, "share of |s|")
    even: float = weight(0.02, "share of s²")
    odd: float = weight(0.0, "share of s |s|")
    step: float = _step()
    speed: float = _speed()
    time_constant_s: float = _lag(1.0)

    def memories(self) -> list[tuple[float, Terms]]:
        """One memory, whose drive has the even and the odd term under the names of the splines."""
        drive = self.values
        return [(self.time_constant_s, drive | {"even_1": self.even, "odd_1": self.odd})]


@dataclass(frozen=True)
class WithTwoMemories(Block):
    """Two of them, side by side."""

    linear_1: float = weight(0.0, "share of s")
    absolute_1: float = weight(0.0, "share of |s|")
    even_1: float = weight(0.02, "share of s²")
    odd_1: float = weight(0.0, "share of s |s|")
    step_1: float = _step()
    speed_1: float = _speed()
    time_constant_1_s: float = _lag(0.3)
    linear_2: float = weight(0.0, "share of s")
    absolute_2: float = weight(0.0, "share of |s|")
    even_2: float = weight(0.02, "share of s²")
    odd_2: float = weight(0.0, "share of s |s|")
    step_2: float = _step()
    speed_2: float = _speed()
    time_constant_2_s: float = _lag(3.0)

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The fitted memory, and one beside it that is faster or slower."""
        if not isinstance(simpler, WithMemory):
            return cls.starts(scale)
        own = [p.name for p in WithMemory.parameters[:-1]]
        tau, scales = simpler.time_constant_s, cls.scales(scale)
        return tuple(
            cls.within_bounds(
                **{f"{name}_{k}": simpler.values[name] if k == fitted else 0.0 for k in (1, 2) for name in own},
                time_constant_1_s=fast, time_constant_2_s=slow, **scales,
            )
            for fitted, fast, slow in ((2, tau / _APART, tau), (1, tau, tau * _APART))
        )  # fmt: skip

    def memories(self) -> list[tuple[float, Terms]]:
        """Two, whose drives have the even and the odd term under the names of the splines."""
        values = self.values
        as_terms = {p.name: p.name for p in WithMemory.parameters[:-1]} | {
            "even": "even_1",
            "odd": "odd_1",
        }
        return [
            (values[f"time_constant_{k}_s"], {term: values[f"{name}_{k}"] for name, term in as_terms.items()})
            for k in (1, 2)
        ]  # fmt: skip


@dataclass(frozen=True)
class Unknown(Behind, Static):
    """A curve behind the hysteresis, of which nothing is known but what records teach.

    Examples
    --------
    >>> block = Unknown(even_1=0.1, odd_1=0.0, span_um=10.0)
    >>> block.run([-10.0, 0.0, 5.0], 1e-3).tolist()
    [-9.0, 0.0, 5.25]
    """

    name = "unknown"
    on_request = True
    equation = "y = y_h + Y (E(|s|) + sgn(s) O(|s|) + c S(s)), s = (y_h - A u_c) / Y, E and O quadratic splines, S a smooth step"
    source = "A Hammerstein or Wiener block in the chain; no effect is claimed."
    signature = (
        "An error that follows from the command and that no effect of the catalogue explains."
    )
    experiment = "The one that its portrait asks for."
    mistaken_for = ()


# Place and drive of a block: the forms are their combinations.
_PLACES: tuple[tuple[type[Block], str, str], ...] = (
    (Behind, "added behind the hysteresis", "y = y_h + Y z, s = (y_h - A u_c) / Y"),
    (In, "that changes the weights of the plays", "y = a_0 u + (1 + z) (y_h - a_0 u), s = (u - u_c) / U"),
    (Before, "added to the command", "u' = u + U z, s = (u - u_c) / U"),
    (Beside, "of the command, added to the displacement", "y = y_h + A U z, s = (u - u_c) / U"),
)  # fmt: skip
_DRIVES: tuple[tuple[type[Block], str, str, str], ...] = (
    (OfTheRate, "of the rate", "A function of the rate", "z = c_1 |r| + c_2 r |r| + c_3 s r, r the rate of s"),
    (Static, "static", "A curve", "z = E(|s|) + sgn(s) O(|s|) + c S(s), E and O quadratic splines, S a smooth step"),
    (
        WithMemory, "with memory", "A first-order lag",
        "τ dz/dt + z = c_1 s + c_2 |s| + c_3 s² + c_4 s |s| + c_5 S(s) + c_6 |r|, r the rate of s",
    ),
    (
        WithTwoMemories, "with two memories", "Two first-order lags",
        "z = z_1 + z_2, τ_k dz_k/dt + z_k = c_1k s + c_2k |s| + c_3k s² + c_4k s |s| + c_5k S(s) + c_6k |r|",
    ),
)  # fmt: skip


def _make_forms() -> None:
    """Define every combination of drive and place but that of `Unknown` itself, as its forms."""
    for drive, drive_form, what, driven in _DRIVES:
        for place, where, acts in _PLACES:
            if (drive, place) == (Static, Behind):
                continue
            stated = {
                "__module__": __name__,
                "__doc__": f"{what} {where}.",
                "form": f"{drive_form}, {place.__name__.lower()}",
                "equation": f"{acts}, {driven}",
            }
            name = f"{drive.__name__}{place.__name__}"
            made = new_class(name, (place, drive), {"of": Unknown}, partial(dict.update, **stated))
            globals()[name] = dataclass(frozen=True)(made)  # as a module's own class, for pickle


_make_forms()
