"""Unknown: a free block for what no effect of the catalogue is, as records teach it."""

from __future__ import annotations

import math
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

Place = Literal["before", "in", "behind", "beside"]
"""Where a block stands: it changes the command, the weights of the plays, or the displacement, by the
displacement itself or, beside the hysteresis, by the command."""
TERMS = (
    "linear", "absolute", "even_1", "even_2", "even_3", "odd_1", "odd_2", "odd_3", "step", "speed",
    "drag", "cross",
)  # fmt: skip
"""What drives a block, of s and its rate r: s, |s|, the even and the odd quadratic spline with knots
at 0, 1/3 and 2/3, a smooth step at 0, |r|, r |r|, s r."""


def is_even(parameter: str) -> bool:
    """Whether a weight is of an even term, whatever number it bears.

    Examples
    --------
    >>> is_even("even_2"), is_even("odd"), is_even("speed_1")
    (True, False, True)
    """
    return parameter.rstrip("_0123456789") in ("absolute", "even", "speed", "cross")


_POWER = ("weight", "power", "rate_power", "signed", "rate_signed")
_STARTS, _SHORTEST, _LONGEST, _APART = 6, 5.0, 0.3, 5.0
"""Time constants that a fit begins with; the least in samples, the largest in longest records; and the ratio
of two of them."""
_STEEP = 0.1  # of the step, in spans
_HEAD, _MEMORY = 7, 3 + len(TERMS) + 5


@njit(cache=True)
def _static(s: float, p: Array, a: int, b: int) -> float:
    """Terms of s alone, with the parameters from row `a` on."""
    size = abs(s)
    even, odd = 0.0, 0.0
    for k in range(3):
        above = max(size - k / 3.0, 0.0)
        even += p[a + 2 + k, b] * above * above
        odd += p[a + 5 + k, b] * above * above
    value: float = p[a, b] * s + p[a + 1, b] * size + even + (odd if s > 0.0 else -odd)
    if p[a + 8, b] != 0.0:
        value += p[a + 8, b] * math.tanh(s / _STEEP)
    return value


@njit(cache=True)
def _power(s: float, r: float, p: Array, a: int, b: int) -> float:
    """One term with two exponents, with the parameters from row `a` on."""
    if p[a, b] == 0.0:
        return 0.0
    value: float = p[a, b]
    if p[a + 1, b] > 0.0:
        value *= abs(s) ** p[a + 1, b] if s != 0.0 else 0.0
    if p[a + 2, b] > 0.0:
        value *= abs(r) ** p[a + 2, b] if r != 0.0 else 0.0
    if p[a + 3, b] > 0.5 and s < 0.0:
        value = -value
    return -value if p[a + 4, b] > 0.5 and r < 0.0 else value


