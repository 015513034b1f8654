"""Controllers of a user's own that are objects, not names: callables, and controllers made already."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from baselines import CONTROLLERS, Controller, ControllerFactory
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.checks import shown
from rdpi_gym.support.errors import InputError


@dataclass(frozen=True)
class Made:
    """A controller that was made with a belief and a layout of its own; it is scored as it is.

    Parameters
    ----------
    controller
        With ``predict``.
    layout
        What it is shown; its sampling time is the one that it is scored at.
    """

    controller: Controller
    layout: ObservationLayout

    def __call__(self, belief: PlantModel, layout: ObservationLayout) -> Controller:
        """Return the controller; what the benchmark would have it believe does not matter."""
        return self.controller


def named(controllers: Sequence[Any]) -> Mapping[str, ControllerFactory]:
    """Name callables and controllers, and return what makes each."""
    found: dict[str, ControllerFactory] = {}
    for each in controllers:
        if isinstance(each, Controller) and not isinstance(each, type):
            layout = getattr(each, "layout", None)
            if not isinstance(layout, ObservationLayout):
                raise InputError(
                    f"controller {shown(each)} has no layout; give a callable (belief, layout) that makes it"
                )
            label, factory = f"{type(each).__name__} (made)", Made(each, layout)
        elif callable(each):
            label, factory = str(getattr(each, "__name__", type(each).__name__)), each
        else:
            raise InputError(
                f"controller {shown(each)}: give a name, a callable (belief, layout), or a controller"
            )
        count = 1
        while (name := label if count == 1 else f"{label} {count}") in {*found, *CONTROLLERS}:
            count += 1
        found[name] = factory
    return found
