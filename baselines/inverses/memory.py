"""Effects with a memory undone sample by sample: backlash, creep, gain drift and thermal drift."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numba import njit

from baselines.inverses.base import Inverse, Setting
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.arrays import Array

# A reversal is one by this share of the scale; less is rounding of the reference.
_REVERSAL = 1e-4


@njit(cache=True)
def jump_block(y: Array, half_width: float, reversal: float, state: Array, x: Array) -> None:
    """Rows of the state: side of the gap (-1, 0, 1), farthest output in that direction (µm)."""
    for t in range(y.shape[0]):
        for b in range(y.shape[1]):
            side, ahead = state[0, b], y[t, b] - state[1, b]
            if side == 0.0:
                if abs(ahead) > reversal:
                    side = np.sign(ahead)
                    state[1, b] = y[t, b]
            elif side * ahead > 0.0:
                state[1, b] = y[t, b]
            elif side * ahead < -reversal:
                side = -side
                state[1, b] = y[t, b]
            state[0, b] = side
            x[t, b] = y[t, b] + side * half_width


class BacklashInverse(Inverse):
    """The inverse of a play: it steps from one side of the gap to the other."""

    effect = "backlash"
    rows = 2

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._half_width_um = effect.values["half_width_um"]
        self._reversal_um = _REVERSAL * setting.scale_um

    def start(self, y: Array) -> tuple[Array, Array]:
        """In the middle of the gap."""
        return np.stack([np.zeros(len(y)), y]), y.copy()

    def run(self, y: Array, state: Array) -> Array:
        """Jump; see :meth:`Inverse.run`."""
        x = np.empty_like(y)
        jump_block(y, self._half_width_um, self._reversal_um, state, x)
        return x


@njit(cache=True)
def creep_inverse_block(y: Array, p: Array, state: Array, x: Array) -> None:
    """Solve y = x + gain Σ z_k; ``p`` is the effect's column, the state its rows."""
    elements = (len(p) - 1) // 3
    gain, direct = p[0], 1.0
    for k in range(elements):
        direct += gain * p[3 + 3 * k]
    for t in range(y.shape[0]):
        for b in range(y.shape[1]):
            stretched = 0.0
            for k in range(elements):
                z = p[1 + 3 * k] * state[1 + k, b] + p[2 + 3 * k] * state[0, b]
                state[1 + k, b] = z
                stretched += z
            new = (y[t, b] - gain * stretched) / direct
            for k in range(elements):
                state[1 + k, b] += p[3 + 3 * k] * new
            state[0, b] = new
            x[t, b] = new


class CreepInverse(Inverse):
    """The inverse of a proper filter with zeros inside the unit circle: exact and stable."""

    effect = "creep"

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._p = np.array(effect.coefficients(setting.ts_s, setting.hysteresis))
        self.rows = effect.state_rows(setting.ts_s)
        self._rest_um = setting.rest

    def start(self, y: Array) -> tuple[Array, Array]:
        """In equilibrium at the plant's rest, wherever the reference begins."""
        stretched = self._p[0] * (self.rows - 1) * self._rest_um
        return np.full((self.rows, len(y)), self._rest_um), y - stretched

    def run(self, y: Array, state: Array) -> Array:
        """Solve sample by sample; see :meth:`Inverse.run`."""
        x = np.empty_like(y)
        creep_inverse_block(y, self._p, state, x)
        return x


@njit(cache=True)
def elements_inverse_block(y: Array, p: Array, state: Array, x: Array) -> None:
    """Solve y = g x - Σ l_k, l_k what element k lacks; ``p`` is the effect's column."""
    elements = (len(p) - 1) // 2
    direct = p[0]
    for k in range(elements):
        direct -= p[2 + 2 * k]
    for t in range(y.shape[0]):
        for b in range(y.shape[1]):
            wanted = y[t, b]
            for k in range(elements):
                lack = p[1 + 2 * k] * state[1 + k, b] - p[2 + 2 * k] * state[0, b]
                state[1 + k, b] = lack
                wanted += lack
            new = wanted / direct
            for k in range(elements):
                state[1 + k, b] += p[2 + 2 * k] * new
            state[0, b] = new
            x[t, b] = new


class ElementsInverse(CreepInverse):
    """The same for elements of unlike gains, in every further form of creep."""

    forms = (
        "one time constant",
        "two time constants",
        "between two times",
        "three time constants",
        "spectrum",
    )

    def start(self, y: Array) -> tuple[Array, Array]:
        """In equilibrium at the plant's rest, wherever the reference begins."""
        state = np.zeros((self.rows, len(y)))
        state[0] = self._rest_um
        return state, y - (self._p[0] - 1.0) * self._rest_um

    def run(self, y: Array, state: Array) -> Array:
        """Solve sample by sample; see :meth:`Inverse.run`."""
        x = np.empty_like(y)
        elements_inverse_block(y, self._p, state, x)
        return x


class GainDriftInverse(Inverse):
    """Division by the gain, in any form: what the effect makes of one micrometre at that time.

    Row of the memory: number of the next sample.
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
