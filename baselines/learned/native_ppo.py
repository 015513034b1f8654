"""PPO of our own: networks, hyper-parameters, and updates by gradients in few large products."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from baselines.learned.policy import Network
from rdpi_gym.support.checks import is_finite, is_whole
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

ACTOR, CRITIC, BOTH = 0, 1, 2
"""Which of the two networks runs."""
_PARTS = (slice(0, 1), slice(1, 2), slice(0, 2))
_GAINS = (0.01, 1.0)  # of the last layers, as Stable-Baselines3 draws them


class Workspace:
    """Layers of networks of these widths that a pass over rows writes over; each thread has its own."""

    def __init__(self, widths: Sequence[int]) -> None:
        self._widths = tuple(widths)
        self._made: dict[tuple[int, int], tuple[list[Tensor], list[Tensor]]] = {}
        self._rows: dict[int, Tensor] = {}

    def gather(self, rows: Tensor, chosen: Tensor) -> Tensor:
        """Return some rows ``(N, inputs)``, copied; valid until as many are gathered again."""
        if len(chosen) not in self._rows:
            self._rows[len(chosen)] = torch.empty(len(chosen), self._widths[0])
        return torch.index_select(rows, 0, chosen, out=self._rows[len(chosen)])

    def layers(self, rows: int, nets: int) -> tuple[list[Tensor], list[Tensor]]:
        """Return two arrays ``(nets, rows, width)`` for each layer: its values, and their gradient."""
        if (rows, nets) not in self._made:
            values, gradients = (
                [torch.empty(nets, rows, width) for width in self._widths[1:]] for _ in range(2)
            )
            self._made[rows, nets] = values, gradients
        return self._made[rows, nets]


class ActorCritic:
    """Two networks of one shape, tanh between their layers, and the exploration's deviation.

    All parameters are one vector, and so are gradients, so that an optimiser has one tensor to step:
    layer by layer the weights ``(2, inputs, outputs)`` and biases ``(2, 1, outputs)``, `log_std` last.
    Weights are drawn as Stable-Baselines3 draws them.
    """

    def __init__(self, widths: Sequence[int], log_std: float, seed: int) -> None:
        self._kind = Network(tuple(widths), "Tanh", "Hardtanh")
        self.widths = self._kind.widths
        sizes = zip(self.widths[:-1], self.widths[1:], strict=True)
        self.parameters = torch.zeros(sum(2 * b * (a + 1) for a, b in sizes) + 1)
        self.weights, self.biases, self.log_std = self.views(self.parameters)
        self.log_std.fill_(log_std)
        generator = torch.Generator().manual_seed(seed)
        for weight in self.weights:
            for net, last in zip(weight, _GAINS, strict=True):
                gain = last if weight is self.weights[-1] else math.sqrt(2.0)
                nn.init.orthogonal_(net.T, gain, generator)
        self._passes = [[(w[part], b[part]) for w, b in self._layers()] for part in _PARTS]

    def views(self, flat: Tensor) -> tuple[list[Tensor], list[Tensor], Tensor]:
        """Return weights, biases and `log_std` as they stand in a vector like `parameters`."""
        weights, biases, at = [], [], 0
        for inputs, outputs in zip(self.widths[:-1], self.widths[1:], strict=True):
            own = flat[at : at + 2 * outputs * inputs]
            # Of a single column it decides its strides by which routine products are made.
            column = own.view(2, outputs, inputs).transpose(1, 2)
            weights.append(column if outputs == 1 else own.view(2, inputs, outputs))
            at += len(own)
            biases.append(flat[at : at + 2 * outputs].view(2, 1, outputs))
            at += 2 * outputs
        return weights, biases, flat[at]

    def forward(self, rows: Tensor, work: Workspace, nets: int = BOTH) -> Tensor:
        """Run rows through one network or both."""
        passes = self._passes[nets]
        layers, _ = work.layers(len(rows), len(passes[0][0]))
        below = rows.expand(len(passes[0][0]), -1, -1)
        for (weight, bias), layer in zip(passes, layers, strict=True):
            torch.baddbmm(bias, below, weight, out=layer)
            if layer is not layers[-1]:
                # NumPy's takes a sixth of the time of torch's, with the same accuracy.
                np.tanh(layer.numpy(), out=layer.numpy())
            below = layer
        return below

    def backward(
        self, rows: Tensor, work: Workspace, gradients: tuple[list[Tensor], list[Tensor]]
    ) -> None:
        """Add the gradient of a loss over the rows that :meth:`forward` took through both networks."""
        layers, slopes = work.layers(len(rows), 2)
        for i in reversed(range(len(layers))):
            below = layers[i - 1] if i else rows.expand(2, -1, -1)
            if i == len(layers) - 1:
                gradients[0][i].transpose(1, 2).baddbmm_(slopes[i].transpose(1, 2), below)
            else:
                gradients[0][i].baddbmm_(below.transpose(1, 2), slopes[i])
            gradients[1][i].add_(slopes[i].sum(dim=1, keepdim=True))
            if i:
                product = torch.mul if i == len(layers) - 1 else torch.bmm
                product(slopes[i], self.weights[i].transpose(1, 2), out=slopes[i - 1])
                torch.ops.aten.tanh_backward.grad_input(
                    slopes[i - 1], layers[i - 1], grad_input=slopes[i - 1]
                )

    def actor(self) -> list[nn.Module]:
        """Return the deterministic actor: the mean, clipped as actions are."""
        modules = list(self._kind.build())
        linear = [module for module in modules if isinstance(module, nn.Linear)]
        for module, (weight, bias) in zip(linear, self._layers(), strict=True):
            module.weight.data.copy_(weight[0].T)
            module.bias.data.copy_(bias[0, 0])
        return modules

    def _layers(self) -> list[tuple[Tensor, Tensor]]:
        return list(zip(self.weights, self.biases, strict=True))


@dataclass(frozen=True)
class NativePPO:
    """Hyper-parameters; those that Stable-Baselines3 has too mean the same and have its names.

    Parameters
    ----------
    learning_rate, clip_range
        Numbers, or functions of the share of the training that is left.
    n_steps
        Steps of each lane in a rollout.
    batch_size, n_epochs
        Rows of a gradient step; times that each rollout is gone through.
    target_kl
        An update ends where the approximate divergence from the policy that acted is 1.5 times this;
        None: it never does.
    ent_coef, vf_coef
        Weights of the entropy and of the critic's squared error in the loss.
    max_grad_norm
        Norm that gradients are clipped to.
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


