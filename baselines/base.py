"""Base of the controllers of this package: a belief, a layout, a memory, and ``predict``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baselines.lanes import Limits
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

Observation: TypeAlias = NDArray[np.floating[Any]]
"""Observations of B episodes side by side, ``(B, D)``."""


class Baseline(ABC):
    """A :class:`~rdpi_gym.envs.controller.Controller` that Stable-Baselines3's ``evaluate_policy`` runs too.

    A class that states its ``name`` is a controller of that name: nothing else is needed than a file
    in this folder.

    At step k it reads an observation and sets the command u(k+1). What it remembers is one array,
    ``float64[S, B]``: it is handed out by :meth:`predict` and taken back at the next call, and is
    never changed behind the caller's back. So one controller may run several loops in turn.

    Parameters
    ----------
    belief
        What it knows of the plant; the truth is never read.
    layout
        Where an observation shows what, and how an action is read.

    Raises
    ------
    InputError
        The layout reads actions as corrections to a baseline; a baseline computes the command.

    Attributes
    ----------
    name : str
        What the command line and tables call it; stated by the class itself.
    on_feedforwards : bool
        Whether it takes a ``feedforward`` too, and is made on each as ``<name>-<feedforward>``.
    inverts_effects : bool
        Whether it makes use of the effects of its belief, beside the hysteresis.
    needs_core : type or None
        Kind of hysteresis core that its belief has to have; None: any.
    """

    name: ClassVar[str]
    on_feedforwards: ClassVar[bool] = False
    inverts_effects: ClassVar[bool] = False
    needs_core: ClassVar[type[Core] | None] = None

    def __init__(self, belief: PlantModel, layout: ObservationLayout) -> None:
        if layout.action == "correction":
            raise InputError(
                "actions are read as correction to a baseline; a baseline itself needs a layout with action 'command' or 'increment'"
            )
        self.belief = belief
        self.layout = layout
        self.limits = Limits.of(layout)

    @abstractmethod
    def start(self, reference_um: Array) -> Array:
        """Return the memory of episodes that begin at rest at the command nearest 0 V.

        Parameters
        ----------
        reference_um
            r(0) (µm), ``(B,)``.

        Returns
        -------
        float64[S, B]
        """

    @abstractmethod
    def next_command(self, observation: Observation, reference_um: Array, state: Array) -> Array:
        """Return u(k+1) (V), ``(B,)``, within the limits, and move the memory on.

        Parameters
        ----------
        observation
            ``(B, D)``.
        reference_um
            r(k) and r(k+1) (µm) as decoded from it, float64[2, B].
        state
            Memory, ``float64[S, B]``, changed in place.
        """

    @property
    def needed_preview(self) -> int:
        """Samples of the reference that a layout should show ahead for all that it can do."""
        return 1

    def warning(self) -> str | None:
        """Return one line on what keeps the controller from what it should do, else None.

        It is outside its stability limit, or inverts its belief in part.
        """
        return None

    def certificate(self) -> str | None:
        """Return one line on what is proved of the loop on its belief, else None.

        It is known before the controller drives anything: small gain, passivity, or poles.
        """
        return None

    def predict(
        self,
        observation: Observation,
        state: Array | None = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.float32], Array]:
        """Return actions and the memory for the next call.

        Parameters
        ----------
        observation
            ``(D,)`` or, for B episodes side by side, ``(B, D)``.
        state
            What the last call returned; None begins every episode.
        episode_start
            ``(B,)``, true where an episode begins; its memory is that of rest.
        deterministic
            Without effect: no baseline draws random numbers.

        Returns
        -------
        action : float32[1] or float32[B, 1]
        state : float64[S, B]

        Raises
        ------
        InputError
            The observation does not fit the layout, or the state another number of episodes.

        Examples
        --------
        >>> from baselines import make_controller
        >>> from rdpi_gym.plant import named_plant
        >>> layout = ObservationLayout.for_plant(named_plant("P5"), ts_s=1e-3, preview=1)
        >>> controller = make_controller("none", named_plant("P5"), layout)
        >>> action, state = controller.predict(np.array([0.0, 1.0, 0.0, 0.0], dtype=np.float32))
        >>> round(float(action[0]), 3)
        0.392
        """
        shown = np.asarray(observation)
        batch = shown[None] if shown.ndim == 1 else shown
        if batch.ndim != 2 or batch.shape[1] != self.layout.size:
            raise InputError(
                f"an observation of shape {shown.shape}; this layout shows {self.layout.size} numbers, with preview {self.layout.preview}"
            )
        # Only r(k) and r(k+1) are decoded: a long preview costs nothing.
        reference = np.ascontiguousarray(self.layout.reference_um(batch, slice(2)).T)
        moved = self._resumed(reference[0], state, episode_start)
        command = self.next_command(batch, reference, moved)
        action = self.layout.action_for(command, batch)
        return (action[0] if shown.ndim == 1 else action), moved

    def _resumed(
        self, reference_um: Array, state: Array | None, episode_start: ArrayLike | None
    ) -> Array:
        if state is None:
            return self.start(reference_um)
        if state.shape[1] != len(reference_um):
            raise InputError(
                f"a state of {state.shape[1]} episodes with observations of {len(reference_um)}; pass None to begin anew"
            )
        moved = state.copy()
        if episode_start is not None:
            begins = np.atleast_1d(np.asarray(episode_start, dtype=bool))
            if np.count_nonzero(begins):
                moved[:, begins] = self.start(reference_um[begins])
        return moved
