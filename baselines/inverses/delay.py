"""Delay undone: the reference that is due when the answer arrives."""

from __future__ import annotations

import math

import numpy as np

from baselines.inverses.base import Setting
from baselines.inverses.preview_filter import (
    PreviewFilter,
    power_ratio,
    powers_of_theta,
    preview_weights,
)
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.arrays import Array


class DelayInverse(PreviewFilter):
    """A shift by whole samples, and a cubic through four of them for the rest.

    Where fewer samples are shown than the delay takes, the last two are continued in a straight
    line.

    Examples
    --------
    >>> from rdpi_gym.plant import PAPER_IV_B
    >>> from rdpi_gym.plant.effects import load_effect
    >>> setting = Setting(1e-4, PAPER_IV_B, 40.0, 0.0)
    >>> inverse = DelayInverse(load_effect("delay")(delay_s=3e-4), setting, ahead=8)
    >>> inverse.ahead, inverse.weights.tolist()
    (3, [1.0])
    >>> short = DelayInverse(load_effect("delay")(delay_s=3e-4), setting, ahead=1)
    >>> short.ahead, short.weights.round(6).tolist()
    (1, [-2.0, 3.0])
    """

    effect = "delay"
    forms = ("", "whole samples")
    urgency = 4

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        whole, part = _samples(effect, setting.ts_s)
        if self.ahead < self.wanted_ahead(effect, setting.ts_s):
            missing = whole + part - self.ahead
            self._set(preview_weights(np.array([1.0, missing]), np.array([-1, 0])))
        else:
            self._set(delay_weights(effect, setting.ts_s)[0])

    @classmethod
    def wanted_ahead(cls, effect: Effect, ts_s: float) -> int:
        """Whole samples of the delay, and two more where it is no whole number of them."""
        whole, part = _samples(effect, ts_s)
        return whole + (2 if part else 0)


def delay_weights(effect: Effect, ts_s: float) -> tuple[Array, Array]:
    """Weights that undo a delay, and the offsets (samples) of what they weigh."""
    whole, part = _samples(effect, ts_s)
    if part == 0.0:
        return np.ones(1), np.array([float(whole)])
    # linear between samples, the plant mixes two of them: (1 - part) + part / z
    mixed = powers_of_theta([part, 1.0 - part], 3)
    offsets = np.arange(-1.0, 3.0)
    series = power_ratio(powers_of_theta([0.0, 1.0], 3), mixed)
    return preview_weights(series, offsets), whole + offsets


def _samples(effect: Effect, ts_s: float) -> tuple[int, float]:
    samples = sum(effect.coefficients(ts_s, RDPI((1.0,), (), 0.0)))
    nearest = round(samples)
    if math.isclose(samples, nearest, abs_tol=1e-9):
        return nearest, 0.0
    return math.floor(samples), samples % 1.0
