"""Base classes of cores with many thresholds or one inner variable, and checks of their parameters."""

from __future__ import annotations

import dataclasses
import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from rdpi_gym.plant.cores.base import Core

# also where a user's cores import them from
from rdpi_gym.plant.cores.base import check_rate_bandwidth as check_rate_bandwidth
from rdpi_gym.plant.cores.base import check_shape as check_shape
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted


def numbers(name: str, values: Sequence[float]) -> tuple[float, ...]:
    """Return a list of numbers as floats."""
    try:
        return tuple(float(value) for value in values)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} is {quoted(values)}; give a list of numbers") from None


def set_numbers(core: Core, *names: str) -> None:
    """Replace lists in fields of a frozen core by tuples of floats."""
    for name in names:
        object.__setattr__(core, name, numbers(name, getattr(core, name)))


def check_weights(weights: Sequence[float], first: int = 0) -> None:
    """Refuse weights (µm/V) that are not finite or negative; `first` is the index of the first one."""
    for i, a in enumerate(weights, start=first):
        if not (math.isfinite(a) and a >= 0):
            raise InputError(f"weight a_{i} is {a}; weights are finite and not negative (µm/V)")


def check_thresholds(thresholds_V: Sequence[float], weights: int, operator: str) -> None:
    """Refuse thresholds (V) that do not increase from above zero, or are not one for each weight."""
    if len(thresholds_V) != weights:
        raise InputError(
            f"{len(thresholds_V)} thresholds for {weights} {operator} weights; give one threshold for each of a_1 ... a_n"
        )
    for i, (low, high) in enumerate(zip((0.0, *thresholds_V), thresholds_V, strict=False), start=1):
        if not (math.isfinite(high) and high > low):
            raise InputError(
                f"threshold r_{i} is {high} V after {low} V; thresholds increase from above 0 V"
            )


def check_gain(name: str, value: float, signed: bool = False) -> None:
    """Refuse a gain (µm/V) that is not finite, or negative where it may not be."""
    if not is_finite(value) or (value < 0 and not signed):
        kind = "gain" if signed else "gain that is not negative"
        raise InputError(f"{name} is {quoted(value)}; give a finite {kind}")


_SPREAD = 1.5  # finer at small thresholds, where the small loops are


def spread_thresholds(reach_V: float, count: int) -> tuple[float, ...]:
    """Return thresholds (V) of a comb up to `reach_V`, closer to one another where they are small."""
    rest: Array = reach_V * (np.arange(1, count + 1) / count) ** _SPREAD
    return tuple(rest.tolist())


def settled_memory(thresholds_V: ArrayLike, extrema_V: ArrayLike) -> Array:
    """Play states after a slow walk from rest through a sequence of extrema.

    Parameters
    ----------
    thresholds_V
        Thresholds at rest (V), ``(n,)``.
    extrema_V
        Commands (V) at which the walk turned, in order.

    Returns
    -------
    float64[n]
        ξ_i (V), from Eq. 4 at zero rate.

    Examples
    --------
    >>> settled_memory([1.0, 3.0], [5.0, 1.0]).tolist()
    [2.0, 2.0]
    """
    rest = np.asarray(thresholds_V, dtype=np.float64)
    xi = np.zeros_like(rest)
    for u in np.atleast_1d(np.asarray(extrema_V, dtype=np.float64)):
        xi = np.clip(xi, u - rest, u + rest)
    return xi


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
    def n(self) -> int:
        """Number of thresholds."""
        return len(self.thresholds_V)

    @property
    def first_threshold_V(self) -> float:
        """The smallest threshold (V); zero where there is none."""
        return self.thresholds_V[0] if self.thresholds_V else 0.0

    def settled(self, turns_V: Sequence[float]) -> Array:
        """Play states ξ_i (V) after a slow walk from rest through commands (V)."""
        return settled_memory(self.thresholds_V, turns_V)

    def resting(self, memory: Array, u0_V: Array) -> Array:
        """Play states within their thresholds of the command."""
        rest = np.array(self.thresholds_V)[:, None]
        return np.clip(memory, u0_V - rest, u0_V + rest)

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

    def _select(self, places: Sequence[int]) -> Self:
        before, own = self._apart
        weights = (*before, *(own[i] for i in places))
        return self._with(weights, [self.thresholds_V[i] for i in places])

    def pruned(self) -> Self:
        """Return the core with the thresholds that have a weight, and their neighbours."""
        active = np.array(self._apart[1]) > 0
        near = active.copy()
        near[1:] |= active[:-1]
        near[:-1] |= active[1:]
        return self._select(np.flatnonzero(near).tolist() if near.any() else [0])

    def on(self, whole: Self) -> Self:
        """Return the core on the thresholds of another one: each weight at the nearest of them.

        None is lost where the other comb has other thresholds, so that the gain at a turn stays.
        """
        before, own = self._apart
        rest, weights = np.array(whole.thresholds_V), np.zeros(len(whole.thresholds_V))
        for threshold_V, weight in zip(self.thresholds_V, own, strict=True):
            weights[np.argmin(np.abs(rest - threshold_V))] += weight
        return self._with((*before, *weights.tolist()), whole.thresholds_V)

    def blurred(self) -> Self:
        """Return the core with each weight split onto the thresholds beside its own, the ends as they are."""
        before, own = self._apart
        rest, weights = np.array(self.thresholds_V), np.array(own)
        up = (rest[1:-1] - rest[:-2]) / (rest[2:] - rest[:-2])
        split = np.array([weights[0], *np.zeros(len(up)), weights[-1]])
        split[2:] += up * weights[1:-1]
        split[:-2] += (1.0 - up) * weights[1:-1]
        return self._with((*before, *split.tolist()), self.thresholds_V)

    def slim(self) -> Self:
        """Return the core without the thresholds that have no weight; those of a law stay together."""
        rest = np.array(self.thresholds_V)
        if np.allclose(rest, rest[0] * np.arange(1, len(rest) + 1)):
            return self
        return self._select([i for i, a in enumerate(self._apart[1]) if a > 0] or [0])


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
