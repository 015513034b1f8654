"""A plant that changes while it runs: what is mounted on it, and what its converter can say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rdpi_gym.plant import Plant, PlantModel
from rdpi_gym.support.arrays import Array

BLOCK = 25
"""Samples between two changes: what glides does so in steps, all lanes at once."""


class ChangingPlant(Plant):
    """Plants that become others at certain samples, behind a converter of finite resolution.

    Displacements and velocities go on where a mode moves, see :meth:`Plant.retune`.

    Parameters
    ----------
    models
        One a lane, as an episode begins.
    ts_s
        Sampling time (s).
    later
        For each lane what it becomes, by the sample of the episode at which it does.
    command_step_V
        Smallest step (V) of the converter; 0: none.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> p5 = named_plant("P5")
    >>> twice = p5.with_hysteresis(p5.hysteresis.with_gains([2.0 * a for a in p5.hysteresis.gains]))
    >>> plant = ChangingPlant([p5], 1e-3, [{2: twice}], command_step_V=0.5)
    >>> [round(float(plant.step(np.array([[u]]))[0, 0]), 3) for u in (0.0, 1.2, 1.2)]
    [0.0, 0.729, 1.458]
    """

    def __init__(
        self,
        models: Sequence[PlantModel],
        ts_s: float,
        later: Sequence[Mapping[int, PlantModel]],
        command_step_V: float = 0.0,
    ) -> None:
        self._first, self._later = tuple(models), tuple(later)
        self._turns = frozenset(sample for each in later for sample in each)
        self._step_V, self._sample = command_step_V, 0
        self._is_as_begun = True
        super().__init__(models, ts_s)

    def reset(self, *args: object, **options: object) -> None:
        """Begin an episode, as the plants that were there at first; see :meth:`Plant.reset`."""
        if not self._is_as_begun:
            self.retune(self._first)
        self._sample, self._is_as_begun = 0, True
        super().reset(*args, **options)  # type: ignore[arg-type]  # handed on as they came

    def step(self, u_V: Array) -> Array:
        """Advance one sample; see :meth:`Plant.step`."""
        if self._sample in self._turns:
            pairs = zip(self.models, self._later, strict=True)
            self.retune([later.get(self._sample, model) for model, later in pairs])
            self._is_as_begun = False
        self._sample += 1
        if self._step_V:
            u_V = np.rint(u_V / self._step_V) * self._step_V
        return super().step(u_V)
