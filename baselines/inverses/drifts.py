"""Gain drift and thermal drift undone by the clock, which counts from the episode's start."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from baselines.inverses.base import Inverse, Setting
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.arrays import Array


class DriftInverse(Inverse):
    """An effect that goes by the clock; row of the memory: number of the next sample."""

    rows = 1

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._values = effect.values
        self._ts_s = setting.ts_s

    def start(self, y: Array) -> tuple[Array, Array]:
        """The sample that was held is number 0; nothing has drifted by then."""
        return np.ones((1, len(y))), y.copy()

    def run(self, y: Array, state: Array) -> Array:
        """Undo what has drifted; see :meth:`Inverse.run`."""
        t = self._ts_s * (state[0] + np.arange(len(y))[:, None])
        state[0] += len(y)
        return self._undo(y, t)

    @abstractmethod
    def _undo(self, y: Array, t: Array) -> Array:
        """Return inputs for outputs at times (s)."""


class GainDriftInverse(DriftInverse):
    """Division by the gain.

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

    def _undo(self, y: Array, t: Array) -> Array:
        return y / (1.0 + self._values["rate_per_s"] * t)


class ThermalDriftInverse(DriftInverse):
    """Subtraction of what the warming has added."""

    effect = "thermal_drift"

    def _undo(self, y: Array, t: Array) -> Array:
        tau = self._values["time_constant_s"]
        added: Array = -self._values["rate_um_s"] * tau * np.expm1(-t / tau)
        return y - added
