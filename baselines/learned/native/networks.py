"""Actor and critic as one batch of two networks, forwards and backwards, in few large products."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from baselines.learned.policy import Network

ACTOR, CRITIC, BOTH = 0, 1, 2
"""Which of the two networks runs."""
_PARTS = (slice(0, 1), slice(1, 2), slice(0, 2))
_GAINS = (0.01, 1.0)  # of the last layers, as Stable-Baselines3 draws them


class Workspace:
    """Layers that a pass over rows writes over; each thread has its own.

    Parameters
    ----------
    widths
        Inputs, hidden units, and the one output.
    """

    def __init__(self, widths: Sequence[int]) -> None:
        self._widths = tuple(widths)
        self._made: dict[tuple[int, int], tuple[list[Tensor], list[Tensor]]] = {}
        self._rows: dict[int, Tensor] = {}

    def gather(self, rows: Tensor, chosen: Tensor) -> Tensor:
        """Return some rows ``(N, inputs)``, copied; valid until as many are gathered again."""
        if len(chosen) not in self._rows:
            self._rows[len(chosen)] = self._empty(len(chosen), self._widths[0])
        return torch.index_select(rows, 0, chosen, out=self._rows[len(chosen)])

    def layers(self, rows: int, nets: int) -> tuple[list[Tensor], list[Tensor]]:
        """Return two arrays ``(nets, rows, width)`` for each layer: its values, and their gradient."""
        if (rows, nets) not in self._made:
            values, gradients = (
                [self._empty(nets, rows, width) for width in self._widths[1:]] for _ in range(2)
            )
            self._made[rows, nets] = values, gradients
        return self._made[rows, nets]

    def _empty(self, *shape: int) -> Tensor:
        return torch.empty(shape)


class ActorCritic:
    """Two networks of one shape, tanh between their layers, and the exploration's deviation.

    All parameters stand in one vector, and so do gradients: an optimiser has one tensor to step.

    Parameters
    ----------
    widths
        Inputs, hidden units, and the one output.
    log_std
        Logarithm of the exploration's standard deviation at the start.
    seed
        Of the weights: orthogonal, as Stable-Baselines3 draws them.

    Attributes
    ----------
    parameters : float32[P]
        Layer by layer the weights ``(2, inputs, outputs)`` and biases ``(2, 1, outputs)`` of actor and
        critic; `log_std` last.
    weights, biases, log_std
        Views of it.

    Raises
    ------
    InputError
        Widths of which no network can be made.

    Examples
    --------
    >>> both = ActorCritic((3, 8, 1), log_std=-1.0, seed=0)
    >>> both.forward(torch.zeros(5, 3), Workspace(both.widths)).shape
    torch.Size([2, 5, 1])
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
