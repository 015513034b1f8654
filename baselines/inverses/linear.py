"""Inverses of lags and resonance: derivatives of the reference over a window around each sample."""

from __future__ import annotations

import math
from abc import abstractmethod

import numpy as np

from baselines.inverses.base import Setting
from baselines.inverses.preview_filter import (
    PreviewFilter,
    inverse_series,
    preview_weights,
)
from rdpi_gym.plant.effects import Effect

_MOST = 20


class LinearInverse(PreviewFilter):
    """A linear effect whose inverse is a sum of derivatives; a subclass says over which time.

    Where fewer samples are shown than half of the window, it reaches further back instead: it
    stays exact for parabolas, and lags behind a reference that changes faster.
    """

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        half = self.wanted_ahead(effect, setting.ts_s)
        order = min(3, 2 * half) if self.ahead == half else 2
        series = inverse_series(effect.coefficients(setting.ts_s, setting.hysteresis), order)
        self._set(preview_weights(series, np.arange(self.ahead - 2 * half, self.ahead + 1)))

    @classmethod
    def wanted_ahead(cls, effect: Effect, ts_s: float) -> int:
        """Half of the window (samples): 1 to 20."""
        return int(min(max(round(cls.half_window_s(effect) / ts_s), 1), _MOST))

    @classmethod
    @abstractmethod
    def half_window_s(cls, effect: Effect) -> float:
        """Return the time (s) over which the reference is smooth where the effect matters."""


class SensorLagInverse(LinearInverse):
    """The lag behind the mechanics, by a derivative over a tenth of its time constant either way.

    Examples
    --------
    >>> from baselines.inverses.base import Setting
    >>> from rdpi_gym.plant import PAPER_IV_B
    >>> from rdpi_gym.plant.effects import load_effect
    >>> lag, setting = load_effect("sensor_lag")(2e-4), Setting(1e-4, PAPER_IV_B, 40.0, 0.0)
    >>> SensorLagInverse(lag, setting, ahead=1).weights.round(3).tolist()
    [-1.083, 1.166, 0.917]
    """

    effect = "sensor_lag"
    forms = ("", "second order", "third order")
    urgency = 2

    @classmethod
    def half_window_s(cls, effect: Effect) -> float:
        """Return a tenth of the time constant (s), or of the sum of both."""
        values = effect.values
        return 0.1 * values["time_constant_s"] * (1.0 + values.get("second_ratio", 0.0))


class ActuatorLagInverse(SensorLagInverse):
    """The lag in front of the hysteresis."""

    effect = "actuator_lag"
    urgency = 1


class ResonanceInverse(LinearInverse):
    """One mode or two, by derivatives over a tenth of its period either way.

    Examples
    --------
    >>> from baselines.inverses.base import Setting
    >>> from rdpi_gym.plant import PAPER_IV_B
    >>> from rdpi_gym.plant.effects import load_effect
    >>> mode = load_effect("resonance")(f0_hz=1000.0, damping=0.02)
    >>> inverse = ResonanceInverse(mode, Setting(5e-5, PAPER_IV_B, 40.0, 0.0), ahead=2)
    >>> inverse.ahead, inverse.rows, float(inverse.weights.sum().round(12))
    (2, 4, 1.0)
    """

    effect = "resonance"
    forms = ("", "with a zero", "two modes")
    urgency = 3

    @classmethod
    def half_window_s(cls, effect: Effect) -> float:
        """Return a tenth of the period (s), of two modes that of the slower one."""
        values = effect.values
        return 0.1 / min(values["f0_hz"], values.get("second_hz", math.inf))
