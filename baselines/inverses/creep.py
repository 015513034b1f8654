"""Creep undone exactly: the ladder's inverse, solved for the newest sample."""

from __future__ import annotations

import numpy as np
from numba import njit

from baselines.inverses.base import Inverse, Setting
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.arrays import Array


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
    """The inverse of a proper filter with zeros inside the unit circle: exact and stable.

    Examples
    --------
    >>> from rdpi_gym.plant import PAPER_IV_B
    >>> from rdpi_gym.plant.effects import load_effect
    >>> creep, x = load_effect("creep")(), np.array([0.0, 50.0, 50.0, 20.0])
    >>> inverse = CreepInverse(creep, Setting(0.1, PAPER_IV_B, 40.0, 0.0))
    >>> state, _ = inverse.start(np.zeros(1))
    >>> inverse.run(creep.run(x, 0.1)[1:, None], state).round(9)[:, 0].tolist()
    [50.0, 50.0, 20.0]
    """

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
    """The same for elements of unlike gains, in every further form of creep.

    Examples
    --------
    >>> from rdpi_gym.plant import PAPER_IV_B
    >>> from rdpi_gym.plant.effects import load_effect
    >>> forms = {kind.form: kind for kind in load_effect("creep").forms}
    >>> creep, x = forms["two time constants"](), np.array([0.0, 50.0, 50.0, 20.0])
    >>> inverse = ElementsInverse(creep, Setting(0.1, PAPER_IV_B, 40.0, 0.0))
    >>> state, _ = inverse.start(np.zeros(1))
    >>> inverse.run(creep.run(x, 0.1)[1:, None], state).round(9)[:, 0].tolist()
    [50.0, 50.0, 20.0]
    """

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
