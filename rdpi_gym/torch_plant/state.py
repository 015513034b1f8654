"""What plants on a device remember from one step to the next."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

ROW = torch.float64
"""Type of what a lane has one of: command, rate, displacement, and the states of effects."""


class State(NamedTuple):
    """What a plant remembers: everything that a step changes.

    Parameters
    ----------
    u_V
        Command that the plays saw last (V), ``float64[B]``; NaN before a record begins.
    rate_V_s
        Its rate (V/s), ``float64[B]``.
    held_V
        What the converter holds (V), ``float64[B]``.
    samples
        Steps since the last reset of all lanes, or of those of which a lane is a copy, ``int64[B]``.
    awaits
        Whether the memory of the plant's own past is set as the first sample comes, ``bool[B]``.
    xi_V
        Play states (V), n times ``[B]`` in the plant's dtype.
    effects
        One ``float64[S, B]`` an effect, in the chain's order.
    """

    u_V: Tensor
    rate_V_s: Tensor
    held_V: Tensor
    samples: Tensor
    awaits: Tensor
    xi_V: tuple[Tensor, ...]
    effects: tuple[Tensor, ...]

    def tensors(self) -> tuple[Tensor, ...]:
        """All of them, one after the other."""
        return (*self[:5], *self.xi_V, *self.effects)

    def mapped(self, change: Callable[[Tensor], Tensor]) -> State:
        """A state of what a function makes of each tensor."""
        u, v, held, samples, awaits = map(change, self[:5])
        xi, effects = (tuple(map(change, part)) for part in self[5:])
        return State(u, v, held, samples, awaits, xi, effects)

    def clone(self) -> State:
        """A copy that shares no memory."""
        return self.mapped(torch.clone)
