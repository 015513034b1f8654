"""The action space of many lanes, drawn quickly."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def _spread(words: NDArray[np.uint32], actions: NDArray[np.float32]) -> None:
    for b in range(len(actions)):
        # 24 bits are all that a float32 below 1 can hold.
        actions[b] = np.float32(words[b] >> np.uint32(8)) * np.float32(2.0**-23) - np.float32(1.0)


class UnitBoxes(Box):
    """``Box(-1.0, 1.0, (lanes, 1), float32)`` whose `sample` costs what its random bits cost.

    ``Box.sample`` sorts the coordinates by kind of bound at every call and draws 64 bits a number:
    for thousands of lanes that takes longer than a step of the environment. This space draws 32.

    Parameters
    ----------
    lanes
        Number of lanes.
    seed
        Of the samples.

    Examples
    --------
    >>> UnitBoxes(3) == Box(-1.0, 1.0, (3, 1), np.float32)
    True
    >>> UnitBoxes(3, seed=1).sample().shape
    (3, 1)
    """

    def __init__(self, lanes: int, seed: int | np.random.Generator | None = None) -> None:
        super().__init__(-1.0, 1.0, (lanes, 1), np.float32, seed)

    def sample(self, mask: Any = None, probability: Any = None) -> NDArray[Any]:
        """Return numbers uniform over [-1, 1), ``float32[lanes, 1]``.

        Raises
        ------
        gymnasium.error.Error
            A mask or a probability is given, which no Box takes.
        """
        if mask is not None or probability is not None:
            return super().sample(mask, probability)
        bits = self.np_random.bit_generator
        if not isinstance(bits, np.random.PCG64):  # another gives words of another length
            return super().sample()
        actions = np.empty(self.shape, dtype=np.float32)
        words = bits.random_raw((len(actions) + 1) // 2)
        _spread(words.view(np.uint32), actions.reshape(-1))
        return actions
