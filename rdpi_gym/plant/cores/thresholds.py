"""What cores of many thresholds share: weights that a search takes off and puts back on a comb."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Self

import numpy as np

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array

_SPREAD = 1.5  # finer at small thresholds, where the small loops are


def spread_thresholds(reach_V: float, count: int) -> tuple[float, ...]:
    """Return thresholds (V) of a comb up to `reach_V`, closer to one another where they are small."""
    rest: Array = reach_V * (np.arange(1, count + 1) / count) ** _SPREAD
    return tuple(rest.tolist())


class ThresholdCore(Core):
    """A core whose weights end with one for each of its thresholds.

    Examples
    --------
    >>> from rdpi_gym.plant import RDPI
    >>> comb = RDPI((1.0, 0.0, 0.0, 0.0, 0.5), (1.0, 2.0, 3.0, 5.0), 0.0)
    >>> comb.pruned().thresholds_V, comb.slim().thresholds_V
    ((3.0, 5.0), (5.0,))
    >>> comb.pruned().on(comb) == comb
    True
    """

    weights: tuple[float, ...]
    thresholds_V: tuple[float, ...]

    @property
    def first_threshold_V(self) -> float:
        """The smallest threshold (V); zero where there is none."""
        return self.thresholds_V[0] if self.thresholds_V else 0.0

    @property
    def _apart(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Weights of no threshold, and of each."""
        first = len(self.weights) - len(self.thresholds_V)
        return self.weights[:first], self.weights[first:]

    def _with(self, weights: Sequence[float], thresholds_V: Sequence[float]) -> Self:
        changed: Any = dataclasses.replace(  # type: ignore[type-var]
            self, weights=tuple(weights), thresholds_V=tuple(thresholds_V)
        )
        return changed  # type: ignore[no-any-return]

    def _kept(self, places: Sequence[int]) -> Self:
        before, own = self._apart
        weights = (*before, *(own[i] for i in places))
        return self._with(weights, [self.thresholds_V[i] for i in places])

    def pruned(self) -> Self:
        """Return the core with the thresholds that have a weight, and their neighbours."""
        active = np.array(self._apart[1]) > 0
        near = active.copy()
        near[1:] |= active[:-1]
        near[:-1] |= active[1:]
        return self._kept(np.flatnonzero(near).tolist() if near.any() else [0])

    def on(self, whole: Self) -> Self:
        """Return the core on the thresholds of another one: each weight at the nearest of them.

        None is lost where the other comb has other thresholds, so that the gain at a turn stays.
        """
        before, own = self._apart
        rest, weights = np.array(whole.thresholds_V), np.zeros(len(whole.thresholds_V))
        for threshold_V, weight in zip(self.thresholds_V, own, strict=True):
            weights[np.argmin(np.abs(rest - threshold_V))] += weight
        return self._with((*before, *weights.tolist()), whole.thresholds_V)

    def slim(self) -> Self:
        """Return the core without the thresholds that have no weight; those of a law stay together."""
        rest = np.array(self.thresholds_V)
        if np.allclose(rest, rest[0] * np.arange(1, len(rest) + 1)):
            return self
        return self._kept([i for i, a in enumerate(self._apart[1]) if a > 0] or [0])
