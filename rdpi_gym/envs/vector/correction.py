"""Baselines that run inside the lanes of a vector environment."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rdpi_gym.envs.controller import make_named_controller
from rdpi_gym.envs.correction import Correction
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.vector.lanes import Flags, Floats32, Integers
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array


class VectorCorrection:
    """The commands that a baseline would give in every lane, sample by sample.

    One baseline serves all lanes in one call. One that plans ahead keeps a plan for all of its
    episodes, which begin at different times here: so each lane has a baseline of its own.

    Parameters
    ----------
    name, belief, layout
        As :class:`rdpi_gym.envs.correction.Correction`.
    lanes
        Number of lanes B.

    Attributes
    ----------
    commands_V : float64[B]
        The baseline's u(k+1) (V), from the observations of k.
    plans : bool
        Whether the baseline plans over the samples of a reference.
    """

    def __init__(
        self, name: str, belief: PlantModel, layout: ObservationLayout, lanes: int
    ) -> None:
        self._layout = replace(layout, action="command")
        self._controller = make_named_controller(name, belief, self._layout)
        self.plans = hasattr(self._controller, "plan")
        self._each = [Correction(name, belief, layout) for _ in range(lanes)] if self.plans else []
        self._state: Any = None
        self.commands_V: Array = np.zeros(lanes)

    def plan(self, indices: Integers, references_um: Array, observation: Floats32) -> None:
        """Begin episodes of a baseline that plans, over the samples ``(B, K)`` (µm) of all lanes."""
        for j, lane in enumerate(indices.tolist()):
            self._each[lane].reset(references_um[lane][:, None], observation[j : j + 1])
            self.commands_V[lane] = self._each[lane].command_V

    def observe(self, observation: Floats32, begins: Flags) -> None:
        """Take the observations ``(B, D)`` of this sample and find the commands for the next one."""
        if self.plans:
            for lane in np.flatnonzero(~begins).tolist():
                self._each[lane].observe(observation[lane : lane + 1])
                self.commands_V[lane] = self._each[lane].command_V
            return
        state = None if begins.all() else self._state
        action, self._state = self._controller.predict(
            observation, state=state, episode_start=begins, deterministic=True
        )
        places = np.asarray(action, dtype=np.float64)[:, 0]
        self.commands_V[:] = self._layout.place_to_V(places)
