"""``inversion-free-literal``: Eq. 6 and 7 as printed."""

from __future__ import annotations

import math

from baselines.inversion_free import InversionFree
from baselines.inversion_free_kernels import inversion_free_own_rate
from baselines.stability import inversion_free_polynomial
from rdpi_gym.plant import RDPI
from rdpi_gym.support.arrays import Array


class InversionFreeLiteral(InversionFree):
    """Eq. 6 at the rate of its own command one sample ago, by backward difference (Eq. 5).

    With all plays sliding it is the loop z² + g (1 - q) z + g q = 0, q = δ2 / Ts: stable only
    while Ts > g δ2, and for g above 1 only while Ts < 2 g δ2 / (g - 1). Below the first limit it
    chatters.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P10")
    >>> print(InversionFreeLiteral(plant, ObservationLayout.for_plant(plant, ts_s=1e-3)).warning())
    None
    >>> InversionFreeLiteral(plant, ObservationLayout.for_plant(plant, ts_s=5e-5)).warning()
    'outside its stability limit: pole magnitude 5.2 at Ts = 5e-05 s with belief P10; stable for Ts above 0.000382 s'
    """

    def compensator_model(self, hysteresis: RDPI) -> RDPI:
        """Return the model with the literal rate of Eq. 5."""
        return hysteresis.band_limited(None)

    def loop_polynomial(self) -> Array:
        """See :func:`baselines.stability.inversion_free_polynomial`."""
        return inversion_free_polynomial(self.model, self.layout.ts_s)

    def stable_where(self) -> str:
        """Say the limits on Ts."""
        g, lag = self.model.g, self.model.g * self.model.delta2_s
        longest = 2.0 * lag / (g - 1.0) if g > 1.0 else math.inf
        if longest <= lag:
            return f"at no Ts: g = S / a_0 is {g:.3g}"
        return f"for Ts above {lag:.3g} s" + (f" and below {longest:.3g} s" if g > 1.0 else "")

    def _fill(self, reference_um: Array, parameters: Array, state: Array, u: Array) -> None:
        inversion_free_own_rate(
            reference_um, parameters, state[:-1], self.layout.ts_s, u, *self.limits
        )
