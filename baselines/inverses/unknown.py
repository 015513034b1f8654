"""The unknown block undone by corrections: what it adds to a guess is taken off, again and again."""

from __future__ import annotations

import numpy as np

from baselines.classical import pack_inverse
from baselines.inverses.base import Inverse, Setting
from rdpi_gym.plant.cores.play import given_rate_block
from rdpi_gym.plant.effects import Effect
from rdpi_gym.plant.effects.base import forms_of
from rdpi_gym.plant.effects.unknown import Block, OfTheRate, Static, Unknown
from rdpi_gym.support.arrays import Array

# Corrections: each takes the error down by the largest slope of what the block adds, 0.02 to 0.3. Where
# it adds a rate without a lag, that slope is above one from sample to sample, and more would not settle.
# What a curve adds hangs on the sample alone: from the second on they are secant steps, in these bounds.
_ROUNDS, _RATE_ROUNDS = 6, 1
_LEAST_SLOPE, _LARGEST_SLOPE = 0.2, 5.0
_RATES = 2  # rows of the block's state that its rate is taken from


def _forms(*places: str) -> tuple[str, ...]:
    kinds = [kind for kind in forms_of(Unknown) if issubclass(kind, Block)]
    return tuple(kind.form for kind in kinds if kind.place in places)


class UnknownInverse(Inverse):
    """A block before or behind the hysteresis, whose own kernel runs once for each correction.

    Where it falls by more than it is given, no input is right, and the corrections do not settle.
    """

    effect = Unknown.name
    forms = _forms("before", "behind")
    _reads_guess = True

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._block, self._ts_s, self._rest = type(effect).block, setting.ts_s, setting.rest
        self._p = np.array(effect.coefficients(setting.ts_s, setting.hysteresis))[:, None]
        self._each = effect.state_rows(setting.ts_s)
        self._rounds = _RATE_ROUNDS if isinstance(effect, OfTheRate) else _ROUNDS
        self._by_secants = isinstance(effect, Static) and self._reads_guess
        self.rows = self._rounds * self._each

    def start(self, y: Array) -> tuple[Array, Array]:
        """Memories in equilibrium at the plant's rest; the rate is that from the reference's first sample."""
        state, here = self._fresh(len(y)), self._fresh(len(y))
        self.run(np.full((1, len(y)), self._rest), state)
        first = np.ascontiguousarray(y[None])
        self.run(first, here)
        for row in range(0, self._rounds * self._each, self._each):
            state[row : row + _RATES] = here[row : row + _RATES]
        return state, self.run(first, state.copy())[0]

    def _fresh(self, lanes: int) -> Array:
        """Return a memory before any sample."""
        return np.full((self.rows, lanes), np.nan)

    def run(self, y: Array, state: Array) -> Array:
        """Correct; see :meth:`Inverse.run`."""
        p = np.repeat(self._p, y.shape[1], axis=1)
        x, before = y, (y, y)
        for k in range(self._rounds):
            own, out = state[k * self._each : (k + 1) * self._each], np.empty_like(y)
            self._block(x, self._command(x, k, state), p, own, self._ts_s, out)
            slope = self._slope(x - before[0], out - before[1]) if k else 1.0
            before = x, out
            x = x + (y - out) / slope
        return x

    def _slope(self, step: Array, answer: Array) -> Array | float:
        """Slope of the block between two guesses, for a block without memory."""
        if not self._by_secants:
            return 1.0
        slope = np.divide(answer, step, out=np.ones_like(step), where=step != 0.0)
        return np.asarray(np.clip(slope, _LEAST_SLOPE, _LARGEST_SLOPE))

    def _command(self, x: Array, k: int, state: Array) -> Array:
        """Command that belongs to a guess; a block that stands apart from the plays reads none."""
        return x


class UnknownWithin(UnknownInverse):
    """A block that changes the weights of the plays, or the displacement, by the command.

    The command that belongs to a guess is that of the classical inverse of static plays.
    """

    forms = _forms("in", "beside")
    _reads_guess = False

    def __init__(self, effect: Effect, setting: Setting, ahead: int = 0) -> None:
        super().__init__(effect, setting, ahead)
        self._inverse = pack_inverse([setting.hysteresis.static()], setting.ts_s)
        self._plays = setting.hysteresis.n + 2
        self.rows += self._rounds * self._plays

    def _fresh(self, lanes: int) -> Array:
        """Return the same, the plays of the inverse at rest."""
        state = super()._fresh(lanes)
        state[self._rounds * self._each :] = 0.0
        return state

    def _command(self, x: Array, k: int, state: Array) -> Array:
        first = self._rounds * self._each + k * self._plays
        u, p = np.empty_like(x), np.repeat(self._inverse, x.shape[1], axis=1)
        given_rate_block(x, np.zeros_like(x), p, state[first : first + self._plays], u)
        return u
