"""The inverse stages by effect and form, read off the files of this folder."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from baselines.inverses.base import Inverse
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.members import Members, classes_of

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
