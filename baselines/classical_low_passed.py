"""``classical-low-passed``: the classical inverse with its own rate low-passed."""

from __future__ import annotations

from baselines.classical_literal import ClassicalLiteral
from baselines.stability import default_cutoff_hz, limiting_cutoff_hz
from rdpi_gym.plant import RDPI


class ClassicalLowPassed(ClassicalLiteral):
    """The classical inverse at its own rate through a first-order low-pass.

    The loop is stable at every Ts while the cut-off is below A / (2π S δ2); the cut-off is 500 Hz,
    or 0.6 of that limit where that is lower.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P10")
    >>> controller = ClassicalLowPassed(plant, ObservationLayout.for_plant(plant, ts_s=5e-5))
    >>> round(controller.model.rate_bandwidth_hz), controller.warning()
    (492, None)
    """

    def compensator_model(self, hysteresis: RDPI) -> RDPI:
        """Return the model with its rate low-passed at the compensator's cut-off."""
        return hysteresis.band_limited(default_cutoff_hz(hysteresis))

    def stable_where(self) -> str:
        """Say the limit on the cut-off."""
        return f"for a low-pass below {limiting_cutoff_hz(self.model):.3g} Hz"
