"""``classical-static``: the classical inverse of the rate-independent model."""

from __future__ import annotations

from baselines.classical_reference_rate import ClassicalReferenceRate
from rdpi_gym.plant import RDPI


class ClassicalStatic(ClassicalReferenceRate):
    """The classical inverse with δ2 ignored: exact at low rates, and what most laboratories use.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P10")
    >>> ClassicalStatic(plant, ObservationLayout.for_plant(plant, ts_s=5e-5)).model.delta2_s
    0.0
    """

    def compensator_model(self, hysteresis: RDPI) -> RDPI:
        """Return the static model."""
        return hysteresis.static()
