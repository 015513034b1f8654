"""Action spaces of one environment and of many lanes: numbers in [-1, 1], drawn quickly."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numba import njit
from numpy.typing import NDArray


class UnitBox(Box):
    """``Box(-1.0, 1.0, (1,), float32)`` whose `sample` costs one draw.

    ``Box.sample`` sorts the coordinates by kind of bound at every call, which takes several times
    as long as a step of the environment. Here the bounds are known: the numbers are those of
    ``Box.sample`` from the same seed.

    Parameters
    ----------
    seed
        Of the samples.

    Examples
    --------
    >>> UnitBox() == Box(-1.0, 1.0, (1,), np.float32)
    True
    >>> UnitBox(seed=1).sample() == Box(-1.0, 1.0, (1,), np.float32, seed=1).sample()
    array([ True])
    """

    def __init__(self, seed: int | np.random.Generator | None = None) -> None:
        super().__init__(-1.0, 1.0, (1,), np.float32, seed)

    def sample(self, mask: Any = None, probability: Any = None) -> NDArray[Any]:
        """Return a number uniform over [-1, 1], ``float32[1]``.

        Raises
        ------
        gymnasium.error.Error
            A mask or a probability is given, which no Box takes.
        """
        if mask is not None or probability is not None:
            return super().sample(mask, probability)
        return np.array([2.0 * self.np_random.random() - 1.0], dtype=np.float32)


_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_A, _MIX_B = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)


@njit(cache=True)
def _draw(first: np.uint64, actions: NDArray[np.float32]) -> None:
    """Fill `actions` from SplitMix64 (Steele, Lea and Flood, 2014), which starts at `first`."""
    for b in range(len(actions)):
        z = first + np.uint64(b) * _GOLDEN
        z = (z ^ (z >> np.uint64(30))) * _MIX_A
        z = (z ^ (z >> np.uint64(27))) * _MIX_B
        # 24 bits are all that a float32 below 1 can hold; the last mixing would not change these.
        actions[b] = np.float32(np.int32(z >> np.uint64(40))) * np.float32(2.0**-23) - np.float32(
            1.0
        )


class UnitBoxes(Box):
    """``Box(-1.0, 1.0, (lanes, 1), float32)`` with a quick `sample`.

    ``Box.sample`` sorts the coordinates by kind of bound at every call and draws 64 bits a number, one
    after the other: for thousands of lanes that takes longer than a step of the environment. This
    space draws one word at a call and spreads it over the lanes, on vector units.
    """

    def __init__(self, lanes: int, seed: int | np.random.Generator | None = None) -> None:
        super().__init__(-1.0, 1.0, (lanes, 1), np.float32, seed)

    def sample(self, mask: Any = None, probability: Any = None) -> NDArray[Any]:
        """Return numbers uniform over [-1, 1), ``float32[lanes, 1]``."""
        if mask is not None or probability is not None:
            return super().sample(mask, probability)
        actions = np.empty(self.shape, dtype=np.float32)
        first = np.uint64(self.np_random.bit_generator.random_raw())
        _draw(first, actions.reshape(-1))
        return actions
