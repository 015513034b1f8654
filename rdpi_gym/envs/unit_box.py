"""The action space: one number in [-1, 1], drawn quickly."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
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
