"""Lanes of several plants for training, and held-out plants and references for evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from baselines.learned.options import TrainingOptions
from baselines.learned.settings import ENVIRONMENT_ID
from baselines.monitors import EnvelopeRecorder
from rdpi_gym.envs.controller import ControllerFactory
from rdpi_gym.envs.wrappers.side_by_side import SideBySideVectorEnv
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.errors import InputError


def make_lanes(
    plants: Sequence[PlantModel], lanes: int, samples: int, **keywords: Any
) -> SideBySideVectorEnv:
    """Make lanes of several plants, as many of each as can be, with SAME_STEP autoreset."""
    return SideBySideVectorEnv(
        [
            gym.make_vec(
                ENVIRONMENT_ID,
                num_envs=share,
                vectorization_mode="vector_entry_point",
                max_episode_steps=samples,
                autoreset_mode=AutoresetMode.SAME_STEP,
                plant=plant,
                **keywords,
            )
            for plant, share in zip(plants, lanes_of_each(plants, lanes), strict=True)
        ]
    )


def lanes_of_each(plants: Sequence[PlantModel], lanes: int) -> list[int]:
    """Divide lanes among plants, as many for each as can be."""
    if lanes < len(plants):
        raise InputError(f"{lanes} lanes for {len(plants)} plants; give at least one for each")
    return [len(part) for part in np.array_split(np.arange(lanes), len(plants))]


LANES, SAMPLES, FIRST = 24, 1000, 200
"""Plants, each with a reference of its own; samples of a run; the first that counts."""
SEED = 2**33
"""Seed of the held-out plants, references and noise; beyond the seeds that trainings draw."""


@dataclass(frozen=True)
class Evaluation:
    """Means over the held-out plants."""

    reward: float  # of a sample
    rmse_um: float
    rmse_percent: float
    # Root mean square tracking error of a plant (µm, percent of its reference's peak to peak).
    command_variation_V_s: float  # total variation of the command (V/s)


class HeldOut:
    """Held-out plants and references, the same at every evaluation."""

    def __init__(self, options: TrainingOptions) -> None:
        self._env = make_lanes(
            options.models, LANES, SAMPLES + 1, action="command", **options.world()
        )

    def recorder(self) -> EnvelopeRecorder:
        """Return who can be told of the observations of a run."""
        return EnvelopeRecorder(self._env.layout)

    def evaluate(
        self, make: ControllerFactory, recorder: EnvelopeRecorder | None = None
    ) -> Evaluation:
        """Run the controller that `make` makes of the plants' belief and layout."""
        controller = make(self._env.belief, self._env.layout)
        observation, _ = self._env.reset(seed=SEED)
        state, starts = None, np.ones(LANES, dtype=bool)
        errors, references, commands, rewards = (np.empty((SAMPLES, LANES)) for _ in range(4))
        for k in range(SAMPLES):
            if recorder is not None:
                recorder.take(observation)
            action, state = controller.predict(observation, state, starts, deterministic=True)
            observation, rewards[k], _, _, infos = self._env.step(action)
            errors[k], references[k] = infos["error_um"], infos["reference_um"]
            commands[k] = infos["command_V"]
            starts[:] = False
        rmse = np.sqrt(np.mean(errors[FIRST:] ** 2, axis=0))
        steps = np.abs(np.diff(commands[FIRST - 1 :], axis=0))
        return Evaluation(
            float(rewards[FIRST:].mean()),
            float(rmse.mean()),
            float(100.0 * (rmse / np.ptp(references[FIRST:], axis=0)).mean()),
            float(steps.mean() / self._env.layout.ts_s),
        )
