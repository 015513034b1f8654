"""What a controller is, for the environment, the benchmark and Stable-Baselines3 alike."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeAlias, runtime_checkable

from numpy.typing import ArrayLike, NDArray

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
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
