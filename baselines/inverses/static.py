"""Effects without memory undone: asymmetry by the root that is zero with y, saturation by the nearest voltage."""

from __future__ import annotations

import numpy as np
from numba import njit

from baselines.inverses.base import Inverse, Setting, turns
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.arrays import Array


class AsymmetryInverse(Inverse):
    """The quadratic solved; beyond its vertex the vertex, which comes nearest."""

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


# Halvings of the bracket: to the last digits of a double.
_HALVINGS = 60


@njit(cache=True)
def _bent(x: float, powers: Array) -> float:
    value = 0.0
    for k in range(len(powers) - 1, -1, -1):
        value = (value + powers[k]) * x
    return value + x


@njit(cache=True)
def polynomial_inverse_block(y: Array, powers: Array, low: float, high: float, x: Array) -> None:
    """Solve y = x + Σ p_k x^k, k = 2 ..., by bisection between its turns `low` < 0 < `high`.

    The nearer turn is what is left where no x reaches y; ``powers`` holds p_k (µm^(1-k)) after a zero.
    """
    for t in range(y.shape[0]):
        for b in range(y.shape[1]):
            end = high if y[t, b] >= 0.0 else low
            far = y[t, b]
            while abs(far) < abs(end) and abs(_bent(far, powers)) < abs(y[t, b]):
                far *= 2.0
            if abs(far) >= abs(end):
                far = end
            near = 0.0
            if abs(_bent(far, powers)) <= abs(y[t, b]):
                near = far
            for _ in range(_HALVINGS):
                middle = 0.5 * (near + far)
                if abs(_bent(middle, powers)) < abs(y[t, b]):
                    near = middle
                else:
                    far = middle
            x[t, b] = 0.5 * (near + far)


class PolynomialInverse(Inverse):
    """The polynomial solved on the branch that rises through zero; beyond a turn that turn."""

    effect = "asymmetry"
    forms = ("cubic", "to the fifth degree")

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        per_um, *shares = effect.coefficients(setting.ts_s, setting.hysteresis)
        self._powers = np.array([0.0, *(c * per_um ** (k + 1) for k, c in enumerate(shares))])
        below, above = turns([k * c for k, c in enumerate(shares, start=2)])
        self._low, self._high = below / per_um, above / per_um

    def run(self, y: Array, state: Array) -> Array:
        """Solve; see :meth:`Inverse.run`."""
        x = np.empty_like(y)
        polynomial_inverse_block(y, self._powers, self._low, self._high, x)
        return x


# Voltages are kept within this share of the rails, where the inverse is finite.
_REACHED = 1.0 - 1e-9


class SaturationInverse(Inverse):
    """Harder commands where the amplifier softens."""

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
    """Harder commands above the knee: v / (1 - |v|^p)^(1/p) of the share v of the rails."""

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
    """The wanted voltage itself, and where it is beyond a rail that rail, which comes nearest."""

    effect = "saturation"
    forms = ("hard upper rail", "hard lower rail", "hard rails")

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._low_V, self._high_V = effect.coefficients(setting.ts_s, setting.hysteresis)

    def run(self, y: Array, state: Array) -> Array:
        """Clip; see :meth:`Inverse.run`."""
        return np.asarray(np.clip(y, self._low_V, self._high_V), dtype=np.float64)
