"""History stacking: what was shown before, appended to what is shown now."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.support.checks import is_whole
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

Floats: TypeAlias = NDArray[Any]  # float32, as observations are


@dataclass(frozen=True)
class History:
    """The law: observation of k, then each field's value of k-1, ... k-`steps`.

    The past is handed in and out, so that environments and trained policies share this code. Before
    an episode begins, all was as in its first observation.
    """

    layout: ObservationLayout
    steps: int

    def __post_init__(self) -> None:
        if not is_whole(self.steps, 0):
            raise InputError(
                f"history is {quoted(self.steps)}; give the number of earlier samples, 0 or above"
            )

    @property
    def size(self) -> int:
        """Length of a stacked observation."""
        return self.layout.size + len(self.layout.fields) * self.steps

    @property
    def entries(self) -> list[str]:
        """Name of every number of a stacked observation."""
        steps = range(1, self.steps + 1)
        return self.layout.entries + [
            f"{name}(k-{i})" for i in steps for name in self.layout.fields
        ]

    @cached_property
    def columns(self) -> Mapping[str, list[int]]:
        """Columns of each field's values of k, k-1, ... k-`steps`."""
        size, fields = self.layout.size, len(self.layout.fields)
        return {
            name: [now, *range(size + i, self.size, fields)]
            for i, (name, now) in enumerate(zip(self.layout.fields, self.layout.now, strict=True))
        }

    def begin(self, observation: Floats) -> Floats:
        """Return the past of episodes that begin with observations ``(B, D)``: ``(B, F H)``."""
        return np.tile(self._shown(observation), (1, self.steps))

    def past(self, observation: Floats, past: Floats) -> Floats:
        """Return the past ``(B, F H)`` of the sample after an observation ``(B, D)``."""
        if self.steps == 0:
            return past
        return np.concatenate(
            [self._shown(observation), past[:, : -len(self.layout.fields)]], axis=1
        )

    def stack(self, observation: Floats, past: Floats) -> Floats:
        """Return what is shown of observations ``(B, D)`` and their past: ``(B, size)``."""
        return np.concatenate([observation, past], axis=1)

    def space(self, observation_space: Box) -> Box:
        """Return the space of stacked observations of one environment."""
        low, high = (
            self.stack(bound[None], self.begin(bound[None]))[0]
            for bound in (observation_space.low, observation_space.high)
        )
        return Box(low, high, dtype=np.float32)

    def _shown(self, observation: Floats) -> Floats:
        return observation[:, self.layout.now]


def layout_of(env: Any) -> ObservationLayout:
    """Return the layout of an environment of this package, or of a vector of them; refuse any other."""
    layout = getattr(one_of(env), "layout", None)
    if not isinstance(layout, ObservationLayout):
        raise InputError(f"{env} has no observation layout; wrap an environment of rdpi_gym")
    return layout


def one_of(env: Any) -> Any:
    """Return the environment under all wrappers; the first of those that a vector holds."""
    inner = env.unwrapped
    return inner.envs[0].unwrapped if hasattr(inner, "envs") else inner


def map_final(
    infos: dict[str, Any], over: NDArray[np.bool_], law: Callable[[Floats], Floats]
) -> dict[str, Any]:
    """Return a vector environment's info with a law applied to the last observations of episodes.

    `law` takes a batch, one row for each lane that is `over`, ``(B,)``.
    """
    if "final_obs" not in infos:
        return infos
    lanes = np.flatnonzero(over)
    mapped = np.full(len(over), None, dtype=object)
    for lane, row in zip(lanes, law(np.stack([infos["final_obs"][i] for i in lanes])), strict=True):
        mapped[lane] = row
    return {**infos, "final_obs": mapped}


class HistoryObservation(
    gym.Wrapper[Floats, NDArray[Any], Floats, NDArray[Any]], gym.utils.RecordConstructorArgs
):
    """Observations of an environment with what was shown before: see :class:`History`.

    Parameters
    ----------
    env
        An environment of this package.
    history
        Number of earlier samples H.

    Examples
    --------
    >>> import rdpi_gym
    >>> env = HistoryObservation(gym.make("rdpi_gym/PiezoTracking-v0", preview=2), history=4)
    >>> env.reset(seed=0)[0].shape
    (17,)
    """

    def __init__(self, env: gym.Env[Floats, NDArray[Any]], history: int) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, history=history)
        super().__init__(env)
        self.history = History(layout_of(env), history)
        assert isinstance(env.observation_space, Box)
        self.observation_space = self.history.space(env.observation_space)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin an episode; its past is its first observation."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._last = observation[None]
        self._past = self.history.begin(self._last)
        return self.history.stack(self._last, self._past)[0], info

    def step(self, action: NDArray[Any]) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Step the environment."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._past = self.history.past(self._last, self._past)
        self._last = observation[None]
        stacked = self.history.stack(self._last, self._past)[0]
        return stacked, float(reward), terminated, truncated, info


class VectorHistoryObservation(VectorWrapper[Floats, NDArray[Any], Floats, NDArray[Any], Any]):
    """The vector twin of :class:`HistoryObservation`, for every way of autoreset.

    Parameters
    ----------
    env
        A vector environment of this package.
    history
        Number of earlier samples H.

    Examples
    --------
    >>> import rdpi_gym
    >>> lanes = gym.make_vec("rdpi_gym/PiezoTracking-v0", num_envs=3, preview=2)
    >>> VectorHistoryObservation(lanes, history=4).reset(seed=0)[0].shape
    (3, 17)
    """

    def __init__(self, env: VectorEnv[Floats, NDArray[Any], Any], history: int) -> None:
        super().__init__(env)
        self.history = History(layout_of(env), history)
        assert isinstance(env.single_observation_space, Box)
        self.single_observation_space = self.history.space(env.single_observation_space)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._mode = env.metadata["autoreset_mode"]
        self._over = np.zeros(self.num_envs, dtype=bool)
        self._last: Floats = np.zeros((self.num_envs, self.history.layout.size), dtype=np.float32)
        self._past: Floats = self.history.begin(self._last)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin episodes in all lanes, or in those of ``options["reset_mask"]``."""
        mask = (options or {}).get("reset_mask")  # read first: an environment may pop it
        observation, infos = self.env.reset(seed=seed, options=options)
        begun = self.history.begin(observation)
        self._past = begun if mask is None else np.where(mask[:, None], begun, self._past)
        self._last = observation
        self._over = np.zeros(self.num_envs, dtype=bool)
        return self.history.stack(observation, self._past), infos

    def step(self, actions: NDArray[Any]) -> tuple[Floats, Any, Any, Any, dict[str, Any]]:
        """Step every lane; lanes that are reset in this step begin a new past."""
        observation, reward, terminated, truncated, infos = self.env.step(actions)
        past = self.history.past(self._last, self._past)
        over = terminated | truncated
        begins = over if self._mode is AutoresetMode.SAME_STEP else self._over
        if begins.any() and self._mode is not AutoresetMode.DISABLED:
            infos = map_final(infos, over, lambda last: self.history.stack(last, past[over]))
            past[begins] = self.history.begin(observation[begins])
        self._last, self._past, self._over = observation, past, over
        return self.history.stack(observation, past), reward, terminated, truncated, infos
