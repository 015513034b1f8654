"""``inversion-free-low-passed``: Eq. 6 with its own rate low-passed."""

from __future__ import annotations

from baselines.inversion_free_literal import InversionFreeLiteral
from baselines.stability import default_cutoff_hz, limiting_cutoff_hz
from rdpi_gym.plant import RDPI


class InversionFreeLowPassed(InversionFreeLiteral):
    """Eq. 6 at its own rate through a first-order low-pass at 500 Hz, or lower where it must be.

    As Ts → 0 the loop is stable iff g < 1 and the cut-off is below A / (2π S δ2); the cut-off is
    500 Hz, or 0.6 of that limit where that is lower.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P5")
    >>> controller = InversionFreeLowPassed(plant, ObservationLayout.for_plant(plant, ts_s=5e-5))
    >>> controller.model.rate_bandwidth_hz, controller.warning()
    (500.0, None)
    """

    def compensator_model(self, hysteresis: RDPI) -> RDPI:
        """Return the model with its rate low-passed at the compensator's cut-off."""
        return hysteresis.band_limited(default_cutoff_hz(hysteresis))

    def stable_where(self) -> str:
        """Say the limits as Ts → 0."""
        limit = limiting_cutoff_hz(self.model)
        return f"at small Ts for g = S / a_0 below 1 (it is {self.model.g:.3g}) and a low-pass below {limit:.3g} Hz"
