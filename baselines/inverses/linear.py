"""Linear effects undone by derivatives of the reference over a window around each sample."""

from __future__ import annotations

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
