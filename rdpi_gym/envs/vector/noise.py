"""The sensors' noise of many lanes, each from a generator of its own, drawn some samples at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from rdpi_gym.envs.vector.lanes import Integers, aligned, table_row
from rdpi_gym.envs.vector.random import Words, draw_normals, seed_generator
from rdpi_gym.support.arrays import Array

SAMPLES = 32
"""Numbers that a lane draws at a time: its generator stays in registers meanwhile."""


@njit(cache=True)
def draw_noise(n: int, row: int, begin: int, end: int, rngs: Words, tables: Array) -> None:
    """Draw the rows of a block's lanes from a row on, for the lanes that have a generator."""
    width = tables.shape[2]
    for b in range(begin, end):
        lane = n * width + b
        if rngs[lane, 3] == 0:  # a seeded one has an odd increment
            continue
        draw_normals(rngs[lane], tables[n, row:, b])


@njit(cache=True)
def begin_noise(
    first: int, end: int, step: int, share: int, indices: Integers, noise_um: float, seeds: Words,
    rngs: Words, tables: Array, first_noise: Array,
) -> None:  # fmt: skip
    """Seed the generators of lanes that begin at a step, and draw what is left of their blocks' rows."""
    if not len(tables):
        return
    _, rows, width = tables.shape
    for j in range(first, end):
        n, b = indices[j] // width, indices[j] % width
        row = table_row(n, share, step, rows)
        rngs[indices[j]] = 0
        if noise_um > 0.0:
            seed_generator(seeds[j], rngs[indices[j]])
            draw_noise(n, row, b, b + 1, rngs, tables)
        else:
            tables[n, :, b] = 0.0
        first_noise[0, 0, j] = tables[n, row, b]


class NoiseTables:
    """Standard normal numbers for the lanes whose sensor has noise.

    Parameters
    ----------
    shape
        Number of blocks of lanes N, and their width W.
    share
        Blocks that a thread has.

    Attributes
    ----------
    rngs : uint64[N W, 4]
        As :func:`draw_noise`; without rows until a lane has noise.
    tables : float64[N, S, W]
        As there.
    """

    def __init__(self, shape: tuple[int, int], share: int) -> None:
        self._blocks, self._width = shape
        self._share = share
        self.rngs: Words = np.zeros((0, 4), dtype=np.uint64)
        self.tables: Array = np.zeros((0, SAMPLES, 1))

    def ready(self, step: int, indices: Integers, noise_um: float, seeds: Words) -> tuple[Any, ...]:
        """Make room for the noise of lanes that begin at a step, once there is any."""
        if not len(self.tables) and noise_um > 0.0:
            self.rngs = np.zeros((self._blocks * self._width, 4), dtype=np.uint64)
            self.tables = aligned((self._blocks, SAMPLES, self._width))
        rows = (1, 1, len(indices)) if len(self.tables) else (0, 1, 1)
        return (
            step, self._share, indices, noise_um, seeds, self.rngs, self.tables, np.empty(rows),
        )  # fmt: skip
