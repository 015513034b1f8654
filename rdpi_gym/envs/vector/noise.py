"""The sensors' noise of many lanes, each from a generator of its own, drawn some samples at a time."""

from __future__ import annotations

import numpy as np
from numba import njit

from rdpi_gym.envs.vector.lanes import Integers, aligned
from rdpi_gym.envs.vector.random import Words, draw_normals, seed_generator
from rdpi_gym.support.arrays import Array

SAMPLES = 32
"""Numbers that a lane draws at a time: its generator stays in registers meanwhile."""


@njit(cache=True)
def noise_row(n: int, share: int, step: int, rows: int) -> int:
    """Row of a block's numbers for a step; blocks begin their tables anew at other steps.

    Those that are in the same place of the shares of the threads do so at the same step: a thread
    that draws alone is one for which the others wait.
    """
    return (step + n % share * rows // share) % rows


@njit(cache=True)
def draw_noise(n: int, row: int, begin: int, end: int, rngs: Words, tables: Array) -> None:
    """Draw the rows of a block's lanes from a row on, for the lanes that have a generator.

    Parameters
    ----------
    n, row
        The block, and the first row that is drawn; before it all stays.
    begin, end
        The lanes, counted within the block.
    rngs : uint64[N W, 4]
        Generators of all lanes, zeros where a sensor has no noise; they move on.
    tables : float64[N, S, W]
        Filled there.
    """
    width = tables.shape[2]
    for b in range(begin, end):
        lane = n * width + b
        if rngs[lane, 3] == 0:  # a seeded one has an odd increment
            continue
        draw_normals(rngs[lane], tables[n, row:, b])


@njit(cache=True)
def begin_noise(
    step: int, share: int, indices: Integers, noise_um: float, seeds: Words, rngs: Words,
    tables: Array,
) -> Array:  # fmt: skip
    """Seed the generators of lanes that begin at a step, and draw what is left of their blocks' rows.

    Parameters
    ----------
    step
        Of the environment.
    share
        Blocks that a thread has.
    indices : int64[m]
        The lanes.
    noise_um
        Standard deviation (µm) of their sensors.
    seeds : uint64[m]
        Of their generators.
    rngs, tables
        As :func:`draw_noise`.

    Returns
    -------
    float64[1, 1, m]
        Their first numbers.
    """
    _, rows, width = tables.shape
    first = np.zeros((1, 1, len(indices)))
    for j in range(len(indices)):
        n, b = indices[j] // width, indices[j] % width
        row = noise_row(n, share, step, rows)
        rngs[indices[j]] = 0
        tables[n, :, b] = 0.0
        if noise_um > 0.0:
            seed_generator(seeds[j], rngs[indices[j]])
            draw_noise(n, row, b, b + 1, rngs, tables)
            first[0, 0, j] = tables[n, row, b]
    return first


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

    def begin(self, step: int, indices: Integers, noise_um: float, seeds: Words) -> Array:
        """Draw for lanes that begin at a step, see :func:`begin_noise`; without rows before any noise."""
        if not len(self.tables):
            if noise_um == 0.0:
                return np.zeros((0, 1, 1))
            self.rngs = np.zeros((self._blocks * self._width, 4), dtype=np.uint64)
            self.tables = aligned((self._blocks, SAMPLES, self._width))
        first: Array = begin_noise(
            step, self._share, indices, noise_um, seeds, self.rngs, self.tables
        )
        return first
