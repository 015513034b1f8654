"""Unknown: a free block for an error that no effect of the catalogue explains."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from types import new_class
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
    """Whether a weight belongs to an even term."""
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
        """No memory, one drive."""
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
    """Terms of the rate, without memory."""

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
        """One memory, whose drive has the even and the odd term under the names of the splines."""
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


# What stands where a block does, and what drives it: the forms are their combinations.
_PLACES: tuple[tuple[type[Block], tuple[Parameter, ...], str, str], ...] = (
    (Behind, MICROMETRES, "added behind the hysteresis", "y = y_h + Y z, s = (y_h - A u_c) / Y"),
    (In, VOLTS, "that changes the weights of the plays", "y = a_0 u + (1 + z) (y_h - a_0 u), s = (u - u_c) / U"),
    (Before, VOLTS, "added to the command", "u' = u + U z, s = (u - u_c) / U"),
    (Beside, VOLTS, "of the command, added to the displacement", "y = y_h + A U z, s = (u - u_c) / U"),
)  # fmt: skip
_DRIVES: tuple[tuple[type[Block], tuple[Parameter, ...], str, str, str], ...] = (
    (OfTheRate, RATE, "of the rate", "A function of the rate", "z = c_1 |r| + c_2 r |r| + c_3 s r, r the rate of s"),
    (Static, CURVE, "static", "A curve", "z = E(|s|) + sgn(s) O(|s|) + c S(s), E and O quadratic splines, S a smooth step"),
    (
        WithMemory, LAG, "with memory", "A first-order lag",
        "τ dz/dt + z = c_1 s + c_2 |s| + c_3 s² + c_4 s |s| + c_5 S(s) + c_6 |r|, r the rate of s",
    ),
    (
        WithTwoMemories, TWO_LAGS, "with two memories", "Two first-order lags",
        "z = z_1 + z_2, τ_k dz_k/dt + z_k = c_1k s + c_2k |s| + c_3k s² + c_4k s |s| + c_5k S(s) + c_6k |r|",
    ),
)  # fmt: skip


def _make_forms() -> None:
    """Define every combination of drive and place but that of `Unknown` itself, as its forms."""
    for drive, numbers, drive_form, what, driven in _DRIVES:
        for place, scales, where, acts in _PLACES:
            if (drive, place) == (Static, Behind):
                continue
            stated = {
                "__module__": __name__,
                "__doc__": f"{what} {where}.",
                "form": f"{drive_form}, {place.__name__.lower()}",
                "parameters": (*numbers, *scales),
                "equation": f"{acts}, {driven}",
            }
            name = f"{drive.__name__}{place.__name__}"
            made = new_class(name, (place, drive), {"of": Unknown}, partial(dict.update, **stated))
            globals()[name] = dataclass(frozen=True)(made)  # as a module's own class, for pickle


_make_forms()
