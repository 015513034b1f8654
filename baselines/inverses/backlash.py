"""Backlash undone: a jump across the gap at every reversal."""

from __future__ import annotations

import numpy as np
from numba import njit

from baselines.inverses.base import Inverse, Setting
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.arrays import Array

# A reversal is one by this share of the scale; less is rounding of the reference.
_REVERSAL = 1e-4


@njit(cache=True)
def jump_block(y: Array, half_width: float, reversal: float, state: Array, x: Array) -> None:
    """Rows of the state: side of the gap (-1, 0, 1), farthest output in that direction (µm)."""
    for t in range(y.shape[0]):
        for b in range(y.shape[1]):
            side, ahead = state[0, b], y[t, b] - state[1, b]
            if side == 0.0:
                if abs(ahead) > reversal:
                    side = np.sign(ahead)
                    state[1, b] = y[t, b]
            elif side * ahead > 0.0:
                state[1, b] = y[t, b]
            elif side * ahead < -reversal:
                side = -side
                state[1, b] = y[t, b]
            state[0, b] = side
            x[t, b] = y[t, b] + side * half_width


class BacklashInverse(Inverse):
    """The inverse of a play: it steps from one side of the gap to the other.

    Examples
    --------
    >>> from rdpi_gym.plant import PAPER_IV_B
    >>> from rdpi_gym.plant.effects import load_effect
    >>> gap = load_effect("backlash")(half_width_um=0.5)
    >>> inverse = BacklashInverse(gap, Setting(1e-4, PAPER_IV_B, 40.0, 0.0))
    >>> state, _ = inverse.start(np.zeros(1))
    >>> inverse.run(np.array([[1.0], [2.0], [2.0], [1.0]]), state)[:, 0].tolist()
    [1.5, 2.5, 2.5, 0.5]
    """

    effect = "backlash"
    rows = 2

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._half_width_um = effect.values["half_width_um"]
        self._reversal_um = _REVERSAL * setting.scale_um

    def start(self, y: Array) -> tuple[Array, Array]:
        """In the middle of the gap."""
        return np.stack([np.zeros(len(y)), y]), y.copy()

    def run(self, y: Array, state: Array) -> Array:
        """Jump; see :meth:`Inverse.run`."""
        x = np.empty_like(y)
        jump_block(y, self._half_width_um, self._reversal_um, state, x)
        return x
