"""What a training asks of whatever learns: Stable-Baselines3's algorithms and our own alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from torch import nn

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.support.errors import InputError


class DivergedError(InputError):
    """A training whose weights have become useless; another learning rate may do."""


@dataclass(frozen=True)
class Kept:
    """What a checkpoint holds of a learner.

    Parameters
    ----------
    timesteps, updates
        Steps of all lanes together, and updates, that had been made.
    tensors
        As :meth:`Keepable.tensors` gave them.
    read
        Returns one of :meth:`Keepable.arrays` by its name; None: they were left out.
    """

    timesteps: int
    updates: int
    tensors: Mapping[str, Any]
    read: Callable[[str], NDArray[np.generic]] | None


class Between(Protocol):
    """What stands between two stretches of a training: it evaluates and keeps a checkpoint."""

    def before_rollout(self) -> Mapping[str, float]:
        """Be called before the environment is run on; return an evaluation, if one was made."""

    def rewarded(self, reward: float) -> None:
        """Be told the mean reward of a step of all lanes."""

    def end(self) -> Mapping[str, float]:
        """Be called when all steps are done; return the last evaluation."""


class Keepable(Protocol):
    """What a checkpoint can be made of, and brought back to."""

    @property
    def kind(self) -> str:
        """Name of the algorithm in a checkpoint."""

    @property
    def timesteps(self) -> int:
        """Steps of all lanes together so far."""

    @property
    def updates(self) -> int:
        """Updates made so far."""

    def tensors(self) -> Mapping[str, Any]:
        """Return tensors, and mappings of these, from which it goes on."""

    def arrays(self) -> Mapping[str, Any]:
        """Return what is large and not needed once a training is finished: a replay buffer."""

    def restore(self, kept: Kept) -> None:
        """Go on from what a checkpoint holds."""


class Learner(Keepable, Protocol):
    """Networks that learn in an environment of their own."""

    @property
    def layout(self) -> ObservationLayout:
        """What the environment shows."""

    def actor(self) -> list[nn.Module]:
        """Return the deterministic actor: linear layers, activations, and what keeps actions within [-1, 1]."""

    def begin(self, seed: int) -> None:
        """Seed every generator, and begin an episode in all lanes."""

    def learn(self, timesteps: int, between: Between) -> None:
        """Take so many steps more."""
