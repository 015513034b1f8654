"""Fixed physical scaling: increments and errors in units in which they are about one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from rdpi_gym.envs.wrappers.history import (
    Floats,
    History,
    HistoryObservation,
    VectorHistoryObservation,
    layout_of,
    map_final,
    one_of,
)
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted


@dataclass(frozen=True)
class Scaling:
    """The law: one invertible matrix on an observation and its history, the same for ever.

    A tracking error is a hundredth of the reference, and so is what a reference moves in a sample.
    A network finds neither in an observation as it is, where both are small differences of large
    numbers. Nothing is estimated from data, so a policy carries no running statistics.

    Parameters
    ----------
    history
        What is shown.
    frequency_hz
        A sine of this frequency with the layout's amplitude moves at most one unit in a sample.
    error
        Unit of tracking errors, as a part of the layout's amplitude.

    Raises
    ------
    InputError
        A unit is not above 0.

    Notes
    -----
    With H samples of history, in this order: r(k); r(k+1) - r(k), ... r(k+preview) -
    r(k+preview-1); r(k) - r(k-1), ... r(k-H+1) - r(k-H); e(k), ... e(k-H), where e = r - measured;
    command(k); command(k) - command(k-1), ... command(k-H+1) - command(k-H).

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> layout = ObservationLayout.for_plant(named_plant("P5"), ts_s=1e-4, preview=1)
    >>> scaling = Scaling(History(layout, 0), error=0.1)
    >>> shown = np.array([[0.5, 0.5, 0.3, 0.0]], dtype=np.float32)
    >>> scaling(shown).round(6).tolist()  # r(k), no increment ahead, e(k), command(k)
    [[0.5, 0.0, 2.0, 0.0]]
    """

    history: History
    frequency_hz: float = 100.0
    error: float = 0.02

    def __post_init__(self) -> None:
        for name in ("frequency_hz", "error"):
            value = getattr(self, name)
            if not (is_finite(value) and value > 0):
                raise InputError(f"{name} is {quoted(value)}; give a finite unit above 0")

    @cached_property
    def matrix(self) -> Floats:
        """The matrix, ``(size, size)``, that multiplies observations from the right."""
        layout, columns = self.history.layout, self.history.columns
        one = np.eye(self.history.size)
        moved = 2.0 * math.pi * self.frequency_hz * layout.ts_s
        rows = []
        for field in layout.shown:
            own = one[columns[field.name]]  # at k, k-1, ... k-H
            if field.scaling == "error":
                rows.append((one[columns["reference"]] - own) / self.error)
            elif field.scaling == "value":
                rows.append(own)
            else:
                ahead = np.diff(one[layout.columns[field.name]], axis=0)
                rows += [own[:1], ahead / moved, -np.diff(own, axis=0) / moved]
        return np.ascontiguousarray(np.concatenate(rows).T, dtype=np.float32)

    def __call__(self, observation: Floats) -> Floats:
        """Return scaled observations ``(B, size)``."""
        scaled: Floats = observation @ self.matrix
        return scaled

    def space(self, observation_space: Box) -> Box:
        """Return the space of scaled observations: the extremes of each row."""
        bound = np.maximum(np.abs(observation_space.low), np.abs(observation_space.high))
        farthest = bound.astype(np.float64) @ np.abs(self.matrix.astype(np.float64))
        rounding = 1.0 + (len(bound) + 1) * np.finfo(np.float32).eps  # of products in float32
        extreme = (rounding * farthest).astype(np.float32)
        return Box(-extreme, extreme, dtype=np.float32)


class ScaledObservation(
    gym.ObservationWrapper[Floats, NDArray[Any], Floats], gym.utils.RecordConstructorArgs
):
    """Observations scaled by :class:`Scaling`.

    Parameters
    ----------
    env
        An environment of this package, with or without `HistoryObservation` around it.
    frequency_hz, error
        The units.

    Examples
    --------
    >>> import rdpi_gym
    >>> plain = gym.make("rdpi_gym/PiezoTracking-v0", preview=2)
    >>> ScaledObservation(HistoryObservation(plain, 4)).reset(seed=0)[0].shape
    (17,)
    """

    def __init__(
        self, env: gym.Env[Floats, NDArray[Any]], frequency_hz: float = 100.0, error: float = 0.02
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, frequency_hz=frequency_hz, error=error)
        super().__init__(env)
        self.scaling = Scaling(_history_of(env), frequency_hz, error)
        assert isinstance(env.observation_space, Box)
        self.observation_space = self.scaling.space(env.observation_space)

    def observation(self, observation: Floats) -> Floats:
        """Return one observation, scaled."""
        (scaled,) = self.scaling(observation[None])
        return np.asarray(scaled)


class VectorScaledObservation(VectorWrapper[Floats, NDArray[Any], Floats, NDArray[Any], Any]):
    """The vector twin of :class:`ScaledObservation`, for every way of autoreset.

    Parameters
    ----------
    env
        A vector environment of this package, with or without `VectorHistoryObservation` around it.
    frequency_hz, error
        The units.

    Examples
    --------
    >>> import rdpi_gym
    >>> lanes = gym.make_vec("rdpi_gym/PiezoTracking-v0", num_envs=3, preview=2)
    >>> VectorScaledObservation(lanes).reset(seed=0)[0].shape
    (3, 5)
    """

    def __init__(
        self,
        env: VectorEnv[Floats, NDArray[Any], Any],
        frequency_hz: float = 100.0,
        error: float = 0.02,
    ) -> None:
        super().__init__(env)
        self.scaling = Scaling(_history_of(env), frequency_hz, error)
        assert isinstance(env.single_observation_space, Box)
        self.single_observation_space = self.scaling.space(env.single_observation_space)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin episodes."""
        observation, infos = self.env.reset(seed=seed, options=options)
        return self.scaling(observation), infos

    def step(self, actions: NDArray[Any]) -> tuple[Floats, Any, Any, Any, dict[str, Any]]:
        """Step every lane; last observations of episodes are scaled too."""
        observation, reward, terminated, truncated, infos = self.env.step(actions)
        infos = map_final(infos, terminated | truncated, self.scaling)
        return self.scaling(observation), reward, terminated, truncated, infos


def _history_of(env: Any) -> History:
    while env is not env.unwrapped:
        if isinstance(env, HistoryObservation | VectorHistoryObservation):
            return env.history
        env = env.env
    own: History | None = getattr(one_of(env), "history", None)
    return History(layout_of(env), 0) if own is None else own
