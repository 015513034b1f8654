"""Independent formulations of effects, as the files of this folder declare them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from rdpi_gym.support.arrays import Array
from rdpi_gym.support.plugins import modules_of

Mechanism = Callable[[Array], Array]
"""Takes the samples of one stretch of the fine grid after the other, and remembers the last one."""


@dataclass(frozen=True)
class Grid:
    """The fine grid of a record.

    Parameters
    ----------
    start_s
        Time of its first point on the experiment's clock (s).
    step_s
        Between two points (s).
    """

    start_s: float
    step_s: float


@dataclass(frozen=True)
class Twin:
    """An effect as a mechanism of its own, in front of the ceramic or behind it.

    Parameters
    ----------
    effect
        Its name.
    number
        Its place in the list that random choices are made from: a new effect takes the next number,
        so that a seed goes on meaning what it meant for the others.
    place
        Along the path from the command to the measurement; the ceramic stands at 0.
    make
        ``make(grid, **parameters)`` returns the mechanism.
    """

    effect: str
    number: int
    place: int
    make: Callable[..., Mechanism]


@dataclass(frozen=True)
class MaterialTwin:
    """An effect inside the ceramic.

    Parameters
    ----------
    effect, number
        As :class:`Twin`.
    change
        ``change(**parameters)`` returns fields of :class:`.material.Ceramic`.
    """

    effect: str
    number: int
    change: Callable[..., dict[str, Any]]


@cache
def twins() -> Mapping[str, Twin | MaterialTwin]:
    """Return every effect that the files of this folder state in their ``TWINS``, by number."""
    found: list[Twin | MaterialTwin] = []
    for module in modules_of("rdpi_gym.virtual_lab.independent"):
        found += getattr(module, "TWINS", ())
    return {twin.effect: twin for twin in sorted(found, key=lambda t: (t.number, t.effect))}
