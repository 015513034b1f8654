"""The sensors' noise of many lanes, each from a generator of its own."""

from __future__ import annotations

import numpy as np

from rdpi_gym.envs.vector.lanes import NEVER, Integers
from rdpi_gym.envs.vector.random import Words
from rdpi_gym.support.arrays import Array

# Numbers drawn at a time: a call of a generator costs as much as a hundred of them.
_SAMPLES = 256


class NoiseTables:
    """Standard normal numbers for the lanes whose sensor has noise.

    Parameters
    ----------
    lanes
        Number of lanes B.

    Attributes
    ----------
    tables : float64[B, 256]
        Sample k of an episode stands in column k modulo 256; without rows until a lane has noise.
    due : int
        First step at which a lane needs new numbers.
    """

    def __init__(self, lanes: int) -> None:
        self._rngs: list[np.random.Generator | None] = [None] * lanes
        self._due: Integers = np.full(lanes, NEVER)
        self.tables: Array = np.zeros((0, _SAMPLES))
        self.due = NEVER

    def begin(self, step: int, indices: Integers, noise_um: float, seeds: Words) -> Array:
        """Draw for lanes that begin at a step.

        Parameters
        ----------
        step
            Of the environment.
        indices : int64[m]
            The lanes.
        noise_um
            Standard deviation (µm) of their sensors.
        seeds : uint64[m]
            Seeds of their generators.

        Returns
        -------
        float64[m, 1]
            Their first numbers; without rows where they have no noise.
        """
        if noise_um > 0.0:
            if not len(self.tables):
                self.tables = np.zeros((len(self._rngs), _SAMPLES))
            for lane, seed in zip(indices.tolist(), seeds.tolist(), strict=True):
                rng = self._rngs[lane] = np.random.default_rng(seed)
                rng.standard_normal(out=self.tables[lane])
        self._due[indices] = step + _SAMPLES if noise_um > 0.0 else NEVER
        if len(self.tables):
            self.due = int(self._due.min())
        return (
            np.ascontiguousarray(self.tables[indices, :1]) if noise_um > 0.0 else np.zeros((0, 1))
        )

    def extend(self, step: int) -> None:
        """Draw for the lanes whose numbers end before what `step` reads."""
        for lane in np.flatnonzero(self._due <= step).tolist():
            rng = self._rngs[lane]
            assert rng is not None
            rng.standard_normal(out=self.tables[lane])
            self._due[lane] += _SAMPLES
        self.due = int(self._due.min())
