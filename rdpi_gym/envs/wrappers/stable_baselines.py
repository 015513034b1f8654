"""Stable-Baselines3's ``VecEnv`` around a Gymnasium vector environment."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from rdpi_gym.support.errors import InputError

Lanes: TypeAlias = int | Iterable[int] | None
Info: TypeAlias = dict[str, Any]


class StableBaselinesVecEnv(VecEnv):  # type: ignore[misc]  # the library carries no types here
    """A Gymnasium vector environment that Stable-Baselines3 trains on.

    Stable-Baselines3 wants the first observation of the next episode in the step that ends one,
    hence SAME_STEP autoreset. The last observation of the episode is handed on as
    ``info["terminal_observation"]``, and a truncation as ``info["TimeLimit.truncated"]``, from
    which its algorithms bootstrap. The ``infos`` of lanes whose episode goes on are empty.

    Parameters
    ----------
    env
        Any vector environment with SAME_STEP autoreset, wrapped or not.
    info_keys
        Further entries of the vector environment's info that are handed on at every step, such as
        ``"error_um"``. Each costs a Python loop over the lanes.

    Raises
    ------
    InputError
        The vector environment resets its lanes in another way.

    Examples
    --------
    >>> import rdpi_gym
    >>> lanes = gym.make_vec(
    ...     "rdpi_gym/PiezoTracking-v0", num_envs=2, autoreset_mode=AutoresetMode.SAME_STEP
    ... )
    >>> env = StableBaselinesVecEnv(lanes)
    >>> _ = env.seed(0)
    >>> env.reset().shape
    (2, 11)
    >>> observation, reward, done, infos = env.step(np.zeros((2, 1), dtype=np.float32))
    >>> done.tolist(), infos
    ([False, False], [{}, {}])
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], info_keys: Sequence[str] = ()) -> None:
        mode = env.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            found = getattr(mode, "name", mode)
            raise InputError(
                f"the vector environment has autoreset mode {found}; Stable-Baselines3 needs "
                "autoreset_mode=gymnasium.vector.AutoresetMode.SAME_STEP"
            )
        self.vector_env: Any = env  # its own types know neither lists of seeds nor frames
        self._info_keys = tuple(info_keys)
        self._actions: NDArray[Any] | None = None
        self._empty: list[Info] = [{} for _ in range(env.num_envs)]
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> NDArray[np.float32]:
        """Begin an episode in every lane, with the seeds of :meth:`seed` and the options given.

        Raises
        ------
        InputError
            The lanes were given different options, which no vector environment takes.
        """
        if any(options != self._options[0] for options in self._options):
            raise InputError("lanes with different options; give every lane the same ones")
        seeds = None if None in self._seeds else list(self._seeds)
        observation, infos = self.vector_env.reset(seed=seeds, options=dict(self._options[0]))
        self.reset_infos = [_of_lane(infos, lane) for lane in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return np.asarray(observation)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions ``(B, 1)`` of the next :meth:`step_wait`."""
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[Info]]:
        """Step every lane: observations, rewards, ends of episodes, and what is known of each."""
        observation, reward, terminated, truncated, infos = self.vector_env.step(self._actions)
        done = terminated | truncated
        rewards = np.asarray(reward, dtype=np.float32)
        return observation, rewards, done, self._lane_infos(infos, done, truncated & ~terminated)

    def close(self) -> None:
        """Close the vector environment."""
        self.vector_env.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return a frame of each lane that renders."""
        return list(self.vector_env.render() or ())

    def get_attr(self, attr_name: str, indices: Lanes = None) -> list[Any]:
        """Return an attribute of each lane; one of a native vector environment belongs to all."""
        lanes = list(self._get_indices(indices))
        envs = getattr(self.vector_env.unwrapped, "envs", None)
        if envs is not None:
            return [envs[lane].get_wrapper_attr(attr_name) for lane in lanes]
        return [getattr(_holder(self.vector_env, attr_name), attr_name)] * len(lanes)

    def set_attr(self, attr_name: str, value: Any, indices: Lanes = None) -> None:
        """Set an attribute of each lane.

        Raises
        ------
        InputError
            Some lanes only, where the vector environment holds no environment for each.
        """
        envs = self._environments(indices)
        if envs is None:
            setattr(_holder(self.vector_env, attr_name), attr_name, value)
            return
        for env in envs:
            env.set_wrapper_attr(attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Lanes = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of each lane, or once of a native vector environment, for all its lanes.

        Raises
        ------
        InputError
            Some lanes only, where the vector environment holds no environment for each.
        """
        envs = self._environments(indices)
        if envs is None:
            method = getattr(_holder(self.vector_env, method_name), method_name)
            return [method(*method_args, **method_kwargs)] * self.num_envs
        return [env.get_wrapper_attr(method_name)(*method_args, **method_kwargs) for env in envs]

    def env_is_wrapped(self, wrapper_class: type, indices: Lanes = None) -> list[bool]:
        """Say of each lane whether a wrapper of that class is around it or around all lanes."""
        lanes = list(self._get_indices(indices))
        env: Any = self.vector_env
        while env is not self.vector_env.unwrapped:
            if isinstance(env, wrapper_class):
                return [True] * len(lanes)
            env = env.env
        envs = getattr(env, "envs", None)
        if envs is None:
            return [False] * len(lanes)
        return [_is_wrapped(envs[lane], wrapper_class) for lane in lanes]

    def _environments(self, indices: Lanes) -> list[gym.Env[Any, Any]] | None:
        """Return the environments of some lanes; None where there is one for all of them."""
        lanes = list(self._get_indices(indices))
        envs = getattr(self.vector_env.unwrapped, "envs", None)
        if envs is not None:
            return [envs[lane] for lane in lanes]
        if sorted(lanes) != list(range(self.num_envs)):
            raise InputError(
                f"lanes {lanes} of a vector environment that has no environment for each; give all of them"
            )
        return None

    def _lane_infos(
        self, infos: Info, done: NDArray[np.bool_], truncated: NDArray[np.bool_]
    ) -> list[Info]:
        # One list of empty dictionaries serves most steps; a caller may have written in them.
        if any(self._empty):
            self._empty = [{} for _ in range(self.num_envs)]
        lanes = self._empty.copy()
        for lane in np.flatnonzero(done).tolist():
            final = infos.get("final_info", {})
            lanes[lane] = {
                **_of_lane(final, lane),
                "terminal_observation": np.array(infos["final_obs"][lane]),
                "TimeLimit.truncated": bool(truncated[lane]),
            }
            if "episode" in infos:  # of RecordEpisodeStatistics around the vector environment
                lanes[lane]["episode"] = _of_lane(infos["episode"], lane)
        for key in self._info_keys:
            for lane, value in enumerate(infos[key].tolist()):
                lanes[lane] = {key: value, **lanes[lane]}
        return lanes


def _of_lane(infos: Info, lane: int) -> Info:
    """Take one lane's entries out of a vector environment's info, masks followed and left out."""
    found: Info = {}
    for key, values in infos.items():
        mask = infos.get(f"_{key}")
        if key.startswith("_") or (mask is not None and not mask[lane]):
            continue
        if isinstance(values, dict):
            found[key] = _of_lane(values, lane)
        else:
            value = values[lane]
            found[key] = value.item() if isinstance(value, np.generic) else value
    return found


def _holder(env: Any, name: str) -> Any:
    """Return the outermost wrapper that has an attribute, or the vector environment itself."""
    while env is not env.unwrapped and not hasattr(env, name):
        env = env.env
    return env


def _is_wrapped(env: gym.Env[Any, Any], wrapper_class: type) -> bool:
    while isinstance(env, gym.Wrapper):
        if isinstance(env, wrapper_class):
            return True
        env = env.env
    return False
