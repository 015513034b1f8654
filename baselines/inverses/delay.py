"""Inverse of a delay, and of all linear effects over a whole record at once."""

from __future__ import annotations

import math

import numpy as np

from baselines.inverses.base import Setting
from baselines.inverses.preview_filter import (
    PreviewFilter,
    inverse_series,
    power_ratio,
    powers_of_theta,
    preview_weights,
)
from rdpi_gym.plant import RDPI, PlantModel
from rdpi_gym.plant.effects import Effect
from rdpi_gym.plant.effects.delay import delay_block
from rdpi_gym.plant.effects.linear import linear_block
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


# Half of the window (samples): the narrowest on which a sharp mode is still met.
_HALF = 2


class LinearUndo:
    """Lags, resonance and delay of a belief, undone in an error that is known to its end.

    Nothing is smoothed, so that the product with the effects stays within the right half-plane at
    every frequency: only then does learning from it converge. That holds for a mode of damping
    0.005 up to a twentieth of the sampling frequency. A lag of about one sample leaves 0.2 % too
    much near Nyquist where the plant's rate is hardly low-passed: learning grows there by at most
    1.0021 an iteration.

    Parameters
    ----------
    belief
        The plant with its effects.
    ts_s
        Sampling time (s).

    Examples
    --------
    >>> from dataclasses import replace
    >>> from rdpi_gym.plant import P10
    >>> from rdpi_gym.plant.effects import load_effect
    >>> late = replace(P10, effects=(load_effect("delay")(delay_s=2e-4),))
    >>> LinearUndo(late, 1e-4)(np.arange(5.0)[:, None])[:, 0].tolist()
    [2.0, 3.0, 4.0, 4.0, 4.0]
    """

    def __init__(self, belief: PlantModel, ts_s: float) -> None:
        self._filters: list[tuple[Array, Array]] = []
        for effect in belief.effects:
            if type(effect).block is delay_block:
                self._filters.append(delay_weights(effect, ts_s))
            elif type(effect).block is linear_block:
                column = effect.coefficients(ts_s, belief.hysteresis)
                offsets = np.arange(-_HALF, _HALF + 1.0)
                weights = preview_weights(inverse_series(column, 2 * _HALF), offsets)
                self._filters.append((weights, offsets))

    def __call__(self, error: Array) -> Array:
        """Return the error before the effects, ``float64[T, B]``."""
        for weights, offsets in self._filters:
            # A corner at the end would be learned again and again: derivatives see a straight line
            # there. What a delay brings in from beyond the end has no effect and stays.
            known = _continued(error) if len(weights) > 2 * _HALF else error
            rows = (len(known) - len(error)) // 2 + np.arange(len(error))
            undone = np.zeros_like(error)
            for weight, offset in zip(weights, offsets, strict=True):
                undone += weight * known[np.clip(rows + int(offset), 0, len(known) - 1)]
            error = undone
        return error


def _continued(error: Array) -> Array:
    steps = np.arange(1.0, _HALF + 1.0)[:, None]
    neighbour = min(1, len(error) - 1)
    before = error[0] + steps[::-1] * (error[0] - error[neighbour])
    after = error[-1] + steps * (error[-1] - error[-1 - neighbour])
    return np.concatenate([before, error, after])
