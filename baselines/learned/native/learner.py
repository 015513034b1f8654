"""PPO on the native vector environment: rollouts, advantages, updates, as one learner."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from baselines.learned.learner import Between, DivergedError, Kept
from baselines.learned.native.lanes import Lanes
from baselines.learned.native.networks import ACTOR, CRITIC, ActorCritic, Workspace
from baselines.learned.native.update import (
    LOG_SQRT_2_PI,
    Batch,
    Law,
    Updater,
    estimate_advantages,
)
from baselines.learned.run import Run
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.support.checks import is_finite, is_whole
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

_ROWS = 1024  # of a pass of the critic over a rollout
_LEAST_SCALE = 1e-6
_TOLERANCE, _LEAST_SHARE = 1.5, 1e-3


@dataclass(frozen=True)
class NativePPO:
    """Hyper-parameters; those that Stable-Baselines3 has too mean the same and have its names.

    Parameters
    ----------
    learning_rate, clip_range
        Numbers, or functions of the share of the training that is left.
    n_steps
        Steps of each lane in a rollout.
    batch_size, n_epochs, target_kl, ent_coef, vf_coef, max_grad_norm
        As :class:`~baselines.learned.native.update.Law`.
    horizon_s
        Time (s) after which a reward counts 1/e: the discount of a step is exp(-Ts / horizon).
    gae_horizon_s
        The same of the advantage's bias against its variance: lambda is exp(-Ts / gae_horizon).
    normalise_returns
        Whether the critic estimates returns by their running mean and deviation, its last layer
        rescaled as these move (van Hasselt et al., Learning values across many orders of magnitude,
        2016).
    return_memory
        Share of a rollout in these running moments.
    log_std_init
        Logarithm of the exploration's standard deviation at the start.
    net_arch
        Hidden units of actor and of critic, tanh between them.
    adaptive_rate
        Whether the learning rate goes below `learning_rate` where updates diverge by more than
        `target_kl`, and back up where by less. The narrower the exploration has become, the farther
        the same step of the weights leads from the policy that acted.

    Raises
    ------
    InputError
        A value that nothing can be trained with.
    """

    learning_rate: float | Callable[[float], float] = 3e-4
    n_steps: int = 64
    batch_size: int = 2048
    n_epochs: int = 2
    horizon_s: float = 0.005
    gae_horizon_s: float = 0.001
    clip_range: float | Callable[[float], float] = 0.2
    target_kl: float | None = None
    ent_coef: float = 0.0
    vf_coef: float = 0.5
    max_grad_norm: float = 0.5
    normalise_returns: bool = True
    return_memory: float = 0.5
    log_std_init: float = -1.5
    net_arch: Sequence[int] = (64, 64)
    adaptive_rate: bool = True

    def __post_init__(self) -> None:
        for name in ("n_steps", "batch_size", "n_epochs"):
            if not is_whole(getattr(self, name), 1):
                raise InputError(
                    f"{name} is {quoted(getattr(self, name))}; give a whole number of 1 or more"
                )
        for name in ("horizon_s", "gae_horizon_s", "max_grad_norm", "return_memory"):
            value = getattr(self, name)
            if not (is_finite(value) and value > 0.0):
                raise InputError(f"{name} is {quoted(value)}; give a finite number above 0")
        for name in ("ent_coef", "vf_coef", "log_std_init"):
            if not is_finite(getattr(self, name)):
                raise InputError(f"{name} is {quoted(getattr(self, name))}; give a number")
        if self.target_kl is not None and not (is_finite(self.target_kl) and self.target_kl > 0):
            raise InputError(
                f"target_kl is {quoted(self.target_kl)}; give a number above 0, or null for none"
            )
        if not isinstance(self.net_arch, list | tuple):
            raise InputError(f"net_arch is {quoted(self.net_arch)}; give hidden units, as [64, 64]")

    def law(self, left: float) -> Law:
        """Return the numbers of an update where a share of the training is left."""
        return Law(
            self.batch_size, self.n_epochs, _at(self.clip_range, left), self.target_kl,
            self.ent_coef, self.vf_coef, self.max_grad_norm,
        )  # fmt: skip


class NativeLearner:
    """PPO in lanes of plants, without a wrapper or autograd between environment and network.

    Parameters
    ----------
    run
        The training.

    Attributes
    ----------
    both
        The networks.
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
        self._ppo = NativePPO(**run.settings.arguments())
        self._total = run.timesteps
        count = options.lanes or run.settings.lanes
        self._lanes = Lanes(options, run.settings, count, options.threads)
        inputs, steps = self._lanes.scaling.history.size, self._ppo.n_steps
        widths = (inputs, *self._ppo.net_arch, 1)
        self.both = ActorCritic(widths, self._ppo.log_std_init, options.seed)
        self._updater = Updater(self.both, options.threads)
        self._works = [Workspace(widths) for _ in range(options.threads)]
        self._gamma = math.exp(-options.ts_s / self._ppo.horizon_s)
        self._lambda = math.exp(-options.ts_s / self._ppo.gae_horizon_s)
        self._generator = torch.Generator()
        # Mean and mean square of returns, and how much of them is there yet.
        self._moments = torch.zeros(3, dtype=torch.float64)
        self._share = 1.0  # of the learning rate
        try:
            self._rows = torch.zeros(steps + 1, count, inputs)
            self._actions, self._rewards = (torch.zeros(steps, count) for _ in range(2))
        except (RuntimeError, MemoryError) as error:
            raise InputError(
                f"a rollout of {steps} steps of {count} lanes takes more memory than there is; "
                "take a smaller n_steps, or fewer lanes"
            ) from error
        self.timesteps, self.updates = 0, 0

    @property
    def layout(self) -> ObservationLayout:
        """What the environment shows."""
        return self._lanes.layout

    def actor(self) -> list[nn.Module]:
        """Return the deterministic actor."""
        return self.both.actor()

    def begin(self, seed: int) -> None:
        """Seed every generator, and begin an episode in all lanes."""
        self._generator.manual_seed(seed)
        self._lanes.begin(seed, self._rows[-1].numpy())

    def learn(self, timesteps: int, between: Between) -> None:
        """Take so many steps more, whole rollouts.

        Raises
        ------
        DivergedError
            Weights have become useless.
        """
        end = self.timesteps + timesteps
        while self.timesteps < end:
            between.before_rollout()
            batch = self.rollout()
            left = 1.0 - self.timesteps / self._total
            orders = [
                torch.randperm(len(batch.rows), generator=self._generator)
                for _ in range(self._ppo.n_epochs)
            ]
            rate = self._share * _at(self._ppo.learning_rate, left)
            losses = self._updater.update(batch, self._ppo.law(left), rate, orders)
            self._adapt(losses.divergence)
            between.rewarded(float(self._rewards.mean()))
            self.timesteps += len(batch.rows)
            self.updates += losses.steps
            if not bool(torch.isfinite(self.both.parameters).all()):
                raise DivergedError(
                    f"the training diverged after {self.timesteps} steps: a weight is not finite; "
                    "take a lower learning_rate"
                )
        between.end()

    def rollout(self) -> Batch:
        """Run all lanes on, and return what the update learns from."""
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
        mean, scale = self._scale()
        values, nexts = mean + scale * values[:-1], mean + scale * nexts
        advantages = estimate_advantages(
            self._rewards, values, nexts, goes_on, self._gamma, self._lambda
        )
        returns = advantages + values
        if self._ppo.normalise_returns:
            self._follow(returns)
        mean, scale = self._scale()
        log_std = float(self.both.log_std)
        densities = -0.5 * noise * noise - (log_std + LOG_SQRT_2_PI)
        flat = [x.flatten() for x in (self._actions, densities, advantages, returns)]
        return Batch(
            self._rows[:-1].flatten(0, 1), flat[0], flat[1], flat[2], (flat[3] - mean) / scale
        )

    def tensors(self) -> Mapping[str, Any]:
        """Return the networks, the optimiser, and the moments of returns."""
        return {
            "parameters": self.both.parameters,
            "optimiser": self._updater.adam.state_dict(),
            "moments": self._moments,
            "share": torch.tensor(self._share, dtype=torch.float64),
        }

    def arrays(self) -> Mapping[str, Any]:
        """Return nothing: there is no replay buffer."""
        return {}

    def restore(self, kept: Kept) -> None:
        """Go on from what a checkpoint holds."""
        self.both.parameters.copy_(kept.tensors["parameters"])
        self._updater.adam.load_state_dict(kept.tensors["optimiser"])
        self._moments.copy_(kept.tensors["moments"])
        self._share = float(kept.tensors["share"])
        self.timesteps, self.updates = kept.timesteps, kept.updates

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

    def _adapt(self, divergence: float) -> None:
        """Lower or raise the learning rate of the next update by how far this one led."""
        target = self._ppo.target_kl
        if target is None or not self._ppo.adaptive_rate:
            return
        if divergence > _TOLERANCE * target:
            self._share = max(self._share / _TOLERANCE, _LEAST_SHARE)
        elif divergence < target / _TOLERANCE:
            self._share = min(self._share * _TOLERANCE, 1.0)

    def _scale(self) -> tuple[float, float]:
        """Return the mean and the deviation that stand for 0 and 1 of the critic."""
        mean, square, share = self._moments.tolist()
        if share == 0.0:
            return 0.0, 1.0
        mean, square = mean / share, square / share
        return mean, max(math.sqrt(max(square - mean * mean, 0.0)), _LEAST_SCALE)

    def _follow(self, returns: Tensor) -> None:
        """Take returns into the running moments; the critic goes on saying what it said."""
        mean, scale = self._scale()
        new = torch.tensor([float(returns.mean()), float((returns * returns).mean()), 1.0])
        self._moments.lerp_(new.double(), self._ppo.return_memory)
        to_mean, to_scale = self._scale()
        weight, bias = self.both.weights[-1][CRITIC], self.both.biases[-1][CRITIC]
        weight.mul_(scale / to_scale)
        bias.mul_(scale / to_scale).add_((mean - to_mean) / to_scale)


def _at(value: float | Callable[[float], float], left: float) -> float:
    return value(left) if callable(value) else value
