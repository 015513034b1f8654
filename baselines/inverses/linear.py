"""Linear effects and delay undone by a short filter that looks both ways along a known reference.

The sampled effect is H(z). Over a window of samples, weights w_j with Σ w_j e^{jθ} = 1 / H(e^θ) up
to some power of θ undo it exactly for references that are polynomials of that degree there. A first
lag becomes r + τ ṙ, a resonance r + 2ζ/ω0 ṙ + r̈/ω0², a delay T a shift r(t + T), each corrected for
a command that is linear between samples. Of all such weights those with the smallest sum of squares
are taken: they are least-squares polynomials through the window (Savitzky, Golay, Anal. Chem. 36,
1964), which pass on the least noise. An exact recursive inverse would ring, as H's zeros lie close
to z = -1 (lag) or outside the unit circle (resonance).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from baselines.inverses.base import Inverse, Setting
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.arrays import Array


def powers_of_theta(polynomial: ArrayLike, order: int) -> Array:
    """Expand a polynomial in z, z = e^θ, in powers of θ."""
    p = np.asarray(polynomial, dtype=np.float64)
    i = np.arange(p.size, dtype=np.float64)
    return np.array([float(p @ i**q) / math.factorial(q) for q in range(order + 1)])


def power_ratio(numerator: Array, denominator: Array) -> Array:
    """Divide two power series of the same length."""
    ratio = np.zeros(len(numerator))
    for q in range(len(numerator)):
        known = ratio[:q] @ denominator[q:0:-1]
        ratio[q] = (numerator[q] - known) / denominator[0]
    return ratio


def inverse_series(column: Sequence[float], order: int) -> Array:
    """Expand 1 / H(e^θ) of a linear effect in powers of θ."""
    m = round(math.sqrt(len(column) + 3.0)) - 2
    p = np.asarray(column, dtype=np.float64)
    f = p[: m * m].reshape(m, m)
    g0, g1, c = (p[m * m + k * m : m * m + (k + 1) * m] for k in range(3))
    # x(k+1) = F x + G0 u(k) + G1 u(k+1) with the state x - G1 u
    b, d = f @ g1 + g0, c @ g1 + p[m * m + 3 * m]
    poles = np.poly(f)
    zeros = np.poly(f - np.outer(b, c)) + (d - 1.0) * poles
    return power_ratio(powers_of_theta(poles[::-1], order), powers_of_theta(zeros[::-1], order))


def preview_weights(series: Array, offsets: ArrayLike) -> Array:
    """Weights of the samples of a window with given powers of θ and the smallest sum of squares."""
    j = np.asarray(offsets, dtype=np.float64)
    rows = np.array([j**q / math.factorial(q) for q in range(len(series))])
    return np.asarray(np.linalg.pinv(rows) @ series, dtype=np.float64)


@njit(cache=True)
def filter_block(y: Array, weights: Array, state: Array, x: Array) -> None:
    """Weighted sum of the newest samples; the state holds those before the block, oldest first."""
    before = len(weights) - 1
    samples, lanes = y.shape
    for t in range(samples):
        for b in range(lanes):
            total = 0.0
            for j in range(before + 1):
                k = t + j - before
                total += weights[j] * (y[k, b] if k >= 0 else state[before + k, b])
            x[t, b] = total
    for j in range(before):
        k = samples + j - before
        for b in range(lanes):
            state[j, b] = y[k, b] if k >= 0 else state[before + k, b]


class PreviewFilter(Inverse):
    """An inverse that is a filter; a subclass sets `weights` and `rows` by :meth:`_set`."""

    weights: Array

    def _set(self, weights: Array) -> None:
        self.weights = weights
        self.rows = len(weights) - 1

    def start(self, y: Array) -> tuple[Array, Array]:
        """As if the output had been held for long; see :meth:`Inverse.start`."""
        return np.repeat(y[None], self.rows, axis=0), y.copy()

    def run(self, y: Array, state: Array) -> Array:
        """Filter; see :meth:`Inverse.run`."""
        x = np.empty_like(y)
        filter_block(y, self.weights, state, x)
        return x


class DelayInverse(PreviewFilter):
    """A shift by whole samples, and a cubic through four of them for the rest.

    Where fewer samples are shown than the delay takes, the last two are continued in a straight
    line.
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
    """The lag behind the mechanics, by a derivative over a tenth of its time constant either way."""

    effect = "sensor_lag"
    forms = ("", "second order", "fourth order")
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
    """One mode or two, by derivatives over a tenth of its period either way."""

    effect = "resonance"
    forms = ("", "with a zero", "two modes")
    urgency = 3

    @classmethod
    def half_window_s(cls, effect: Effect) -> float:
        """Return a tenth of the period (s), of two modes that of the slower one."""
        values = effect.values
        return 0.1 / min(values["f0_hz"], values.get("second_hz", math.inf))
