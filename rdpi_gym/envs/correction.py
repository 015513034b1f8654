"""A baseline that runs inside the environment, for actions that correct its command."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.envs.controller import make_named_controller
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array


class Correction:
    """The command that a baseline would give, sample by sample.

    Parameters
    ----------
    name, belief
        As :func:`~rdpi_gym.envs.controller.make_named_controller`.
    layout
        The environment's; the baseline reads the same observation and gives commands.

    Raises
    ------
    InputError
        No controller has that name.

    Attributes
    ----------
    command_V : float
        The baseline's u(k+1) (V), from the observation of k.
    """

    def __init__(self, name: str, belief: PlantModel, layout: ObservationLayout) -> None:
        self._layout = replace(layout, action="command")
        self._controller = make_named_controller(name, belief, self._layout)
        self._state: Any = None
        self._start = True
        self.command_V = 0.0

    def reset(self, reference_um: Array, observation: NDArray[np.float32]) -> None:
        """Begin an episode with the references ``(K, 1)`` (µm) that are known before it."""
        plan = getattr(self._controller, "plan", None)
        if plan is not None:
            plan(reference_um)
        self._state, self._start = None, True
        self.observe(observation)

    def observe(self, observation: NDArray[np.float32]) -> None:
        """Take the observation ``(1, D)`` of this sample and find the command for the next one."""
        action, self._state = self._controller.predict(
            observation,
            state=self._state,
            episode_start=np.array([self._start]),
            deterministic=True,
        )
        self._start = False
        self.command_V = float(self._layout.place_to_V(np.asarray(action, dtype=float)).item())
