"""From the voltage to the displacement by any hysteresis core, on the fine grid of the virtual lab."""

from __future__ import annotations

from typing import Any

import numpy as np

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.cores.play import rate_block
from rdpi_gym.plant.packing import empty_state, pack
from rdpi_gym.support.arrays import Array


class CoreDeformation:
    """Displacement over the voltage, with the memory of the core.

    Of the RDPI model the virtual lab has a formulation of its own; the other cores run their own
    kernels here, and what is independent of the models that are fitted is all around them.

    Parameters
    ----------
    core
        The hysteresis.
    step_s
        Step of the fine grid (s).
    parts
        Steps in a sampling interval, over which the rate is taken (Eq. 5).

    Examples
    --------
    >>> from rdpi_gym.plant import P5
    >>> CoreDeformation(P5.hysteresis, 1e-4, 2)(np.array([0.0, 1.0, 2.0])).round(3).tolist()
    [0.0, 0.729, 1.458]
    """

    def __init__(self, core: Core, step_s: float, parts: int) -> None:
        self._block, self._step, self._parts = type(core).block, step_s, parts
        self._parameters = pack([core], step_s, [0.0])
        self._state: Any = empty_state(core.n, 1)
        self._state[2:, 0] = core.settled(())
        self._filtered = core.rate_bandwidth_hz is not None
        self._resting, self._last = core.resting, np.nan

    def __call__(self, u: Array) -> Array:
        """Displacement (µm) for the voltage `u` at the stack."""
        if np.isnan(self._last):
            self._last = float(u[0])
            self._state[2:] = self._resting(self._state[2:], u[:1])
        command = np.ascontiguousarray(u[:, None])
        v, y = np.empty_like(command), np.empty_like(command)
        if self._filtered:
            rate_block(command, self._parameters, self._state, self._step, v)
        else:
            begins = np.arange(0, len(u), self._parts)
            steps = np.minimum(begins + self._parts, len(u)) - begins
            ends = u[begins + steps - 1]
            v[:, 0] = np.repeat(np.diff(ends, prepend=self._last) / (steps * self._step), steps)
        self._block(command, v, self._parameters, self._state, y)
        self._last = float(u[-1])
        displacement: Array = y[:, 0]
        return displacement