@njit(cache=True)
def unknown_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel: y = x + (p4 + p5 x + p6 u) Σ_k z_k, where z_k lags behind a sum of terms of s and r.

    s = p0 x + p1 u + p2, and r is p3 times its change from sample to sample. Rows of each memory: F, G0
    and G1 of its lag, the weights of :data:`TERMS`, then w, a, b, o and q of w |s|^a |r|^b, with the
    sign of s where o is 1 and that of r where q is. Rows of the state: s, r, then the drive and z of each memory.
    """
    memories = (p.shape[0] - _HEAD) // _MEMORY
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            s = p[0, b] * x[0, b] + p[1, b] * u[0, b] + p[2, b]
            state[0, b], state[1, b] = s, 0.0
            for k in range(memories):  # at rest
                drive = _static(s, p, _HEAD + _MEMORY * k + 3, b)
                drive += _power(s, 0.0, p, _HEAD + _MEMORY * k + 15, b)
                state[2 + 2 * k, b], state[3 + 2 * k, b] = drive, drive
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            s = p[0, b] * x[t, b] + p[1, b] * u[t, b] + p[2, b]
            r = p[3, b] * (s - state[0, b])
            now = 1.5 * r - 0.5 * state[1, b]
            state[0, b], state[1, b] = s, r
            total = 0.0
            for k in range(memories):
                a = _HEAD + _MEMORY * k
                drive = _static(s, p, a + 3, b)
                # without a lag at the sample itself; a jump is one step for a memory
                rate = r if p[a, b] > 0.0 else now
                drive += p[a + 12, b] * abs(rate) + p[a + 13, b] * rate * abs(rate)
                drive += p[a + 14, b] * s * rate
                drive += _power(s, rate, p, a + 15, b)
                z = p[a, b] * state[3 + 2 * k, b] + p[a + 1, b] * state[2 + 2 * k, b]
                z += p[a + 2, b] * drive
                state[2 + 2 * k, b], state[3 + 2 * k, b] = drive, z
                total += z
            y[t, b] = x[t, b] + (p[4, b] + p[5, b] * x[t, b] + p[6, b] * u[t, b]) * total


def _weight(name: str, text: str, most: float = 5.0) -> Parameter:
    return Parameter(name, "1", -most, most, (-0.05, 0.05), text, neutral=0.0)


_CURVE = (
    *(
        _weight(
            f"{parity}_{k}",
            f"share of the {parity} part that begins at {k - 1} / 3 of the span, quadratic from there",
        )
        for parity in ("even", "odd")
        for k in (1, 2, 3)
    ),
    _weight("step", "share of a step about the middle"),
)
_RATE = (
    _weight("speed", "share of the absolute rate |r|"),
    _weight("drag", "share of r |r|"),
    _weight("cross", "share of the product s r"),
)


def _lagging(number: str) -> tuple[Parameter, ...]:
    of = f"_{number}" if number else ""
    return (
        _weight(f"linear{of}", "share of s"),
        _weight(f"absolute{of}", "share of |s|"),
        _weight(f"even{of}", "share of s²"),
        _weight(f"odd{of}", "share of s |s|"),
        _weight(f"step{of}", "share of a step about the middle"),
        # the fastest record is not the one that lasts: a memory sees a small part of its rate
        _weight(f"speed{of}", "share of the absolute rate |r|", 1e3),
        Parameter(
            f"time_constant{of}_s", "s", 1e-6, 1e9, (0.1, 10.0), "time constant τ of its lag"
        ),
    )


_VOLTS = (
    Parameter("centre_V", "V", -1e9, 1e9, (0.0, 40.0), "command u_c at which s is 0", fixed=True),
    Parameter("span_V", "V", 1e-9, 1e9, (40.0, 40.0), "distance U from there at which s is 1", fixed=True),
    Parameter("rate_V_s", "V/s", 1e-12, 1e12, (1e4, 1e4), "rate at which r is 1", fixed=True),
)  # fmt: skip
_MICROMETRES = (
    Parameter("centre_V", "V", -1e9, 1e9, (0.0, 40.0), "command u_c: s is 0 at A u_c", fixed=True),
    Parameter("span_um", "µm", 1e-9, 1e9, (40.0, 40.0), "distance Y from there at which s is 1", fixed=True),
    Parameter("rate_um_s", "µm/s", 1e-12, 1e12, (1e4, 1e4), "rate at which r is 1", fixed=True),
)  # fmt: skip

Terms = Mapping[str, float]


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
            column += [drive.get(name, 0.0) for name in _POWER]
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


class _AtOnce(Block):
    def memories(self) -> list[tuple[float, Terms]]:
        """None, and one drive."""
        return [(0.0, self.values)]


@dataclass(frozen=True)
class _Static(_AtOnce):
    even_1: float = 0.02
    even_2: float = 0.0
    even_3: float = 0.0
    odd_1: float = 0.02
    odd_2: float = 0.0
    odd_3: float = 0.0
    step: float = 0.0


@dataclass(frozen=True)
class OfTheRate(_AtOnce):
    """What the rate does at once."""

    speed: float = 0.02
    drag: float = 0.02
    cross: float = 0.0


@dataclass(frozen=True)
class _WithMemory(Block):
    linear: float = 0.0
    absolute: float = 0.0
    even: float = 0.02
    odd: float = 0.0
    step: float = 0.0
    speed: float = 0.0
    time_constant_s: float = 1.0

    def memories(self) -> list[tuple[float, Terms]]:
        """One."""
        drive = self.values
        return [(self.time_constant_s, drive | {"even_1": self.even, "odd_1": self.odd})]


@dataclass(frozen=True)
class _WithTwoMemories(Block):
    linear_1: float = 0.0
    absolute_1: float = 0.0
    even_1: float = 0.02
    odd_1: float = 0.0
    step_1: float = 0.0
    speed_1: float = 0.0
    time_constant_1_s: float = 0.3
    linear_2: float = 0.0
    absolute_2: float = 0.0
    even_2: float = 0.02
    odd_2: float = 0.0
    step_2: float = 0.0
    speed_2: float = 0.0
    time_constant_2_s: float = 3.0

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The fitted memory, and one beside it that is faster or slower."""
        if not isinstance(simpler, _WithMemory):
            return cls.starts(scale)
        *weights, tau = (simpler.values[p.name] for p in _LAG)
        names = [p.name.removesuffix("_1") for p in _TWO_LAGS[: len(weights)]]
        none = [0.0] * len(weights)
        return tuple(
            cls.within_bounds(
                **{f"{n}_1": w for n, w in zip(names, first, strict=True)},
                **{f"{n}_2": w for n, w in zip(names, second, strict=True)},
                time_constant_1_s=min(taus),
                time_constant_2_s=max(taus),
                **cls.scales(scale),
            )
            for first, second, taus in (
                (none, weights, (tau / _APART, tau)), (weights, none, (tau, tau * _APART))
            )
        )  # fmt: skip

    def memories(self) -> list[tuple[float, Terms]]:
        """Two."""
        values = self.values
        return [
            (
                values[f"time_constant_{k}_s"],
                {
                    "linear": values[f"linear_{k}"],
                    "absolute": values[f"absolute_{k}"],
                    "even_1": values[f"even_{k}"],
                    "odd_1": values[f"odd_{k}"],
                    "step": values[f"step_{k}"],
                    "speed": values[f"speed_{k}"],
                },
            )
            for k in (1, 2)
        ]


