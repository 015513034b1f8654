"""Vector environments of several plants as one: lanes with other effects beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.wrappers.history import layout_of, one_of
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.errors import InputError


class SideBySideVectorEnv(VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """The lanes of several vector environments of this package, one group after the other.

    The lanes of one vector environment have the same effects, at sizes of their own. An agent that
    meets but one set of effects may fail on a plant that lacks one of them.

    Parameters
    ----------
    groups
        Vector environments that show the same, read actions alike and reset in the same way.

    Raises
    ------
    InputError
        No group, groups that differ in what they show or in how they are reset, or DISABLED
        autoreset.

    Examples
    --------
    >>> from rdpi_gym.envs.vector import PiezoTrackingVectorEnv
    >>> bare = PiezoTrackingVectorEnv(num_envs=2, plant="P10")
    >>> both = SideBySideVectorEnv([bare, PiezoTrackingVectorEnv(num_envs=1, plant="P10-static")])
    >>> both.reset(seed=0)[0].shape
    (3, 11)
    """

    def __init__(self, groups: Sequence[VectorEnv[Any, Any, Any]]) -> None:
        if not groups:
            raise InputError("no group of lanes; give at least one vector environment")
        self.groups = tuple(groups)
        self.layout: ObservationLayout = layout_of(groups[0])
        self.belief: PlantModel = one_of(groups[0]).belief
        modes = {group.metadata["autoreset_mode"] for group in groups}
        if any(layout_of(group) != self.layout for group in groups):
            raise InputError(
                "groups of lanes that differ in what they show or in how they read actions; give "
                "them plants with the same range, centre and amplitude, and the same options"
            )
        if len(modes) > 1 or AutoresetMode.DISABLED in modes:
            raise InputError(
                "groups of lanes that differ in how they are reset, or are not reset by themselves; "
                "give all of them SAME_STEP or NEXT_STEP autoreset"
            )
        self.metadata = dict(groups[0].metadata)
        self.render_mode = groups[0].render_mode
        self.num_envs = sum(group.num_envs for group in groups)
        self._ends = np.cumsum([group.num_envs for group in groups])[:-1]
        boxes = [group.single_observation_space for group in groups]
        low = np.min([box.low for box in boxes if isinstance(box, Box)], axis=0)
        high = np.max([box.high for box in boxes if isinstance(box, Box)], axis=0)
        self.single_observation_space = Box(low, high, dtype=np.float32)
        self.single_action_space = groups[0].single_action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Begin episodes in all lanes; seeds count the lanes of all groups through."""
        if seed is None or isinstance(seed, int):
            seed = [None if seed is None else seed + lane for lane in range(self.num_envs)]
        found, first = [], 0
        for group in self.groups:
            own: Any = seed[first : first + group.num_envs]
            found.append(group.reset(seed=own, options=options))
            first += group.num_envs
        observations, infos = zip(*found, strict=True)
        return np.concatenate(observations), self._joined(infos)

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Step every lane of every group."""
        parts = np.split(actions, self._ends)
        found = [group.step(part) for group, part in zip(self.groups, parts, strict=True)]
        observation, reward, terminated, truncated = (
            np.concatenate([one[i] for one in found]) for i in range(4)
        )
        infos = self._joined([one[4] for one in found])
        return observation, reward, terminated, truncated, infos

    def render(self) -> tuple[Any, ...] | None:
        """Return a frame of each lane; None without a render mode."""
        frames = [group.render() for group in self.groups]
        if any(shown is None for shown in frames):
            return None
        return tuple(frame for shown in frames for frame in shown or ())

    def close_extras(self, **kwargs: Any) -> None:
        """Close the groups."""
        for group in self.groups:
            group.close(**kwargs)

    def _joined(self, infos: Sequence[dict[str, Any]]) -> dict[str, Any]:
        """Join the infos of the groups; where one lacks a key, its lanes' mask is false."""
        joined: dict[str, Any] = {}
        for key in dict.fromkeys(key for info in infos for key in info):
            given = next(info[key] for info in infos if key in info)
            if isinstance(given, dict):
                joined[key] = self._joined([info.get(key, {}) for info in infos])
                continue
            parts = [
                info[key] if key in info else np.zeros(group.num_envs, dtype=given.dtype)
                for info, group in zip(infos, self.groups, strict=True)
            ]
            joined[key] = np.concatenate(parts)
        return joined
