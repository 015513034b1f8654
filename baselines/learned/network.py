"""The networks that policies are made of: linear layers with an activation between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from torch import nn

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

_WIDEST, _DEEPEST = 16_384, 64

ACTIVATIONS: Mapping[str, type[nn.Module]] = {
    each.__name__: each for each in (nn.Tanh, nn.ReLU, nn.ELU, nn.SiLU, nn.Hardtanh)
}
"""What may stand between and behind the linear layers of a network."""


@dataclass(frozen=True)
class Network:
    """The deterministic actor: linear layers with one activation between them and one behind.

    Parameters
    ----------
    widths
        Inputs, hidden units, outputs.
    activation, output
        Names in :data:`ACTIVATIONS`; behind the last layer, what keeps actions within [-1, 1].

    Raises
    ------
    InputError
        Fewer than 2 widths or more than 64, one that is no whole number of 1 to 16,384, or an unknown
        activation.

    Examples
    --------
    >>> [type(module).__name__ for module in Network((9, 64, 1), "ReLU", "Tanh").build()]
    ['Linear', 'ReLU', 'Linear', 'Tanh']
    """

    widths: tuple[int, ...]
    activation: str
    output: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "widths", tuple(self.widths))
        if not 2 <= len(self.widths) <= _DEEPEST or any(
            type(w) is not int or not 1 <= w <= _WIDEST for w in self.widths
        ):
            raise InputError(
                f"network widths are {quoted(list(self.widths))}; give inputs, hidden units and outputs, "
                f"each 1 to {_WIDEST}, {_DEEPEST} at most"
            )
        for name in (self.activation, self.output):
            if not isinstance(name, str) or name not in ACTIVATIONS:
                raise InputError(
                    f"activation {quoted(name)} is unknown; known: {', '.join(ACTIVATIONS)}"
                )

    def build(self) -> nn.Sequential:
        """Return the network, weights not yet trained."""
        modules: list[nn.Module] = []
        for inputs, outputs in zip(self.widths[:-1], self.widths[1:], strict=True):
            modules += [nn.Linear(inputs, outputs), ACTIVATIONS[self.activation]()]
        return nn.Sequential(*modules[:-1], ACTIVATIONS[self.output]())

    @classmethod
    def of(cls, modules: Sequence[nn.Module]) -> Network:
        """Describe linear layers with activations between and behind them."""
        linear = [module for module in modules[::2] if isinstance(module, nn.Linear)]
        between = {type(module).__name__ for module in modules[1:-1:2]}
        if len(linear) * 2 != len(modules) or len(between) > 1:
            shown = ", ".join(type(module).__name__ for module in modules)
            raise InputError(
                f"an actor of {shown} cannot be kept; train one of linear layers with one activation"
            )
        widths = (linear[0].in_features, *(layer.out_features for layer in linear))
        last = type(modules[-1]).__name__
        return cls(widths, next(iter(between), last), last)
