"""``classical-reference-rate``: the classical inverse at the rate of the reference."""

from __future__ import annotations

from baselines.classical import ClassicalInverse
from baselines.limits import limit_block
from rdpi_gym.plant.cores.play import given_rate_block
from rdpi_gym.support.arrays import Array


class ClassicalReferenceRate(ClassicalInverse):
    """The classical inverse at the rate of the reference over A, (r(k+1) - r(k)) / (A Ts).

    That is the command's rate while every play slides. Nothing is fed back, so it is always stable.

    Examples
    --------
    >>> import numpy as np
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P5")
    >>> controller = ClassicalReferenceRate(plant, ObservationLayout.for_plant(plant, ts_s=1e-3))
    >>> controller.command_block(np.array([[0.0], [1.0]])).round(3).tolist()
    [[0.0], [1.372]]
    """

    def _fill(self, reference_um: Array, parameters: Array, state: Array, u: Array) -> None:
        v = self._reference_rate(reference_um, state)
        given_rate_block(reference_um - self.belief.offset_um, v, parameters, state[:-1], u)
        limit_block(u, state[0], *self.limits)
