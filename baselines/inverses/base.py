"""Interface of an inverse stage, and the inverse stages by effect and form."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from rdpi_gym.plant import RDPI
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.plugins import Members, classes_of


@dataclass(frozen=True)
class Setting:
    """Plant and sampling time that an inverse may use beside its effect."""

    ts_s: float  # sampling time (s)
    hysteresis: RDPI  # the belief's
    scale_um: float  # unit of displacements (µm); changes far below it are rounding
    rest: float  # input of the effect while the plant rests (V before the plays, µm behind them)


class Inverse(ABC):
    """Finds what must enter an effect for a wanted output; one subclass an effect or a form of it.

    It may look at wanted outputs that are still to come: what it returns belongs to the sample
    `ahead` before the newest that it was given. It holds no memory itself, so that one serves many
    loops in turn.

    Parameters
    ----------
    effect
        The effect to undo.
    setting
        What is known beside it.
    ahead
        Samples to come that it may look at.

    Attributes
    ----------
    effect
        Name of the effect.
    forms
        Its forms that this class undoes; the simplest alone unless stated.
    urgency
        Where the preview is too short for all, the more urgent is served first: what cannot be had
        without it.
    ahead, rows
        Samples that it looks ahead, and rows of its memory.
    """

    effect: ClassVar[str]
    forms: ClassVar[tuple[str, ...]] = ("",)
    urgency: ClassVar[int] = 0
    rows: int = 0

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        self.ahead = min(ahead, self.wanted_ahead(effect, setting.ts_s))

    @classmethod
    def wanted_ahead(cls, effect: Effect, ts_s: float) -> int:
        """Return how many samples to come the inverse makes use of; 0 where it needs none."""
        return 0

    def start(self, y: Array) -> tuple[Array, Array]:
        """Return the memory where an output has been held, and the input that belongs to it.

        Parameters
        ----------
        y
            Output at the sample before the first that :meth:`run` gets, ``(B,)``.

        Returns
        -------
        state : float64[rows, B]
        x : float64[B]
        """
        state = np.empty((0, len(y)))
        return state, self.run(np.ascontiguousarray(y[None]), state)[0]

    @abstractmethod
    def run(self, y: Array, state: Array) -> Array:
        """Return inputs for wanted outputs.

        Parameters
        ----------
        y
            Wanted outputs, ``float64[T, B]``, contiguous.
        state
            Memory, ``float64[rows, B]``, moved on in place.

        Returns
        -------
        float64[T, B]
            Row t is the input `ahead` samples before that of ``y[t]``.
        """


_PACKAGE = "baselines.inverses"


def _of_the_simplest(kind: type[Inverse]) -> bool:
    return "" in kind.forms


INVERSES: Mapping[str, type[Inverse]] = Members(
    _PACKAGE,
    Inverse,  # type: ignore[type-abstract]
    "effect",
    counts=_of_the_simplest,
)
"""Inverse stages of the effects' simplest forms by name: a new one is a new file here."""


@cache
def _by_form() -> dict[tuple[str, str], type[Inverse]]:
    found = [kind for kind in classes_of(_PACKAGE, Inverse) if hasattr(kind, "effect")]  # type: ignore[type-abstract]
    return {(kind.effect, form): kind for kind in found for form in kind.forms}


def inverse_of(effect: Effect | type[Effect]) -> type[Inverse] | None:
    """Return the inverse stage of an effect in this very form; None where there is none.

    An inverse reads its effect's coefficients, and those of another form mean something else.

    Examples
    --------
    >>> from rdpi_gym.plant.effects import load_effect
    >>> drift = load_effect("gain_drift")
    >>> inverse_of(drift) is inverse_of(drift.forms[0])
    True
    >>> inverse_of(load_effect("mains_hum"))
    """
    return _by_form().get((effect.name, effect.form))


def without_inverse(effect: Effect) -> str:
    """Name an effect that is not undone, and what would be where another form of it is."""
    if effect.form and effect.name in INVERSES:
        return f"{effect.full_name()} (the simplest form of {effect.name} has an inverse)"
    return effect.full_name()


# Coefficients below this share of one bend nothing, and their roots would lie at infinity.
_NOTHING = 1e-12


def turns(slope: ArrayLike) -> tuple[float, float]:
    """Return the zeros of 1 + Σ c_k s^k, k = 1, 2, ..., next to s = 0 on either side."""
    c = np.array(slope, dtype=np.float64)
    zeros = np.roots([*np.where(np.abs(c) < _NOTHING, 0.0, c)[::-1], 1.0])
    real = zeros.real[np.abs(zeros.imag) <= 1e-9 * np.abs(zeros)].tolist()
    below, above = ([s for s in real if s < 0.0], [s for s in real if s > 0.0])
    return max(below, default=-math.inf), min(above, default=math.inf)
