"""The plants that agents are trained and evaluated on, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from baselines.learned.settings import ENVIRONMENT_ID
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
