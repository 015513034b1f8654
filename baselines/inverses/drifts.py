"""Gain drift and thermal drift undone by the clock, which counts from the episode's start."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from baselines.inverses.base import Inverse, Setting
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.arrays import Array


class GainDriftInverse(Inverse):
    """Division by the gain, in any form: what the effect makes of one micrometre at that time.

    Row of the memory: number of the next sample.

    Examples
    --------
    >>> from rdpi_gym.plant import PAPER_IV_B
    >>> from rdpi_gym.plant.effects import load_effect
    >>> effect = load_effect("gain_drift")(rate_per_s=0.001)
    >>> inverse = GainDriftInverse(effect, Setting(5.0, PAPER_IV_B, 40.0, 0.0))
    >>> state, _ = inverse.start(np.array([10.0]))
    >>> inverse.run(np.array([[10.05], [10.1]]), state).round(9)[:, 0].tolist()
    [10.0, 10.0]
    """

    effect = "gain_drift"
    forms: ClassVar[tuple[str, ...]] = ("", "to a limit", "piecewise linear", "smooth curve")
    rows = 1

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._block = type(effect).block
        self._column = np.array(effect.coefficients(setting.ts_s, setting.hysteresis))
        self._ts_s = setting.ts_s

    def start(self, y: Array) -> tuple[Array, Array]:
        """The sample that was held is number 0; nothing has drifted by then."""
        return np.ones((1, len(y))), y.copy()

    def run(self, y: Array, state: Array) -> Array:
        """Undo what has drifted; see :meth:`Inverse.run`."""
        undone: Array = y / self._of(np.ones_like(y), state)
        return undone

    def _of(self, x: Array, state: Array) -> Array:
        """Return what the effect makes of a displacement (µm) at the samples that come now."""
        p = np.repeat(self._column[:, None], x.shape[1], axis=1)
        out = np.empty_like(x)
        self._block(x, x, p, state, self._ts_s, out)
        return out


class ThermalDriftInverse(GainDriftInverse):
    """Subtraction of what the warming adds, in any form: what the effect makes of no displacement."""

    effect = "thermal_drift"
    forms = ("", "two time constants", "piecewise linear", "smooth curve")

    def run(self, y: Array, state: Array) -> Array:
        """Undo what has drifted; see :meth:`Inverse.run`."""
        undone: Array = y - self._of(np.zeros_like(y), state)
        return undone
