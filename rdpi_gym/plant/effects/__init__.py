"""Physical effects as stages of the plant, one a file, and their catalogue by name.

A file holds the simplest form of its effect and, below it, further forms with more parameters.
A new effect is one new file in this folder; one of another project is found by an entry point of
the group ``rdpi_gym.effects`` or named as ``module:Class``.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
from collections.abc import Iterator, Mapping
from functools import cached_property
from importlib.metadata import entry_points

from rdpi_gym.plant.cores.rdpi import RDPI
from rdpi_gym.plant.effects.base import (
    SLOTS,
    Block,
    DataScale,
    Effect,
    Look,
    Parameter,
    Picture,
    Slot,
    effect_from_dict,
    form_named,
    forms_of,
)
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.plugins import Members, load_attribute
from rdpi_gym.support.words import quoted

__all__ = [
    "CATALOGUE",
    "SLOTS",
    "Block",
    "DataScale",
    "Effect",
    "Look",
    "Parameter",
    "Picture",
    "Slot",
    "check_effect",
    "effect_from_dict",
    "forms_of",
    "load_effect",
]

ENTRY_POINTS = "rdpi_gym.effects"
"""Group in which another project's package names its effects."""


class Catalogue(Mapping[str, type[Effect]]):
    """Effects by name, in the chain's order; those on request are found but not listed.

    Nothing is imported before an effect is asked for, and other projects' packages are looked
    through only for a name that is not found here, or when all names are listed.

    Raises
    ------
    InputError
        On listing: an installed effect that cannot be used, or that has the name of another.

    Examples
    --------
    >>> CATALOGUE["backlash"].equation
    'y(k) = max(y_m(k) - w, min(y_m(k) + w, y(k-1)))'
    """

    @cached_property
    def _own(self) -> Mapping[str, type[Effect]]:
        return Members(__name__, Effect, order=_place, counts=_is_simplest)  # type: ignore[type-abstract]

    @cached_property
    def _all(self) -> dict[str, type[Effect]]:
        found = dict(self._own)
        for entry in entry_points(group=ENTRY_POINTS):
            source = f"installed effect {entry.name!r} ({entry.value})"
            try:
                kind = check_effect(entry.load(), source)
            except (ImportError, AttributeError) as error:
                raise InputError(
                    f"{source} cannot be imported ({error}); repair or uninstall its package"
                ) from error
            if found.setdefault(kind.name, kind) is not kind:
                raise InputError(
                    f"{source} is named {kind.name!r}, as another effect is; rename it"
                )
        return dict(sorted(found.items(), key=lambda item: _place(item[1])))

    @property
    def _listed(self) -> list[str]:
        return [name for name, kind in self._all.items() if not kind.on_request]

    def __getitem__(self, name: str) -> type[Effect]:
        return self._own[name] if name in self._own else self._all[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._listed)

    def __len__(self) -> int:
        return len(self._listed)


CATALOGUE: Mapping[str, type[Effect]] = Catalogue()
"""Every effect by its name, in the chain's order."""


def _is_simplest(kind: type[Effect]) -> bool:
    return not kind.form


def _place(kind: type[Effect]) -> tuple[int, int, str]:
    return SLOTS.index(kind.slot), kind.order, kind.name


def load_effect(name: str, form: str = "") -> type[Effect]:
    """Find an effect by its name, or a user's own by ``module:Class``.

    Parameters
    ----------
    name
        For example ``creep``, or ``my_effects:Wobble`` in the current folder or on Python's path.
    form
        For example ``two time constants``; the simplest by default.

    Raises
    ------
    InputError
        No effect or form has that name, the module cannot be imported, or what it holds is no effect.

    Examples
    --------
    >>> load_effect("creep")().values
    {'gain_per_decade': 0.015}
    >>> load_effect("slew_limit", "unlike up and down")().values
    {'up_V_s': 10000.0, 'down_V_s': 10000.0}
    >>> load_effect("math:pi")
    Traceback (most recent call last):
    ...
    rdpi_gym.support.errors.InputError: effect 'math:pi' is a float; ...
    """
    if ":" in name:
        own = check_effect(load_attribute(name, "effect"), f"effect {name!r}")
        return form_named(own, form, f"effect {name!r}") if form else own
    if name not in CATALOGUE:
        raise InputError(
            f"no effect is named {quoted(name)}; known are {', '.join(CATALOGUE)}, "
            "and module:Class is one of your own"
        )
    return form_named(CATALOGUE[name], form, f"effect {name}") if form else CATALOGUE[name]


def check_effect(kind: object, source: str) -> type[Effect]:
    """Return a class that declares all that an effect must, in each of its forms, or refuse it.

    Parameters
    ----------
    kind
        The class.
    source
        Named in errors.

    Raises
    ------
    InputError
        With what is missing or wrong, and what would be right.

    Examples
    --------
    >>> check_effect(CATALOGUE["creep"], "creep").__name__
    'Creep'
    """
    if not (isinstance(kind, type) and issubclass(kind, Effect)):
        found = kind.__name__ if isinstance(kind, type) else f"a {type(kind).__name__}"
        raise InputError(
            f"{source} is {found}; an effect is a subclass of rdpi_gym.plant.effects.Effect"
        )
    if inspect.isabstract(kind):
        raise InputError(f"{source} lacks {', '.join(sorted(kind.__abstractmethods__))}")
    # Annotations of this package are strings.
    declared = [key for key, of in Effect.__annotations__.items() if str(of).startswith("ClassVar")]
    missing = [key for key in declared if not hasattr(kind, key)]
    if missing:
        raise InputError(f"{source} does not state {', '.join(missing)}")
    if kind.slot not in SLOTS:
        raise InputError(f"{source} has slot {kind.slot!r}; slots are {', '.join(SLOTS)}")
    names, stated = [f.name for f in dataclasses.fields(kind)], [p.name for p in kind.parameters]
    if names != stated:
        raise InputError(
            f"{source} has the fields {names} and states the parameters {stated}; they are the same "
            "in the same order (decorate the class with @dataclass(frozen=True))"
        )
    try:
        column = kind().coefficients(1e-4, RDPI((1.0, 0.5), (1.0,), 0.0))
    except TypeError as error:
        raise InputError(f"{source} cannot be made with its defaults ({error})") from error
    except InputError as error:
        raise InputError(f"{source} has a default outside its bounds: {error}") from error
    if not all(isinstance(value, int | float) and math.isfinite(value) for value in column):
        raise InputError(f"{source} has coefficients {column}; they are finite numbers")
    if not callable(kind.block):
        raise InputError(f"{source} has a block that is no kernel; state staticmethod(kernel)")
    for form in kind.forms:
        check_effect(form, f"{source}, form {form.form!r}")
    forms = [(form.name, form.form) for form in kind.forms]
    if len({(kind.name, ""), *forms}) <= len(forms) or {name for name, _ in forms} - {kind.name}:
        listed = ", ".join(f"{form!r} of {name}" for name, form in forms)
        raise InputError(
            f"{source} has the forms {listed}; each has the name {kind.name!r} and a form of its own"
        )
    return kind
