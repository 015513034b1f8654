"""What the networks are shown, on tensors: observations scaled, with their history."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from rdpi_gym.envs.wrappers.scaling import Scaling


class Rows:
    """Makes of observations what :class:`~rdpi_gym.envs.wrappers.scaling.Scaling` makes of them.

    Parameters
    ----------
    scaling
        From observations with their history to rows.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.envs.wrappers.history import History
    >>> layout = ObservationLayout(1, 0.0, 1.0, (-1.0, 1.0), 1e-4)
    >>> rows = Rows(Scaling(History(layout, 1), error=0.1))
    >>> rows.first(torch.tensor([[0.5, 0.5, 0.25, 0.0]])).tolist()
    [[0.5, 0.0, 0.0, 2.5, 2.5, 0.0, 0.0]]
    """

    def __init__(self, scaling: Scaling) -> None:
        layout = scaling.history.layout
        self._preview, self._steps = layout.preview, scaling.history.steps
        # Of an increment of one in a sample, and of an error of one.
        self._moved = 2.0 * math.pi * scaling.frequency_hz * layout.ts_s
        self._error = scaling.error

    def first(self, observed: Tensor) -> Tensor:
        """Return the rows ``float32[B, size]`` of episodes that begin with observations ``[B, D]``."""
        reference, ahead, error, command = self._now(observed)
        still = torch.zeros_like(command).expand(-1, self._steps)
        errors = error.expand(-1, self._steps + 1)
        return torch.cat([reference, ahead, still, errors, command, still], dim=1)

    def next(self, before: Tensor, observed: Tensor) -> Tensor:
        """Return the rows that follow rows ``float32[B, size]`` once ``[B, D]`` is observed."""
        p, steps = self._preview, self._steps
        reference, ahead, error, command = self._now(observed)
        if steps == 0:
            return torch.cat([reference, ahead, error, command], dim=1)
        at = p + steps + 1  # the newest error
        last = at + steps + 1  # the command
        change = (command - before[:, last : last + 1]) / self._moved
        # What lay ahead is past; of the rest the oldest is forgotten.
        past = before[:, 1:2], before[:, p + 1 : p + steps]
        errors, changes = before[:, at : at + steps], before[:, last + 1 : last + steps]
        return torch.cat([reference, ahead, *past, error, errors, command, change, changes], dim=1)

    def _now(self, observed: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        p = self._preview
        reference, ends = observed[:, :1], observed[:, 1 : p + 1]
        ahead = (ends - observed[:, :p]) / self._moved
        error = (reference - observed[:, p + 1 : p + 2]) / self._error
        return reference, ahead, error, observed[:, p + 2 : p + 3]
