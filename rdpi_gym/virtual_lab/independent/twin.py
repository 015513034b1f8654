"""Independent formulations of effects, as the files of this folder declare them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

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


def carried(start: Callable[[Array], Array], step: Callable[[Array, Array], Array]) -> Mechanism:
    """Mechanism with a state: ``start(x)`` of the first samples, changed in place by ``step(x, state)``."""
    state: list[Array] = []

    def run(x: Array) -> Array:
        if not state:
            state.append(start(x))
        return np.asarray(step(x, state[0]))

    return run


def times(grid: Grid) -> Mechanism:
    """Clock: the times (s) of the samples that it is given, one stretch after the other."""

    def advance(x: Array, begin: Array) -> Array:
        begin += len(x)
        indices = np.arange(begin[0] - len(x), begin[0])
        return np.asarray(grid.start_s + indices * grid.step_s, dtype=np.float64)

    return carried(lambda x: np.zeros(1, dtype=np.int64), advance)


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
