"""What drives a free block: a curve, the rate, or memories of both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from rdpi_gym.plant.effects.base import DataScale, Effect, Parameter
from rdpi_gym.plant.effects.unknown_places import Block, Terms

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
