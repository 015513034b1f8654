"""Controllers: their protocol, and the baseline whose command actions correct."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.plugins import provided

GROUP = "rdpi_gym.controllers"
"""Entry-point group in which a package names its controllers; each is a :data:`ControllerFactory`."""


@runtime_checkable
class Controller(Protocol):
    """Answers observations with actions, one episode or many side by side.

    Beyond :meth:`predict` a controller may have, and is asked for where it has them:

    ``needed_preview : int``
        Samples of the reference that an observation should show ahead.
    ``plan(reference_um) -> Any``
        Called before an episode with the whole reference (µm), ``(samples, lanes)``.
    ``warning() -> str | None``
        One line on what keeps it from what it should do, such as its stability limit.
    ``certificate() -> str | None``
        One line on what is proved of its loop before it drives anything.

    Examples
    --------
    >>> import numpy as np
    >>> class Hold:
    ...     def predict(self, observation, state=None, episode_start=None, deterministic=False):
    ...         return np.zeros((*np.shape(observation)[:-1], 1), dtype=np.float32), state
    >>> isinstance(Hold(), Controller)
    True
    """

    def predict(
        self,
        observation: NDArray[Any],
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[Any], Any]:
        """Return actions and what to hand over at the next call.

        Parameters
        ----------
        observation
            ``(D,)`` or ``(B, D)``, as an :class:`~rdpi_gym.envs.layout.ObservationLayout` says.
        state
            What the last call returned; None at the first.
        episode_start
            ``(B,)``, true where an episode begins.
        deterministic
            Whether a controller that explores does not.

        Returns
        -------
        action
            ``(1,)`` or ``(B, 1)``, in units of the layout's action, -1 to 1.
        state
            Anything.
        """
        ...


ControllerFactory: TypeAlias = Callable[[PlantModel, ObservationLayout], Controller]
"""Makes a controller from what it believes of the plant and what it is shown."""


def make_named_controller(name: str, belief: PlantModel, layout: ObservationLayout) -> Controller:
    """Make a controller by its name, with whatever package provides the names."""
    made: Controller = provided(GROUP)(name, belief, layout)
    return made


def certificate_of(controller: Controller) -> str | None:
    """Return what a controller can prove of its loop on its belief; None: nothing."""
    say = getattr(controller, "certificate", None)
    said: str | None = None if say is None else say()
    return said


def warning_of(controller: Controller) -> str | None:
    """Return what a controller says of itself, such as that it is unstable; None: nothing."""
    say = getattr(controller, "warning", None)
    said: str | None = None if say is None else say()
    return said


class Correction:
    """Commands (V) that a baseline would give in every lane, sample by sample.

    One baseline serves all lanes in one call. One that plans ahead keeps a plan for all of its
    episodes, which begin at different times: so each lane has a baseline of its own.
    """

    def __init__(
        self, name: str, belief: PlantModel, layout: ObservationLayout, lanes: int = 1
    ) -> None:
        self._layout = replace(layout, action="command")
        first = make_named_controller(name, belief, self._layout)
        self.plans = hasattr(first, "plan")
        count = lanes if self.plans else 1
        further = (make_named_controller(name, belief, self._layout) for _ in range(count - 1))
        self._controllers: list[Any] = [first, *further]
        self._states: list[Any] = [None] * count
        self.commands_V: Array = np.zeros(lanes)

    def plan(
        self,
        indices: NDArray[np.int64],
        references_um: Mapping[int, Array],
        observation: NDArray[np.float32],
    ) -> None:
        """Begin episodes of a baseline that plans, over the samples ``(K,)`` (µm) of each lane."""
        for j, lane in enumerate(indices.tolist()):
            self._controllers[lane].plan(references_um[lane][:, None])
            self._predict(lane, slice(lane, lane + 1), observation[j : j + 1], np.ones(1, bool))

    def observe(self, observation: NDArray[np.float32], begins: NDArray[np.bool_]) -> None:
        """Take the observations ``(B, D)`` of this sample and find the commands for the next one.

        Lanes of a baseline that plans have begun in :meth:`plan`.
        """
        if not self.plans:
            self._predict(0, slice(None), observation, begins)
            return
        for lane in np.flatnonzero(~begins).tolist():
            own = slice(lane, lane + 1)
            self._predict(lane, own, observation[own], begins[own])

    def _predict(
        self, i: int, lanes: slice, observation: NDArray[np.float32], begins: NDArray[np.bool_]
    ) -> None:
        state = None if begins[0] and begins.all() else self._states[i]
        action, self._states[i] = self._controllers[i].predict(
            observation, state=state, episode_start=begins, deterministic=True
        )
        places = np.asarray(action, dtype=np.float64)[:, 0]
        self.commands_V[lanes] = self._layout.place_to_V(places)
