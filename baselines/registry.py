"""The controllers of this package by name: the closed list, read off the files of this folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property, partial
from typing import Any, TypeAlias

from baselines.base import Baseline
from baselines.feedforward import Feedforward
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.plugins import Members
from rdpi_gym.support.words import guess, quoted, some

BaselineFactory: TypeAlias = Callable[[PlantModel, ObservationLayout], Baseline]

_PACKAGE = __name__.rpartition(".")[0]


def _is_named(kind: type[Baseline]) -> bool:
    """Whether a class states a name of its own, which one that is derived from it does not inherit."""
    return "name" in vars(kind)


class Controllers(Mapping[str, BaselineFactory]):
    """Factories of the controllers of this package by name, called with (belief, layout).

    Every class in a file of this folder that states a ``name``, and ``<name>-<feedforward>`` for
    those that are made on feedforwards; the files are read when one is asked for. Aliases are found
    and not listed, so that no table has a controller twice.

    Examples
    --------
    >>> "pi-classical-static" in CONTROLLERS, "full-preview-inversion" in CONTROLLERS
    (True, False)
    >>> CONTROLLERS["adaptive-play-weights"].name, "adaptive-play-weights" in list(CONTROLLERS)
    ('adaptive-inverse', False)
    """

    @cached_property
    def _found(self) -> dict[str, BaselineFactory]:
        found: dict[str, BaselineFactory] = dict(FEEDFORWARDS)
        kinds = Members(_PACKAGE, Baseline, counts=_is_named)  # type: ignore[type-abstract]
        for name, kind in kinds.items():
            found.setdefault(name, kind)
            if kind.on_feedforwards:
                make: Callable[..., Baseline] = kind
                for under, feedforward in FEEDFORWARDS.items():
                    found[f"{name}-{under}"] = partial(make, feedforward=feedforward)
        return found

    @cached_property
    def _aliases(self) -> dict[str, str]:
        kinds = ((name, vars(make)) for name, make in self._found.items() if isinstance(make, type))
        return {alias: name for name, own in kinds for alias in own.get("aliases", ())}

    def __getitem__(self, name: str) -> BaselineFactory:
        return self._found[self._aliases.get(name, name)]

    def __iter__(self) -> Iterator[str]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)


FEEDFORWARDS: Mapping[str, type[Feedforward]] = Members(_PACKAGE, Feedforward, counts=_is_named)  # type: ignore[type-abstract]
"""Every feedforward of this package by its name."""
CONTROLLERS: Mapping[str, BaselineFactory] = Controllers()
"""Every controller of this package by its name."""


def known_controller(name: object) -> BaselineFactory:
    """Return what makes one of this package's controllers: the closed list for names out of files.

    Nothing is imported for a name, so a file cannot run code by naming a module.

    Parameters
    ----------
    name
        A key of :data:`CONTROLLERS`.

    Raises
    ------
    InputError
        It is none; ``module:attribute``, ``learned:`` and the names of installed packages are not
        taken here.

    Examples
    --------
    >>> known_controller("pi").__name__
    'PI'
    >>> known_controller("os:system")
    Traceback (most recent call last):
    ...
    rdpi_gym.support.errors.InputError: 'os:system' is no controller of this package; known are ...
    """
    if not isinstance(name, str) or name not in CONTROLLERS:
        close = guess(name, CONTROLLERS) if isinstance(name, str) else ""
        raise InputError(
            f"{quoted(name)} is no controller of this package; {close and close + ' '}known are {some(CONTROLLERS)}"
        )
    return CONTROLLERS[name]


def inverts_effects(name: str) -> bool:
    """Whether a controller of this package makes use of its belief's effects.

    On a belief without effects such a one is the double of another.

    Examples
    --------
    >>> inverts_effects("pi-extended-inverse"), inverts_effects("pi-classical-static")
    (True, False)
    """
    return _states(name, "inverts_effects")


def inverts_any_core(name: str) -> bool:
    """Whether a controller of this package inverts any hysteresis core.

    On a belief with the RDPI model such a one is the double of another.

    Examples
    --------
    >>> inverts_any_core("pi-core-inverse"), inverts_any_core("pi-classical-static")
    (True, False)
    """
    return _states(name, "any_core")


def needed_core(name: str) -> type[Core] | None:
    """Return the kind of hysteresis core that a controller of this package needs in its belief.

    None: any will do, as for a controller that is not of this package.

    Examples
    --------
    >>> needed_core("pi-classical-static").__name__, needed_core("pi"), needed_core("core-inverse")
    ('RDPI', None, None)
    """
    needed = (getattr(kind, "needs_core", None) for kind in _kinds(name))
    return next((kind for kind in needed if kind is not None), None)


def _states(name: str, attribute: str) -> bool:
    return any(getattr(kind, attribute, False) for kind in _kinds(name))


def _kinds(name: str) -> list[Any]:
    factory = CONTROLLERS.get(name)
    if isinstance(factory, partial):
        return [factory.func, *factory.keywords.values()]
    return [factory]
