"""A controller's memory by name: which rows of its one array hold what."""

from __future__ import annotations

from rdpi_gym.support.arrays import Array


class Rows:
    """Named blocks of rows of a memory ``float64[S, B]``.

    Parameters
    ----------
    counts
        Number of rows of each block, in their order.

    Attributes
    ----------
    total : int
        Number of rows S.
    names : tuple of str
        Of the blocks, in their order.

    Examples
    --------
    >>> import numpy as np
    >>> rows = Rows(last_V=1, measured_um=3)
    >>> memory = np.zeros((rows.total, 2))
    >>> rows.of(memory, "measured_um")[:] = 1.0
    >>> memory[:, 0].tolist()
    [0.0, 1.0, 1.0, 1.0]
    """

    def __init__(self, **counts: int) -> None:
        self._slices: dict[str, slice] = {}
        self.total, self.names = 0, tuple(counts)
        for name, count in counts.items():
            self._slices[name] = slice(self.total, self.total + count)
            self.total += count

    def of(self, memory: Array, name: str) -> Array:
        """Return a block as a view, float64[rows, B]."""
        return memory[self._slices[name]]


def shift_in(ring: Array, newest: Array) -> None:
    """Move a block on by one: its oldest entry is dropped and `newest` becomes its last, in place."""
    ring[:-1] = ring[1:].copy()
    ring[-1] = newest
