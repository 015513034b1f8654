"""What roundings do to a program, and how far it may therefore be from Python."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rdpi_gym.firmware.writing.source import Source
from rdpi_gym.firmware.writing.vectors import Vectors, unit_of

ALLOWED: Mapping[int, float] = {64: 1e-13, 32: 1e-5, 31: 1e-6}
"""Largest difference from Python, in strokes or ranges of the command, by precision."""
ROUGH = 100.0
"""From which growth on it is said."""
_EPSILON = {64: 2.0**-53, 32: 2.0**-24, 31: 2.0**-32}
_SEED = 15
_MOST = 100.0


@dataclass(frozen=True)
class Roundings:
    """How much larger differences of answers are than those of the inputs' last bits.

    A loop outside its stability limit, and what estimates online, make much of every rounding; no two
    ways of computing agree there, and none is nearer to the truth.

    Parameters
    ----------
    fine, coarse
        In strokes or ranges of the command over the relative difference of the inputs: of the last bit
        in double, and in single where Python itself has numbers of single precision, else 0.
    single
        Whether it has.

    Examples
    --------
    >>> Roundings(3.0).allowed == ALLOWED, Roundings(1e5).allowed[32]
    (True, 0.596...)
    """

    fine: float = 1.0
    coarse: float = 0.0
    single: bool = False

    @classmethod
    def of(cls, source: Source, made: Vectors) -> Roundings:
        """Try it on signals that Python answered."""
        fine = _growth(source, made, _EPSILON[64])
        if not source.is_single:
            return cls(fine)
        return cls(fine, _growth(source, made, _EPSILON[32]), True)

    def __or__(self, other: Roundings) -> Roundings:
        """The worse of both."""
        fine, coarse = max(self.fine, other.fine), max(self.coarse, other.coarse)
        return Roundings(fine, coarse, self.single or other.single)

    @property
    def growth(self) -> float:
        """The larger one."""
        return max(self.fine, self.coarse)

    @property
    def usual(self) -> dict[int, float]:
        """What is allowed where roundings do not grow, by precision."""
        return {**ALLOWED, 64: ALLOWED[32]} if self.single else dict(ALLOWED)

    @property
    def allowed(self) -> dict[int, float]:
        """The largest difference from Python that is a matter of rounding, by precision."""
        growth = dict.fromkeys(ALLOWED, self.growth)
        epsilon = dict(_EPSILON)
        if self.single:
            growth[64], epsilon[64] = self.coarse, _EPSILON[32]
        return {
            p: min(max(each, _margin(growth[p]) * epsilon[p]), 1.0)
            for p, each in self.usual.items()
        }

    @property
    def warning(self) -> str | None:
        """One line where they grow, else None."""
        if not self.growth > ROUGH:
            return None
        return (
            f"It makes {self.growth:.0e} times as much of every rounding, being outside its stability limit or "
            "estimating as it runs: no two ways of computing agree to the last digits."
        )


def _margin(growth: float) -> float:
    """What one try of roundings says of others: the more they grow, the less."""
    return growth * min(growth, _MOST)


def _growth(source: Source, made: Vectors, bit: float) -> float:
    rng = np.random.default_rng(_SEED)
    inputs = [x * (1.0 + bit * rng.uniform(-1.0, 1.0, x.shape)) for x in made.inputs.values()]
    twin = source.program.twin
    found = twin.plant(*inputs) if source.program.kind == "plant" else twin.controller(*inputs)
    return float(np.abs(found - made.expected).max() / unit_of(source, made) / bit)
