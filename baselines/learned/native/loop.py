"""A training with PPO, wherever its rollouts and updates are made: what leads from one to the next."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import torch
from torch import Tensor, nn

from baselines.learned.learner import Between, DivergedError, Kept
from baselines.learned.native.networks import CRITIC, ActorCritic
from baselines.learned.native.ppo import NativePPO, at
from baselines.learned.native.update import (
    LOG_SQRT_2_PI,
    Batch,
    Law,
    Losses,
    estimate_advantages,
)
from baselines.learned.run import Run
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.support.errors import InputError

_LEAST_SCALE = 1e-6
_TOLERANCE, _LEAST_SHARE = 1.5, 1e-3


class UpdatesNetworks(Protocol):
    """What makes the updates."""

    def update(self, batch: Batch, law: Law, rate: float, orders: Sequence[Tensor]) -> Losses:
        """Go through a batch, minibatch by minibatch."""

    def state(self) -> Mapping[str, Any]:
        """Return what its next step depends on."""

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from what :meth:`state` returned."""


class PPOLoop(ABC):
    """Rollout, advantages, update, learning rate: round after round.

    What changes from round to round stays on the device of the networks; numbers are read from it
    between two rounds alone.

    Parameters
    ----------
    run
        The training.
    both
        The networks.
    updater
        Makes their updates.
    generator
        Of orders and noise, on the networks' device.

    Attributes
    ----------
    both
        The networks.
    timesteps, updates
        Steps of all lanes together, and steps of the optimiser, so far.
    """

    kind: str

    def __init__(
        self,
        run: Run,
        ppo: NativePPO,
        both: ActorCritic,
        updater: UpdatesNetworks,
        generator: torch.Generator,
    ) -> None:
        ts_s = run.options.ts_s
        self._ppo, self._total = ppo, run.timesteps
        self.both, self._updater, self._generator = both, updater, generator
        self._gamma = math.exp(-ts_s / ppo.horizon_s)
        self._lambda = math.exp(-ts_s / ppo.gae_horizon_s)
        # Mean and mean square of returns, and how much of them is there yet.
        self._moments = torch.zeros(3, dtype=torch.float64, device=both.parameters.device)
        self._share = 1.0  # of the learning rate
        self.timesteps, self.updates = 0, 0

    @property
    @abstractmethod
    def layout(self) -> ObservationLayout:
        """What the environment shows."""

    @abstractmethod
    def begin(self, seed: int) -> None:
        """Seed every generator, and begin an episode in all lanes."""

    @abstractmethod
    def rollout(self) -> tuple[Batch, Tensor]:
        """Run all lanes on; return what the update learns from, and the rewards ``(T, B)``."""

    def actor(self) -> list[nn.Module]:
        """Return the deterministic actor."""
        return self.both.actor()

    def learn(self, timesteps: int, between: Between) -> None:
        """Take so many steps more, whole rollouts."""
        end = self.timesteps + timesteps
        while self.timesteps < end:
            between.before_rollout()
            batch, rewards = self.rollout()
            left = 1.0 - self.timesteps / self._total
            orders = [
                torch.randperm(len(batch.rows), generator=self._generator, device=batch.rows.device)
                for _ in range(self._ppo.n_epochs)
            ]
            rate = self._share * at(self._ppo.learning_rate, left)
            losses = self._updater.update(batch, self._ppo.law(left), rate, orders)
            self._adapt(losses.divergence)
            between.rewarded(float(rewards.mean()))
            self.timesteps += len(batch.rows)
            self.updates += losses.steps
            if not bool(torch.isfinite(self.both.parameters).all()):
                raise DivergedError(
                    f"the training diverged after {self.timesteps} steps: a weight is not finite; "
                    "take a lower learning_rate"
                )
        between.end()

    def tensors(self) -> Mapping[str, Any]:
        """Return the networks, the optimiser, and the moments of returns."""
        return {
            "parameters": self.both.parameters,
            "optimiser": self._updater.state(),
            "moments": self._moments,
            "share": torch.tensor(self._share, dtype=torch.float64),
        }

    def arrays(self) -> Mapping[str, Any]:
        """Return nothing: there is no replay buffer."""
        return {}

    def restore(self, kept: Kept) -> None:
        """Go on from what a checkpoint holds."""
        self.both.parameters.copy_(kept.tensors["parameters"])
        self._updater.restore(kept.tensors["optimiser"])
        self._moments.copy_(kept.tensors["moments"])
        self._share = float(kept.tensors["share"])
        self.timesteps, self.updates = kept.timesteps, kept.updates

    def _learnt_from(
        self, rows: Tensor, actions: Tensor, rewards: Tensor, noise: Tensor,
        values: Tensor, nexts: Tensor, goes_on: Tensor,
    ) -> Batch:  # fmt: skip
        """Return what a rollout of T steps of B lanes leaves for an update."""
        mean, scale = self._scale()
        values, nexts = mean + scale * values, mean + scale * nexts
        advantages = estimate_advantages(rewards, values, nexts, goes_on, self._gamma, self._lambda)
        returns = advantages + values
        if self._ppo.normalise_returns:
            self._follow(returns)
        mean, scale = self._scale()
        densities = -0.5 * noise * noise - (self.both.log_std.double() + LOG_SQRT_2_PI)
        flat = [x.flatten() for x in (actions, densities, advantages, returns)]
        return Batch(rows.flatten(0, 1), flat[0], flat[1], flat[2], (flat[3] - mean) / scale)

    def _adapt(self, divergence: float) -> None:
        """Lower or raise the learning rate of the next update by how far this one led."""
        target = self._ppo.target_kl
        if target is None or not self._ppo.adaptive_rate:
            return
        if divergence > _TOLERANCE * target:
            self._share = max(self._share / _TOLERANCE, _LEAST_SHARE)
        elif divergence < target / _TOLERANCE:
            self._share = min(self._share * _TOLERANCE, 1.0)

    def _scale(self) -> tuple[Tensor, Tensor]:
        """Return the mean and the deviation that stand for 0 and 1 of the critic, ``float64[]``."""
        some = self._moments[2] > 0.0
        mean, square = (self._moments[:2] / self._moments[2]).unbind()
        deviation = (square - mean * mean).clamp(min=0.0).sqrt().clamp(min=_LEAST_SCALE)
        return torch.where(some, mean, 0.0), torch.where(some, deviation, 1.0)

    def _follow(self, returns: Tensor) -> None:
        """Take returns into the running moments; the critic goes on saying what it said."""
        mean, scale = self._scale()
        new = torch.stack([returns.mean(), (returns * returns).mean()]).double()
        self._moments.lerp_(torch.cat([new, torch.ones_like(new[:1])]), self._ppo.return_memory)
        to_mean, to_scale = self._scale()
        weight, bias = self.both.weights[-1][CRITIC], self.both.biases[-1][CRITIC]
        weight.mul_(scale / to_scale)
        bias.mul_(scale / to_scale).add_((mean - to_mean) / to_scale)


def room_for(samples: int, lanes: int, inputs: int, device: torch.device | str) -> Tensor:
    """Return rows ``(samples, lanes, inputs)`` of a rollout."""
    try:
        return torch.zeros(samples, lanes, inputs, device=device)
    except (RuntimeError, MemoryError) as error:
        raise InputError(
            f"a rollout of {samples} samples of {lanes} lanes takes more memory than there is; "
            "take a smaller n_steps, or fewer lanes"
        ) from error


def refuse_logs(run: Run) -> None:
    """Refuse TensorBoard's logs, which these trainings do not write."""
    if run.options.tensorboard:
        raise InputError(
            f"{run.algorithm} writes no TensorBoard logs; leave --tensorboard out, training.csv has the curve"
        )
