"""Unknown: a free block for an error that no effect of the catalogue explains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from rdpi_gym.plant.effects.base import DataScale, Effect, Parameter
from rdpi_gym.plant.effects.unknown_places import (
    MICROMETRES,
    VOLTS,
    Before,
    Behind,
    Beside,
    Block,
    In,
    Terms,
)

_APART = 5.0  # ratio of the time constants of two memories that a fit begins with


def is_even(parameter: str) -> bool:
    """Whether a weight is of an even term, whatever number it bears."""
    return parameter.rstrip("_0123456789") in ("absolute", "even", "speed", "cross")


def weight(name: str, text: str, most: float = 5.0) -> Parameter:
    """Return the parameter of a share that may be of either sign, `most` at most."""
    return Parameter(name, "1", -most, most, (-0.05, 0.05), text, neutral=0.0)


CURVE = (
    *(
        weight(
            f"{parity}_{k}",
            f"share of the {parity} part that begins at {k - 1} / 3 of the span, quadratic from there",
        )
        for parity in ("even", "odd")
        for k in (1, 2, 3)
    ),
    weight("step", "share of a step about the middle"),
)
"""Parameters of a curve."""
RATE = (
    weight("speed", "share of the absolute rate |r|"),
    weight("drag", "share of r |r|"),
    weight("cross", "share of the product s r"),
)
"""Parameters of what the rate does."""


def _lagging(number: str) -> tuple[Parameter, ...]:
    of = f"_{number}" if number else ""
    return (
        weight(f"linear{of}", "share of s"),
        weight(f"absolute{of}", "share of |s|"),
        weight(f"even{of}", "share of s²"),
        weight(f"odd{of}", "share of s |s|"),
        weight(f"step{of}", "share of a step about the middle"),
        # the fastest record is not the one that lasts: a memory sees a small part of its rate
        weight(f"speed{of}", "share of the absolute rate |r|", 1e3),
        Parameter(
            f"time_constant{of}_s", "s", 1e-6, 1e9, (0.1, 10.0), "time constant τ of its lag"
        ),
    )


LAG, TWO_LAGS = _lagging(""), (*_lagging("1"), *_lagging("2"))
"""Parameters of one memory, and of two."""


class AtOnce(Block):
    """Without a memory."""

    def memories(self) -> list[tuple[float, Terms]]:
        """None, and one drive."""
        return [(0.0, self.values)]


@dataclass(frozen=True)
class Static(AtOnce):
    """A curve: an even and an odd quadratic spline, and a step."""

    even_1: float = 0.02
    even_2: float = 0.0
    even_3: float = 0.0
    odd_1: float = 0.02
    odd_2: float = 0.0
    odd_3: float = 0.0
    step: float = 0.0


@dataclass(frozen=True)
class OfTheRate(AtOnce):
    """What the rate does at once."""

    speed: float = 0.02
    drag: float = 0.02
    cross: float = 0.0


@dataclass(frozen=True)
class WithMemory(Block):
    """A lag of a sum of terms."""

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
class WithTwoMemories(Block):
    """Two of them, side by side."""

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
        if not isinstance(simpler, WithMemory):
            return cls.starts(scale)
        *weights, tau = (simpler.values[p.name] for p in LAG)
        names = [p.name.removesuffix("_1") for p in TWO_LAGS[: len(weights)]]
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
    parameters = (*CURVE, *MICROMETRES)
    equation = "y = y_h + Y (E(|s|) + sgn(s) O(|s|) + c S(s)), s = (y_h - A u_c) / Y, E and O quadratic splines, S a smooth step"
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
_CURVED = "z = E(|s|) + sgn(s) O(|s|) + c S(s), E and O quadratic splines, S a smooth step"
_OF_THE_RATE = "z = c_1 |r| + c_2 r |r| + c_3 s r, r the rate of s"
_LAGS = "τ dz/dt + z = c_1 s + c_2 |s| + c_3 s² + c_4 s |s| + c_5 S(s) + c_6 |r|, r the rate of s"
_LAGS_TWICE = "z = z_1 + z_2, τ_k dz_k/dt + z_k = c_1k s + c_2k |s| + c_3k s² + c_4k s |s| + c_5k S(s) + c_6k |r|"


@dataclass(frozen=True)
class RateBehind(Behind, OfTheRate, of=Unknown):
    """What the rate adds behind the hysteresis."""

    form = "of the rate, behind"
    parameters = (*RATE, *MICROMETRES)
    equation = f"{_BEHIND}, {_OF_THE_RATE}"


@dataclass(frozen=True)
class RateIn(In, OfTheRate, of=Unknown):
    """Weights of the plays that change with the rate."""

    form = "of the rate, in"
    parameters = (*RATE, *VOLTS)
    equation = f"{_WITHIN}, {_OF_THE_RATE}"


@dataclass(frozen=True)
class RateBefore(Before, OfTheRate, of=Unknown):
    """What the rate adds to the command."""

    form = "of the rate, before"
    parameters = (*RATE, *VOLTS)
    equation = f"{_IN_FRONT}, {_OF_THE_RATE}"


@dataclass(frozen=True)
class RateBeside(Beside, OfTheRate, of=Unknown):
    """What the rate of the command adds to the displacement."""

    form = "of the rate, beside"
    parameters = (*RATE, *VOLTS)
    equation = f"{_PARALLEL}, {_OF_THE_RATE}"


@dataclass(frozen=True)
class StaticIn(In, Static, of=Unknown):
    """Weights of the plays along a curve of the command."""

    form = "static, in"
    parameters = (*CURVE, *VOLTS)
    equation = f"{_WITHIN}, {_CURVED}"


@dataclass(frozen=True)
class StaticBefore(Before, Static, of=Unknown):
    """A curve of the command before the hysteresis."""

    form = "static, before"
    parameters = (*CURVE, *VOLTS)
    equation = f"{_IN_FRONT}, {_CURVED}"


@dataclass(frozen=True)
class StaticBeside(Beside, Static, of=Unknown):
    """A curve of the command that is added to the displacement."""

    form = "static, beside"
    parameters = (*CURVE, *VOLTS)
    equation = f"{_PARALLEL}, {_CURVED}"


@dataclass(frozen=True)
class MemoryBehind(Behind, WithMemory, of=Unknown):
    """A leaky memory of the displacement, of its size and of its speed, behind the hysteresis."""

    form = "with memory, behind"
    parameters = (*LAG, *MICROMETRES)
    equation = f"{_BEHIND}, {_LAGS}"


@dataclass(frozen=True)
class MemoryIn(In, WithMemory, of=Unknown):
    """Weights of the plays that follow a leaky memory of the command, of its size and its speed."""

    form = "with memory, in"
    parameters = (*LAG, *VOLTS)
    equation = f"{_WITHIN}, {_LAGS}"


@dataclass(frozen=True)
class MemoryBefore(Before, WithMemory, of=Unknown):
    """A leaky memory of the command, of its size and of its speed, before the hysteresis."""

    form = "with memory, before"
    parameters = (*LAG, *VOLTS)
    equation = f"{_IN_FRONT}, {_LAGS}"


@dataclass(frozen=True)
class MemoryBeside(Beside, WithMemory, of=Unknown):
    """A leaky memory of the command that is added to the displacement."""

    form = "with memory, beside"
    parameters = (*LAG, *VOLTS)
    equation = f"{_PARALLEL}, {_LAGS}"


@dataclass(frozen=True)
class MemoriesBehind(Behind, WithTwoMemories, of=Unknown):
    """Two leaky memories behind the hysteresis."""

    form = "with two memories, behind"
    parameters = (*TWO_LAGS, *MICROMETRES)
    equation = f"{_BEHIND}, {_LAGS_TWICE}"


@dataclass(frozen=True)
class MemoriesIn(In, WithTwoMemories, of=Unknown):
    """Weights of the plays that follow two leaky memories."""

    form = "with two memories, in"
    parameters = (*TWO_LAGS, *VOLTS)
    equation = f"{_WITHIN}, {_LAGS_TWICE}"


@dataclass(frozen=True)
class MemoriesBefore(Before, WithTwoMemories, of=Unknown):
    """Two leaky memories before the hysteresis."""

    form = "with two memories, before"
    parameters = (*TWO_LAGS, *VOLTS)
    equation = f"{_IN_FRONT}, {_LAGS_TWICE}"


@dataclass(frozen=True)
class MemoriesBeside(Beside, WithTwoMemories, of=Unknown):
    """Two leaky memories of the command that are added to the displacement."""

    form = "with two memories, beside"
    parameters = (*TWO_LAGS, *VOLTS)
    equation = f"{_PARALLEL}, {_LAGS_TWICE}"
