"""``classical-literal``: the classical inverse at the rate of its own command."""

from __future__ import annotations

from baselines.classical import ClassicalInverse
from baselines.classical_inverse_kernels import classical_own_rate
from baselines.stability import classical_polynomial
from rdpi_gym.plant import RDPI
from rdpi_gym.support.arrays import Array


class ClassicalLiteral(ClassicalInverse):
    """The classical inverse at the rate of its own command one sample ago (Eq. 5).

    With all plays sliding it is the loop z² - κ z + κ = 0, κ = S δ2 / (A Ts): stable only while
    Ts > S δ2 / A.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P5")
    >>> ClassicalLiteral(plant, ObservationLayout.for_plant(plant, ts_s=1e-4)).warning()
    'outside its stability limit: pole magnitude 1.23 at Ts = 0.0001 s with belief P5; stable for Ts above 0.000151 s'
    """

    def compensator_model(self, hysteresis: RDPI) -> RDPI:
        """Return the model with the literal rate of Eq. 5."""
        return hysteresis.band_limited(None)

    def loop_polynomial(self) -> Array:
        """See :func:`baselines.stability.classical_polynomial`."""
        return classical_polynomial(self.model, self.layout.ts_s)

    def stable_where(self) -> str:
        """Say the limit on Ts."""
        return f"for Ts above {1.0 / self.model.zero_rad_s:.3g} s"

    def _fill(self, reference_um: Array, parameters: Array, state: Array, u: Array) -> None:
        displacement = reference_um - self.belief.offset_um
        classical_own_rate(displacement, parameters, state[:-1], self.layout.ts_s, u, *self.limits)
