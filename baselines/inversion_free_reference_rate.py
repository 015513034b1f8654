"""``inversion-free-reference-rate``: Eq. 6 with thresholds from the rate of the reference."""

from __future__ import annotations

import numpy as np

from baselines.inversion_free import InversionFree
from baselines.inversion_free_kernels import inversion_free_given_rate
from rdpi_gym.support.arrays import Array


class InversionFreeReferenceRate(InversionFree):
    """Eq. 6 at the rate of the reference over A, (r(k+1) - r(k)) / (A Ts).

    It is the command's rate while every play slides, known without a loop through the rate; what is
    left of the loop is z + g = 0.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P10")
    >>> layout = ObservationLayout.for_plant(plant, ts_s=5e-5)
    >>> print(InversionFreeReferenceRate(plant, layout).warning())
    None
    """

    def loop_polynomial(self) -> Array:
        """Return z + g."""
        return np.array([1.0, self.model.g])

    def stable_where(self) -> str:
        """Say the limit on g."""
        return "for g = S / a_0 below 1"

    def _fill(self, reference_um: Array, parameters: Array, state: Array, u: Array) -> None:
        v = self._reference_rate(reference_um, state)
        inversion_free_given_rate(reference_um, v, parameters, state[:-1], u, *self.limits)
