"""PPO on the native vector environment: rollouts in threads, advantages, updates."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from baselines.learned.checkpoint import CheckpointContent, TrainingHooks
from baselines.learned.folder import Run
from baselines.learned.native.lanes import Lanes
from baselines.learned.native.networks import ACTOR, CRITIC, ActorCritic, Workspace
from baselines.learned.native.update import (
    LOG_SQRT_2_PI,
    Batch,
    NativePPO,
    Updater,
    at,
    estimate_advantages,
)
from baselines.learned.options import DivergedError
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.support.errors import InputError

_LEAST_SCALE = 1e-6
_TOLERANCE, _LEAST_SHARE = 1.5, 1e-3


_ROWS = 1024  # of a pass of the critic over a rollout


class NativeLearner:
    """PPO in lanes of plants, without a wrapper or autograd between environment and network.

    Parameters
    ----------
    run
        The training.

    Attributes
    ----------
    both
        Actor and critic.
    timesteps, updates
        Steps of all lanes together, and steps of the optimiser, so far.

    Raises
    ------
    InputError
        Hyper-parameters or options that nothing can be trained with.
    """

    kind = "NativePPO"

    def __init__(self, run: Run) -> None:
        options = run.options
        if options.tensorboard:
            raise InputError(
                f"{run.algorithm} writes no TensorBoard logs; leave --tensorboard out, training.csv has the curve"
            )
        torch.set_num_threads(1)  # what it shares among threads it divides itself
        ppo = NativePPO(**run.settings.arguments())
        count = options.lanes or run.settings.lanes
        self._lanes = Lanes(options, run.settings, count, options.threads)
        inputs = self._lanes.scaling.history.size
        widths = (inputs, *ppo.net_arch, 1)
        self.both = ActorCritic(widths, ppo.log_std_init, options.seed)
        self._updater = Updater(self.both, options.threads)
        self._generator = torch.Generator()  # of noise, and of the order of minibatches
        self._ppo, self._total = ppo, run.timesteps
        self._gamma = math.exp(-options.ts_s / ppo.horizon_s)
        self._lambda = math.exp(-options.ts_s / ppo.gae_horizon_s)
        # Mean and mean square of returns, and the weight that both have.
        self._moments = torch.zeros(3, dtype=torch.float64)
        self._share = 1.0  # of the learning rate
        self.timesteps, self.updates = 0, 0
        self._works = [Workspace(widths) for _ in range(options.threads)]
        try:
            self._rows = torch.zeros(ppo.n_steps + 1, count, inputs)
        except (RuntimeError, MemoryError) as error:
            raise InputError(
                f"a rollout of {ppo.n_steps + 1} samples of {count} lanes takes more memory than there is; "
                "take a smaller n_steps, or fewer lanes"
            ) from error
        self._actions, self._rewards = (torch.zeros(ppo.n_steps, count) for _ in range(2))

    @property
    def layout(self) -> ObservationLayout:
        """Observation layout of the environment."""
        return self._lanes.layout

    def begin(self, seed: int) -> None:
        """Seed every generator, and begin an episode in all lanes."""
        self._generator.manual_seed(seed)
        self._lanes.begin(seed, self._rows[-1].numpy())

    def rollout(self) -> tuple[Batch, Tensor]:
        """Run all lanes on; return what the update learns from, and the rewards ``(T, B)``."""
        steps, lanes, _ = self._rows.shape
        steps -= 1
        self._rows[0] = self._rows[-1]
        noise = torch.randn(steps, lanes, generator=self._generator)
        # What the lanes whose episode ends would have shown next.
        finals: list[list[tuple[int, np.ndarray[Any, Any], Tensor]]] = [
            [] for _ in self._lanes.parts
        ]
        self._updater.each(lambda i: self._run(i, noise, finals[i]), len(self._lanes.parts))
        values = self._values(self._rows.flatten(0, 1)).view(steps + 1, lanes)
        nexts, goes_on = values[1:].clone(), torch.ones(steps, lanes)
        for k, ended, rows in (each for part in finals for each in part):
            nexts[k, ended], goes_on[k, ended] = self._values(rows), 0.0
        batch = self._learnt_from(
            self._rows[:-1], self._actions, self._rewards, noise, values[:-1], nexts, goes_on
        )
        return batch, self._rewards

    def _run(
        self, number: int, noise: Tensor, finals: list[tuple[int, np.ndarray[Any, Any], Tensor]]
    ) -> None:
        """Run one part of the lanes through a rollout."""
        part, work = self._lanes.parts[number], self._works[number]
        own = slice(part.first, part.end)
        deviations = noise[:, own] * self.both.log_std.exp()
        for k in range(len(noise)):
            before, after = self._rows[k, own], self._rows[k + 1, own]
            actions = self._actions[k, own]
            torch.add(self.both.forward(before, work, ACTOR)[0, :, 0], deviations[k], out=actions)
            written = after.numpy()
            part.step(
                actions.numpy().astype(np.float64), before.numpy(), written,
                self._rewards[k, own].numpy(),
            )  # fmt: skip
            ended = part.ended()
            if len(ended):
                finals.append((k, ended + part.first, after[ended]))
                part.restart(ended, written)

    def _values(self, rows: Tensor) -> Tensor:
        """Return the critic's values ``(n,)`` of rows, in its own units."""
        values = torch.empty(len(rows))
        parts = list(zip(torch.split(rows, _ROWS), torch.split(values, _ROWS), strict=True))
        count = len(self._works)

        def run(number: int) -> None:
            for some, out in parts[number::count]:
                out.copy_(self.both.forward(some, self._works[number], CRITIC)[0, :, 0])

        self._updater.each(run, count)
        return values

    def actor(self) -> list[nn.Module]:
        """Return the deterministic actor."""
        return self.both.actor()

    def learn(self, timesteps: int, between: TrainingHooks) -> None:
        """Take so many steps more, whole rollouts."""
        end = self.timesteps + timesteps
        while self.timesteps < end:
            between.before_rollout()
            batch, rewards = self.rollout()
            left = 1.0 - self.timesteps / self._total
            orders = [
                torch.randperm(len(batch.rows), generator=self._generator)
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

    def restore(self, kept: CheckpointContent) -> None:
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
