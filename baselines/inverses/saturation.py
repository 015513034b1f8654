"""Saturation undone: the inverse hyperbolic tangent of the wanted voltage, or its nearest rail."""

from __future__ import annotations

import numpy as np

from baselines.inverses.base import Inverse, Setting
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.arrays import Array

# Voltages are kept within this share of the rails, where the inverse is finite.
_REACHED = 1.0 - 1e-9


class SaturationInverse(Inverse):
    """Harder commands where the amplifier softens.

    Examples
    --------
    >>> from rdpi_gym.plant import PAPER_IV_B
    >>> from rdpi_gym.plant.effects import load_effect
    >>> amplifier = load_effect("saturation")(limit_V=100.0)
    >>> inverse = SaturationInverse(amplifier, Setting(1e-4, PAPER_IV_B, 40.0, 0.0))
    >>> wanted = amplifier.run([-30.0, 50.0], 1e-4)[:, None]
    >>> inverse.run(wanted, np.empty((0, 1))).round(9)[:, 0].tolist()
    [-30.0, 50.0]
    """

    effect = "saturation"
    forms = ("", "soft unlike rails")

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._limit_V = effect.values["limit_V"]
        self._centre_V = effect.values["centre_V"]

    def run(self, y: Array, state: Array) -> Array:
        """Invert the curve; see :meth:`Inverse.run`."""
        share = np.clip((y - self._centre_V) / self._limit_V, -_REACHED, _REACHED)
        return np.asarray(self._centre_V + self._limit_V * np.arctanh(share), dtype=np.float64)


class KneeInverse(Inverse):
    """Harder commands above the knee: v / (1 - |v|^p)^(1/p) of the share v of the rails.

    Examples
    --------
    >>> from rdpi_gym.plant import PAPER_IV_B
    >>> from rdpi_gym.plant.effects import load_effect
    >>> amplifier = load_effect("saturation", "rails with a knee")(100.0, 0.0, sharpness=4.0)
    >>> inverse = KneeInverse(amplifier, Setting(1e-4, PAPER_IV_B, 40.0, 0.0))
    >>> wanted = amplifier.run([-30.0, 150.0], 1e-4)[:, None]
    >>> inverse.run(wanted, np.empty((0, 1))).round(9)[:, 0].tolist()
    [-30.0, 150.0]
    """

    effect = "saturation"
    forms = ("rails with a knee",)

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._limit_V, self._centre_V, self._sharpness = effect.values.values()

    def run(self, y: Array, state: Array) -> Array:
        """Invert the curve; see :meth:`Inverse.run`."""
        share = np.clip((y - self._centre_V) / self._limit_V, -_REACHED, _REACHED)
        softening = (1.0 - np.abs(share) ** self._sharpness) ** (1.0 / self._sharpness)
        return np.asarray(self._centre_V + self._limit_V * share / softening, dtype=np.float64)


class HardRailsInverse(Inverse):
    """The wanted voltage itself, and where it is beyond a rail that rail, which comes nearest.

    Examples
    --------
    >>> from rdpi_gym.plant import PAPER_IV_B
    >>> from rdpi_gym.plant.effects import load_effect
    >>> amplifier = load_effect("saturation", "hard rails")(low_V=-22.0, high_V=19.0)
    >>> inverse = HardRailsInverse(amplifier, Setting(1e-4, PAPER_IV_B, 40.0, 0.0))
    >>> inverse.run(np.array([[-30.0], [5.0], [20.0]]), np.empty((0, 1)))[:, 0].tolist()
    [-22.0, 5.0, 19.0]
    """

    effect = "saturation"
    forms = ("hard upper rail", "hard lower rail", "hard rails")

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._low_V, self._high_V = effect.coefficients(setting.ts_s, setting.hysteresis)

    def run(self, y: Array, state: Array) -> Array:
        """Clip; see :meth:`Inverse.run`."""
        return np.asarray(np.clip(y, self._low_V, self._high_V), dtype=np.float64)
