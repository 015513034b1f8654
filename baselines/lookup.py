"""From a typed name to a controller: this package's, an installed one, a trained one, a user's own."""

from __future__ import annotations

from baselines.preview import FULL_PREVIEW
from baselines.registry import CONTROLLERS
from rdpi_gym.envs.controller import GROUP, Controller, ControllerFactory
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.plugins import installed, installed_names, load_attribute
from rdpi_gym.support.words import guess

LEARNED = "learned:"
"""Prefix of the name of a trained policy; its folder, or its name if it is shipped, follows."""
GUARDED = "guarded:"
"""The same with a monitor beside it, which hands over to a controller with a certificate."""


def make_controller(
    name: str | ControllerFactory, belief: PlantModel, layout: ObservationLayout
) -> Controller:
    """Make a controller by a name that a user typed, or by what makes it.

    Names that stand in a file go through :func:`baselines.known_controller` instead.

    Parameters
    ----------
    name
        A name of :data:`~baselines.CONTROLLERS`; one that an installed package states in the
        entry-point group ``rdpi_gym.controllers``; ``learned:`` and the folder of a trained policy
        or the name of a shipped one, ``guarded:`` for one with a monitor; or ``module:attribute``. The
        last two kinds of code are
        callables that take a belief and a layout and return a controller, and such a callable may be
        given itself.
    belief
        What the controller knows of the plant.
    layout
        What an observation shows, and how an action is read.

    Raises
    ------
    InputError
        The name is unknown, what it names makes no controller, the layout reads actions as
        corrections, or a policy cannot be read.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P10")
    >>> layout = ObservationLayout.for_plant(plant, ts_s=1e-3)
    >>> type(make_controller("pi-classical-static", plant, layout)).__name__
    'PI'
    >>> make_controller("clasical-static", plant, layout)
    Traceback (most recent call last):
    ...
    rdpi_gym.support.errors.InputError: no controller is named 'clasical-static'; did you mean 'classical-static'? Known are ...
    """
    if not isinstance(name, str):
        return _checked(name(belief, layout), getattr(name, "__name__", type(name).__name__))
    if name in CONTROLLERS:
        return CONTROLLERS[name](belief, layout)
    if name.startswith((LEARNED, GUARDED)):
        return _learned(name, belief, layout)
    factory = find_factory(name)
    return _checked(factory(belief, layout) if callable(factory) else factory, name)


def _checked(made: object, name: str) -> Controller:
    if not isinstance(made, Controller):
        raise InputError(
            f"{name!r} makes a {type(made).__name__} without predict; it should be a callable (belief, layout) that returns a controller"
        )
    return made


def find_factory(name: str) -> object:
    """Return what an installed package or a user's module has under a name; it is not called.

    Raises
    ------
    InputError
        There is nothing of that name, or it cannot be imported.

    Examples
    --------
    >>> find_factory("math:pi")
    3.141592653589793
    """
    if ":" in name:
        return load_attribute(name, "controller")
    found = installed(GROUP, name, "controller")
    if name == FULL_PREVIEW:
        raise InputError(
            f"{FULL_PREVIEW} holds the true plant, so only rdpi bench makes it; preview-inversion inverts what is believed of the plant"
        )
    if found is None:
        known = [*CONTROLLERS, *installed_names(GROUP)]
        meant = guess(name, known)
        hint = f"{meant} " if meant else ""
        raise InputError(
            f"no controller is named {name!r}; {hint}Known are {', '.join(known)}, learned:FOLDER, guarded:FOLDER and module:attribute"
        )
    return found


def policy_of(name: str) -> str | None:
    """Return the folder or the shipped name of a learned controller's policy; None: it is no such one.

    Examples
    --------
    >>> policy_of("learned:results/train/policy"), policy_of("guarded:ppo-increment"), policy_of("pi")
    ('results/train/policy', 'ppo-increment', None)
    """
    prefix = next((each for each in (LEARNED, GUARDED) if name.startswith(each)), None)
    return None if prefix is None else name.removeprefix(prefix)


def _learned(name: str, belief: PlantModel, layout: ObservationLayout) -> Controller:
    try:
        from baselines.learned.controller import (  # torch, only where needed
            controller_of,
            find_learned,
            guarded,
        )
    except ImportError as error:
        raise InputError(
            f"a learned controller needs torch ({error}); install rdpi-gym[rl]"
        ) from error
    make = guarded if name.startswith(GUARDED) else controller_of
    return make(find_learned(policy_of(name) or ""), belief, layout)
