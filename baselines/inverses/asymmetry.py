"""Asymmetry undone: the root of y = x + c x²/Y that is zero with y."""

from __future__ import annotations

import numpy as np

from baselines.inverses.base import Inverse, Setting
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.arrays import Array


class AsymmetryInverse(Inverse):
    """The quadratic solved; beyond its vertex the vertex, which comes nearest.

    Examples
    --------
    >>> from rdpi_gym.plant import PAPER_IV_B
    >>> from rdpi_gym.plant.effects import load_effect
    >>> effect = load_effect("asymmetry")(coefficient=0.05, span_um=20.0)
    >>> inverse = AsymmetryInverse(effect, Setting(1e-4, PAPER_IV_B, 40.0, 0.0))
    >>> inverse.run(np.array([[-19.0], [0.0], [21.0]]), np.empty((0, 1)))[:, 0].tolist()
    [-20.0, 0.0, 20.0]
    """

    effect = "asymmetry"

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._square = effect.coefficients(setting.ts_s, setting.hysteresis)[0]

    def run(self, y: Array, state: Array) -> Array:
        """Solve; see :meth:`Inverse.run`."""
        root = np.sqrt(np.maximum(1.0 + 4.0 * self._square * y, 0.0))
        if self._square == 0.0:
            return y.copy()
        reached = np.where(root > 0.0, y, -0.25 / self._square)
        return np.asarray(2.0 * reached / (1.0 + root), dtype=np.float64)
