"""What cores of one inner variable share: a length z (V) that follows the command along an equation."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array

# Length constants of a fit's starts, of half of the command's widest swing.
LENGTHS = (0.05, 0.4, 3.0)


class InnerVariable(Core):
    """A core whose displacement is a sum of gains times the command, z, and what follows from them.

    Its memory is z (V) and the command (V) that z has followed so far; rest is zero of both. Its
    :meth:`coefficients` begin with :attr:`gains`, and its kernel is linear in them.

    A subclass steps z by the way of the command, never by time: the whole step at once where the
    equation has a solution, so that it does not matter how a way is cut into samples.

    Examples
    --------
    >>> from rdpi_gym.plant import CORES
    >>> CORES["duhem"](b=1.0, c=0.5, length_V=2.0).settled((99.0,)).tolist()
    [2.0, 99.0]
    """

    wipes_out = False

    @property
    @abstractmethod
    def reach_V(self) -> tuple[float, float]:
        """Lowest and highest z (V)."""

    @property
    def n(self) -> int:
        """Two: z, and the last command."""
        return 2

    def responses(self, u: Array, v: Array, memory: Array) -> Array:
        """One column a gain: the displacement where that one is one and the others are zero."""
        count = len(self.gains)
        p = np.repeat(np.array([[*self.coefficients(), 0.0, 0.0]]).T, count, axis=1)
        p[:count] = np.eye(count)
        state = np.zeros((2 + self.n, count))
        state[2:] = memory[:, None]
        y = np.empty((len(u), count))
        lanes = np.ones((1, count))
        type(self).block(u[:, None] * lanes, v[:, None] * lanes, p, state, y)
        return y

    def settled(self, turns_V: Sequence[float]) -> Array:
        """Z (V) and the last command (V) after a slow walk from rest through commands (V)."""
        turns = np.array(turns_V, dtype=np.float64).reshape(-1, 1)
        p = np.array([[*self.coefficients(), 0.0, 0.0]]).T
        state = np.zeros((2 + self.n, 1))
        type(self).block(turns, np.zeros_like(turns), p, state, np.empty_like(turns))
        memory: Array = state[2:, 0]
        return memory

    def resting(self, memory: Array, u0_V: Array) -> Array:
        """Z (V) within its reach; it has followed up to the command."""
        return np.stack([np.clip(memory[0], *self.reach_V), np.asarray(u0_V, dtype=np.float64)])
