"""Hyper-parameters of the native PPO, and one update: gradients over minibatches and their bounds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from baselines.learned.native.networks import ActorCritic, Workspace
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite, is_whole
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted


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
            self.batch_size, self.n_epochs, at(self.clip_range, left), self.target_kl,
            self.ent_coef, self.vf_coef, self.max_grad_norm,
        )  # fmt: skip


def at(value: float | Callable[[float], float], left: float) -> float:
    """Return a number, or what a schedule of the share that is left says."""
    return value(left) if callable(value) else value


_ROWS = 1024
"""Rows of a pass: enough to hide the overhead of Python, few enough for the caches."""
LOG_SQRT_2_PI = 0.5 * math.log(2.0 * math.pi)


@dataclass(frozen=True)
class Law:
    """Numbers of PPO's loss and of its steps; names as Stable-Baselines3 has them."""

    batch_size: int
    n_epochs: int
    # Rows of a gradient step; times that each rollout is gone through.
    clip_range: float = 0.2
    # How far the ratio of probabilities may leave 1.
    target_kl: float | None = None
    # An update ends where the approximate divergence from the policy that acted is 1.5 times this;
    # None: it never does.
    ent_coef: float = 0.0
    vf_coef: float = 0.5
    # Weights of the entropy and of the critic's squared error in the loss.
    max_grad_norm: float = 0.5
    # Norm that gradients are clipped to.


class Batch(NamedTuple):
    """Data of a rollout for an update, N rows."""

    rows: Tensor  # float32[N, D]: scaled observations
    actions: Tensor  # float32[N]
    densities: Tensor  # float32[N]: logarithms, of the policy that acted
    advantages: Tensor  # float32[N]
    returns: Tensor  # float32[N]: in units of the critic


class Losses(NamedTuple):
    """Losses of an update: means over its minibatches; the divergence is the last one's."""

    policy: float
    value: float
    divergence: float  # approximate, from the policy that acted
    clipped: float  # share of the rows
    steps: int


class _Part:
    """Sums of one thread: gradient, losses."""

    def __init__(self, both: ActorCritic) -> None:
        self.gradient = torch.zeros_like(both.parameters)
        self.weights, self.biases, self.log_std = both.views(self.gradient)
        self.work = Workspace(both.widths)
        self.sums = np.zeros(4)


def estimate_advantages(
    rewards: Tensor, values: Tensor, nexts: Tensor, goes_on: Tensor, gamma: float, fading: float
) -> Tensor:
    """Return advantages ``(T, B)``, estimated in the generalised way (Schulman et al., 2016)."""
    surprise = rewards + gamma * nexts - values
    passed_on = gamma * fading * goes_on
    advantages, ahead = torch.empty_like(rewards), torch.zeros_like(rewards[0])
    for k in reversed(range(len(rewards))):
        ahead = torch.addcmul(surprise[k], passed_on[k], ahead, out=advantages[k])
    return advantages


class Updater:
    """Makes updates of two networks by Adam.

    Parameters
    ----------
    both
        The networks.
    threads
        That share a minibatch; their number may show in the last digits.

    Attributes
    ----------
    adam
        The optimiser, of one tensor.
    """

    def __init__(self, both: ActorCritic, threads: int = 1) -> None:
        self.both = both
        self.adam = torch.optim.Adam([both.parameters], eps=1e-5, fused=True)
        self._parts = [_Part(both) for _ in range(threads)]
        both.parameters.grad = self._parts[0].gradient
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def update(self, batch: Batch, law: Law, rate: float, orders: Sequence[Tensor]) -> Losses:
        """Go through a batch, minibatch by minibatch."""
        self.adam.param_groups[0]["lr"] = rate
        found: list[Array] = []
        steps = 0
        for order in orders:
            for chosen in torch.split(order, law.batch_size):
                found.append(self._gradient(batch, law, chosen))
                if law.target_kl is not None and found[-1][2] > 1.5 * law.target_kl:
                    return _means(found, steps)
                self._step(law.max_grad_norm)
                steps += 1
        return _means(found, steps)

    def state(self) -> Mapping[str, Any]:
        """Return what its next step depends on."""
        return self.adam.state_dict()

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from what :meth:`state` returned."""
        self.adam.load_state_dict(dict(state))

    def each(self, call: Callable[[int], None], count: int) -> None:
        """Call with 0 ... count - 1, in threads where there are several."""
        if self._pool is None or count == 1:
            for i in range(count):
                call(i)
        else:
            list(self._pool.map(call, range(count)))

    def _gradient(self, batch: Batch, law: Law, chosen: Tensor) -> Array:
        advantages = batch.advantages[chosen]
        if len(chosen) > 1:
            advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        shares = list(
            zip(
                chosen.tensor_split(len(self._parts)),
                advantages.tensor_split(len(self._parts)),
                strict=True,
            )
        )

        def run(i: int) -> None:
            part = self._parts[i]
            part.gradient.zero_()
            part.sums[:] = 0.0
            for rows, own in zip(
                torch.split(shares[i][0], _ROWS), torch.split(shares[i][1], _ROWS), strict=True
            ):
                self._add(part, batch, law, rows, own, len(chosen))

        self.each(run, len(self._parts))
        first, *others = self._parts
        for other in others:
            first.gradient.add_(other.gradient)
            first.sums += other.sums
        first.log_std.sub_(law.ent_coef)
        return first.sums / len(chosen)

    def _add(
        self, part: _Part, batch: Batch, law: Law, chosen: Tensor, advantages: Tensor, count: int
    ) -> None:
        """Add what some rows of a minibatch of `count` give."""
        both, work = self.both, part.work
        rows = work.gather(batch.rows, chosen)
        mean, value = (out[:, 0].numpy() for out in both.forward(rows, work))
        actions, densities, returns = (
            each.index_select(0, chosen).numpy()
            for each in (batch.actions, batch.densities, batch.returns)
        )
        log_std, wanted = float(both.log_std), advantages.numpy()
        away = (actions - mean) * np.float32(math.exp(-log_std))
        squares = away * away
        change = np.float32(-log_std - LOG_SQRT_2_PI) - 0.5 * squares - densities
        ratio = np.exp(change)
        moved = ratio - 1.0
        gain = ratio * wanted
        bounded = np.clip(ratio, 1.0 - law.clip_range, 1.0 + law.clip_range) * wanted
        missed = value - returns
        # The loss falls with the smaller of both: where that is the bounded one, it has no slope.
        pull = np.where(gain <= bounded, gain, np.float32(0.0)) * np.float32(-1.0 / count)
        slopes = work.layers(len(rows), 2)[1][-1].numpy()
        np.multiply(pull, away * np.float32(math.exp(-log_std)), out=slopes[0, :, 0])
        np.multiply(missed, np.float32(2.0 * law.vf_coef / count), out=slopes[1, :, 0])
        part.log_std.add_(float(pull @ (squares - 1.0)))
        both.backward(rows, work, (part.weights, part.biases))
        part.sums += (
            -float(np.minimum(gain, bounded).sum()),
            float(missed @ missed),
            float((moved - change).sum()),
            float(np.count_nonzero(np.abs(moved) > law.clip_range)),
        )

    def _step(self, largest: float) -> None:
        gradient = self._parts[0].gradient
        norm = float(gradient.norm())
        if norm > largest:
            gradient.mul_(largest / (norm + 1e-6))
        self.adam.step()


def _means(found: Sequence[Array], steps: int) -> Losses:
    policy, value, _, clipped = np.mean(found, axis=0).tolist()
    return Losses(policy, value, float(found[-1][2]), clipped, steps)