def at(value: float | Callable[[float], float], left: float) -> float:
    """Return a number, or what a schedule of the share that is left says."""
    return value(left) if callable(value) else value


_ROWS = 1024
"""Rows of a pass: enough to hide the overhead of Python, few enough for the caches."""
LOG_SQRT_2_PI = 0.5 * math.log(2.0 * math.pi)


class Batch(NamedTuple):
    """Data of a rollout for an update, N rows."""

    rows: Tensor  # float32[N, D]: scaled observations
    actions: Tensor  # float32[N]
    densities: Tensor  # float32[N]: logarithms, of the policy that acted
    advantages: Tensor  # float32[N]
    returns: Tensor  # float32[N]: in units of the critic


class _Part:
    """Sums of one thread: gradient, and divergence from the policy that acted."""

    def __init__(self, both: ActorCritic) -> None:
        self.gradient = torch.zeros_like(both.parameters)
        self.weights, self.biases, self.log_std = both.views(self.gradient)
        self.work = Workspace(both.widths)
        self.divergence = 0.0


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
    """Updates of two networks by Adam; the number of threads may show in the last digits."""

    def __init__(self, both: ActorCritic, threads: int = 1) -> None:
        self.both = both
        self.adam = torch.optim.Adam([both.parameters], eps=1e-5, fused=True)
        self._parts = [_Part(both) for _ in range(threads)]
        both.parameters.grad = self._parts[0].gradient
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def update(
        self, batch: Batch, ppo: NativePPO, rate: float, clip: float, orders: Sequence[Tensor]
    ) -> tuple[float, int]:
        """Go through a batch; return the divergence of the last minibatch, and the steps made."""
        self.adam.param_groups[0]["lr"] = rate
        divergence, steps = 0.0, 0
        for order in orders:
            for chosen in torch.split(order, ppo.batch_size):
                divergence = self._gradient(batch, ppo, clip, chosen)
                if ppo.target_kl is not None and divergence > 1.5 * ppo.target_kl:
                    return divergence, steps
                self._step(ppo.max_grad_norm)
                steps += 1
        return divergence, steps

    def each(self, call: Callable[[int], None], count: int) -> None:
        """Call with 0 ... count - 1, in threads where there are several."""
        if self._pool is None or count == 1:
            for i in range(count):
                call(i)
        else:
            list(self._pool.map(call, range(count)))

    def _gradient(self, batch: Batch, ppo: NativePPO, clip: float, chosen: Tensor) -> float:
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
            part.divergence = 0.0
            for rows, own in zip(
                torch.split(shares[i][0], _ROWS), torch.split(shares[i][1], _ROWS), strict=True
            ):
                self._add(part, batch, (clip, ppo.vf_coef), rows, own, len(chosen))

        self.each(run, len(self._parts))
        first, *others = self._parts
        for other in others:
            first.gradient.add_(other.gradient)
            first.divergence += other.divergence
        first.log_std.sub_(ppo.ent_coef)
        return first.divergence / len(chosen)

    def _add(
        self,
        part: _Part,
        batch: Batch,
        weights: tuple[float, float],
        chosen: Tensor,
        advantages: Tensor,
        count: int,
    ) -> None:
        """Add what some rows of a minibatch of `count` give."""
        both, work, (clip, vf_coef) = self.both, part.work, weights
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
        gain = ratio * wanted
        bounded = np.clip(ratio, 1.0 - clip, 1.0 + clip) * wanted
        missed = value - returns
        # The loss falls with the smaller of both: where that is the bounded one, it has no slope.
        pull = np.where(gain <= bounded, gain, np.float32(0.0)) * np.float32(-1.0 / count)
        slopes = work.layers(len(rows), 2)[1][-1].numpy()
        np.multiply(pull, away * np.float32(math.exp(-log_std)), out=slopes[0, :, 0])
        np.multiply(missed, np.float32(2.0 * vf_coef / count), out=slopes[1, :, 0])
        part.log_std.add_(float(pull @ (squares - 1.0)))
        both.backward(rows, work, (part.weights, part.biases))
        part.divergence += float((ratio - 1.0 - change).sum())

    def _step(self, largest: float) -> None:
        gradient = self._parts[0].gradient
        norm = float(gradient.norm())
        if norm > largest:
            gradient.mul_(largest / (norm + 1e-6))
        self.adam.step()
