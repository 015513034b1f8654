"""Controllers by name."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import TypeAlias, cast

from baselines.base import Controller
from baselines.feedforwards import FEEDFORWARDS
from baselines.pi import PI
from baselines.preview_oracle import PreviewOracle
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.plugins import load_attribute

ControllerFactory: TypeAlias = Callable[[PlantModel, ObservationLayout], Controller]

CONTROLLERS: Mapping[str, ControllerFactory] = MappingProxyType(
    {
        **FEEDFORWARDS,
        "pi": PI,
        **{f"pi-{name}": partial(PI, feedforward=each) for name, each in FEEDFORWARDS.items()},
        "preview-oracle": PreviewOracle,
    }
)
"""Every baseline by its name, simplest first."""
LEARNED = "learned:"
"""What the name of a trained policy begins with; its folder, or its name if it is shipped, follows."""


def known_controller(name: object) -> ControllerFactory:
    """Return what makes one of this package's controllers: the closed list for names out of files.

    Nothing is imported for a name, so a file cannot run code by naming a module.

    Parameters
    ----------
    name
        A key of :data:`CONTROLLERS`.

    Raises
    ------
    InputError
        It is none; ``module:attribute`` and ``learned:`` are not taken here.

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
        raise InputError(
            f"{name!r} is no controller of this package; known are {', '.join(CONTROLLERS)}"
        )
    return CONTROLLERS[name]


def make_controller(name: str, belief: PlantModel, layout: ObservationLayout) -> Controller:
    """Make a controller by its name.

    Parameters
    ----------
    name
        A name of :data:`CONTROLLERS`, ``learned:`` and the folder of a trained policy or the name of
        a shipped one, or ``module:attribute`` of a callable that takes a belief and a layout and
        returns an object with ``predict``.
    belief
        What the controller knows of the plant.
    layout
        What an observation shows, and how an action is read.

    Raises
    ------
    InputError
        The name is unknown, the attribute makes no controller, or the layout reads actions as
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
    if name in CONTROLLERS:
        return CONTROLLERS[name](belief, layout)
    if name.startswith(LEARNED):
        return _learned(name.removeprefix(LEARNED), belief, layout)
    if ":" not in name:
        close = difflib.get_close_matches(name, CONTROLLERS, 1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise InputError(
            f"no controller is named {name!r}; {hint}Known are {', '.join(CONTROLLERS)}, learned:FOLDER, and module:attribute"
        )
    factory = load_attribute(name, "controller")
    made = factory(belief, layout) if callable(factory) else factory
    if not callable(getattr(made, "predict", None)):
        raise InputError(
            f"{name!r} makes a {type(made).__name__} without predict; it should be a callable (belief, layout) that returns a controller"
        )
    return cast(Controller, made)


def _learned(name: str, belief: PlantModel, layout: ObservationLayout) -> Controller:
    try:
        from baselines.learned.controller import LearnedController  # torch, only where needed
        from baselines.learned.policy import find_policy
    except ImportError as error:
        raise InputError(
            f"a learned controller needs torch ({error}); install rdpi-gym[rl]"
        ) from error
    return LearnedController(find_policy(name), belief, layout)
