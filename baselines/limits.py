"""What the amplifier and the action allow: range and largest change of the command."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.support.arrays import Array


class Limits(NamedTuple):
    """Lowest and highest command (V) and its largest change in one sample (V).

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> Limits.of(ObservationLayout.for_plant(named_plant("P5"), ts_s=1e-4))
    Limits(low_V=-25.0, high_V=25.0, step_V=inf)
    """

    low_V: float
    high_V: float
    step_V: float

    @classmethod
    def of(cls, layout: ObservationLayout) -> Limits:
        """Return what a layout allows; only actions read as increments limit the change."""
        low, high = layout.command_range_V
        step = layout.action_scale_V if layout.action == "increment" else math.inf
        return cls(float(low), float(high), float(step))

    @property
    def rest_V(self) -> float:
        """Command nearest 0 V (V), where an episode begins."""
        return min(max(0.0, self.low_V), self.high_V)


@njit(cache=True)
def limited(command: float, last: float, low: float, high: float, step: float) -> float:
    """Return what is allowed of one command (V) after `last` (V; NaN: no command yet)."""
    allowed = min(max(command, low), high)
    if not np.isnan(last):
        allowed = min(max(allowed, last - step), last + step)
    return allowed


@njit(cache=True)
def limit_block(u: Array, last: Array, low: float, high: float, step: float) -> None:
    """Clip commands to their range and to the largest change from sample to sample, in place."""
    for t in range(u.shape[0]):
        for b in range(u.shape[1]):
            last[b] = u[t, b] = limited(u[t, b], last[b], low, high, step)