@dataclass(frozen=True)
class _OfTheCommand(Block):
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


class _Before(_OfTheCommand):
    place: ClassVar[Place] = "before"
    slot: ClassVar[Slot] = "input"
    order = 90

    def ends(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Reads the command, and adds U times the sum to it."""
        ends = [self.span_V, 0.0, 0.0]
        return [1.0 / self.span_V, 0.0, self._middle(), self._rate(ts_s), *ends]


class _In(_OfTheCommand):
    place: ClassVar[Place] = "in"
    slot: ClassVar[Slot] = "hysteresis"
    order = 4

    def ends(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Reads the command, and adds the sum times the displacement less a_0 u."""
        ends = [0.0, 1.0, -hysteresis.a0]
        return [0.0, 1.0 / self.span_V, self._middle(), self._rate(ts_s), *ends]


class _Beside(_OfTheCommand):
    place: ClassVar[Place] = "beside"
    slot: ClassVar[Slot] = "output"
    order = 2

    def ends(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Reads the command, and adds A U times the sum to the displacement."""
        ends = [hysteresis.A * self.span_V, 0.0, 0.0]
        return [0.0, 1.0 / self.span_V, self._middle(), self._rate(ts_s), *ends]


@dataclass(frozen=True)
class _Behind(Block):
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


@dataclass(frozen=True)
class Unknown(_Behind, _Static):
    """A curve behind the hysteresis, of which nothing is known but what records teach.

    Examples
    --------
    >>> block = Unknown(0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, centre_V=0.0, span_um=10.0)
    >>> block.run([-10.0, 0.0, 5.0], 1e-3).tolist()
    [-9.0, 0.0, 5.25]
    """

    name = "unknown"
    on_request = True
    parameters = (*_CURVE, *_MICROMETRES)
    equation = "y = y_h + Y (E(|s|) + sgn(s) O(|s|) + c tanh(10 s)), s = (y_h - A u_c) / Y, E and O quadratic splines"
    source = "A Hammerstein or Wiener block in the chain; no effect is claimed."
    signature = (
        "An error that follows from the command and that no effect of the catalogue explains."
    )
    experiment = "The one that its portrait asks for."
    mistaken_for = ()


_IN_FRONT = "u' = u + U z, s = (u - u_c) / U"
_WITHIN = "y = a_0 u + (1 + z) (y_h - a_0 u), s = (u - u_c) / U"
_PARALLEL = "y = y_h + A U z, s = (u - u_c) / U"
_BEHIND = "y = y_h + Y z, s = (y_h - A u_c) / Y"
_CURVED = "z = E(|s|) + sgn(s) O(|s|) + c tanh(10 s), E and O quadratic splines"
_OF_THE_RATE = "z = c_1 |r| + c_2 r |r| + c_3 s r, r the rate of s"
_LAGS = (
    "τ dz/dt + z = c_1 s + c_2 |s| + c_3 s² + c_4 s |s| + c_5 tanh(10 s) + c_6 |r|, r the rate of s"
)
_LAGS_TWICE = "z = z_1 + z_2, τ_k dz_k/dt + z_k = c_1k s + c_2k |s| + c_3k s² + c_4k s |s| + c_5k tanh(10 s) + c_6k |r|"
_LAG, _TWO_LAGS = _lagging(""), (*_lagging("1"), *_lagging("2"))


@dataclass(frozen=True)
class RateBehind(_Behind, OfTheRate, of=Unknown):
    """What the rate adds behind the hysteresis."""

    form = "of the rate, behind"
    parameters = (*_RATE, *_MICROMETRES)
    equation = f"{_BEHIND}, {_OF_THE_RATE}"


@dataclass(frozen=True)
class RateIn(_In, OfTheRate, of=Unknown):
    """Weights of the plays that change with the rate."""

    form = "of the rate, in"
    parameters = (*_RATE, *_VOLTS)
    equation = f"{_WITHIN}, {_OF_THE_RATE}"


@dataclass(frozen=True)
class RateBefore(_Before, OfTheRate, of=Unknown):
    """What the rate adds to the command."""

    form = "of the rate, before"
    parameters = (*_RATE, *_VOLTS)
    equation = f"{_IN_FRONT}, {_OF_THE_RATE}"


@dataclass(frozen=True)
class RateBeside(_Beside, OfTheRate, of=Unknown):
    """What the rate of the command adds to the displacement."""

    form = "of the rate, beside"
    parameters = (*_RATE, *_VOLTS)
    equation = f"{_PARALLEL}, {_OF_THE_RATE}"


@dataclass(frozen=True)
class StaticIn(_In, _Static, of=Unknown):
    """Weights of the plays along a curve of the command."""

    form = "static, in"
    parameters = (*_CURVE, *_VOLTS)
    equation = f"{_WITHIN}, {_CURVED}"


@dataclass(frozen=True)
class StaticBefore(_Before, _Static, of=Unknown):
    """A curve of the command before the hysteresis."""

    form = "static, before"
    parameters = (*_CURVE, *_VOLTS)
    equation = f"{_IN_FRONT}, {_CURVED}"


@dataclass(frozen=True)
class StaticBeside(_Beside, _Static, of=Unknown):
    """A curve of the command that is added to the displacement."""

    form = "static, beside"
    parameters = (*_CURVE, *_VOLTS)
    equation = f"{_PARALLEL}, {_CURVED}"


@dataclass(frozen=True)
class MemoryBehind(_Behind, _WithMemory, of=Unknown):
    """A leaky memory of the displacement, of its size and of its speed, behind the hysteresis."""

    form = "with memory, behind"
    parameters = (*_LAG, *_MICROMETRES)
    equation = f"{_BEHIND}, {_LAGS}"


@dataclass(frozen=True)
class MemoryIn(_In, _WithMemory, of=Unknown):
    """Weights of the plays that follow a leaky memory of the command, of its size and its speed."""

    form = "with memory, in"
    parameters = (*_LAG, *_VOLTS)
    equation = f"{_WITHIN}, {_LAGS}"


@dataclass(frozen=True)
class MemoryBefore(_Before, _WithMemory, of=Unknown):
    """A leaky memory of the command, of its size and of its speed, before the hysteresis."""

    form = "with memory, before"
    parameters = (*_LAG, *_VOLTS)
    equation = f"{_IN_FRONT}, {_LAGS}"


@dataclass(frozen=True)
class MemoryBeside(_Beside, _WithMemory, of=Unknown):
    """A leaky memory of the command that is added to the displacement."""

    form = "with memory, beside"
    parameters = (*_LAG, *_VOLTS)
    equation = f"{_PARALLEL}, {_LAGS}"


@dataclass(frozen=True)
class MemoriesBehind(_Behind, _WithTwoMemories, of=Unknown):
    """Two leaky memories behind the hysteresis."""

    form = "with two memories, behind"
    parameters = (*_TWO_LAGS, *_MICROMETRES)
    equation = f"{_BEHIND}, {_LAGS_TWICE}"


@dataclass(frozen=True)
class MemoriesIn(_In, _WithTwoMemories, of=Unknown):
    """Weights of the plays that follow two leaky memories."""

    form = "with two memories, in"
    parameters = (*_TWO_LAGS, *_VOLTS)
    equation = f"{_WITHIN}, {_LAGS_TWICE}"


@dataclass(frozen=True)
class MemoriesBefore(_Before, _WithTwoMemories, of=Unknown):
    """Two leaky memories before the hysteresis."""

    form = "with two memories, before"
    parameters = (*_TWO_LAGS, *_VOLTS)
    equation = f"{_IN_FRONT}, {_LAGS_TWICE}"


@dataclass(frozen=True)
class MemoriesBeside(_Beside, _WithTwoMemories, of=Unknown):
    """Two leaky memories of the command that are added to the displacement."""

    form = "with two memories, beside"
    parameters = (*_TWO_LAGS, *_VOLTS)
    equation = f"{_PARALLEL}, {_LAGS_TWICE}"


_POWERS = (
    _weight("weight", "share w"),
    Parameter("power", "1", 0.0, 8.0, (1.0, 3.0), "exponent a of |s|"),
    Parameter("rate_power", "1", 0.0, 4.0, (0.0, 2.0), "exponent b of |r|"),
    Parameter("time_constant_s", "s", 1e-6, 1e9, (0.1, 10.0), "time constant τ of its lag"),
    Parameter("signed", "1", 0.0, 1.0, (0.0, 1.0), "whether it has the sign of s", fixed=True),
    Parameter("rate_signed", "1", 0.0, 1.0, (0.0, 1.0), "whether it has the sign of r", fixed=True),
)


@dataclass(frozen=True)
class PowerLaw(Block):
    """One term w |s|^a |r|^b, lagging: it tells exponents, and is no form of the block."""

    weight: float = 0.02
    power: float = 2.0
    rate_power: float = 0.0
    time_constant_s: float = 1.0
    signed: float = 0.0
    rate_signed: float = 0.0

    name = "unknown"
    form = "power law"
    on_request = True
    equation = "τ dz/dt + z = ±w |s|^a |r|^b, r the rate of s"
    source, signature, experiment = Unknown.source, Unknown.signature, Unknown.experiment
    mistaken_for = ()

    def memories(self) -> list[tuple[float, Terms]]:
        """One."""
        return [(self.time_constant_s, self.values)]


@dataclass(frozen=True)
class _PowerBefore(_Before, PowerLaw):
    parameters = (*_POWERS, *_VOLTS)


@dataclass(frozen=True)
class _PowerIn(_In, PowerLaw):
    parameters = (*_POWERS, *_VOLTS)


@dataclass(frozen=True)
class _PowerBeside(_Beside, PowerLaw):
    parameters = (*_POWERS, *_VOLTS)


@dataclass(frozen=True)
class _PowerBehind(_Behind, PowerLaw):
    parameters = (*_POWERS, *_MICROMETRES)


POWER_LAWS: Mapping[Place, type[PowerLaw]] = {
    "before": _PowerBefore,
    "in": _PowerIn,
    "behind": _PowerBehind,
    "beside": _PowerBeside,
}
"""Power laws by their place."""
