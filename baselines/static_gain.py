"""``none``: a static gain, so no compensation of hysteresis."""

from __future__ import annotations

import numpy as np

from baselines.classical_inverse_kernels import pack_inverse
from baselines.feedforward import Feedforward
from baselines.limits import limit_block
from rdpi_gym.plant import RDPI
from rdpi_gym.support.arrays import Array


class StaticGain(Feedforward):
    """u(k) = (r(k) - offset) / gain: what every compensator has to beat.

    The gain is the belief's static secant gain: slope of the chord from rest to the point of the
    virgin curve (every play starting at rest, δ2 ignored) at the largest displacement that the
    layout's references have, centre ± scale. It is the amplitude over the voltage that reaches it.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P5")
    >>> controller = StaticGain(plant, ObservationLayout.for_plant(plant, ts_s=1e-4))
    >>> round(controller.gain_um_V, 4)
    1.0201
    """

    name = "none"

    def compensator_model(self, hysteresis: RDPI) -> RDPI:
        """Return the static model."""
        return hysteresis.static()

    @property
    def gain_um_V(self) -> float:
        """The gain (µm/V)."""
        centre = self.layout.centre_um - self.belief.offset_um
        reach = abs(centre) + self.layout.scale_um
        n = self.model.n
        column = pack_inverse([self.model], self.layout.ts_s)[:, 0]
        command = column[0] * reach
        command += float(column[1 : n + 1] @ np.maximum(reach - column[n + 1 : 2 * n + 1], 0.0))
        return float(reach / command)

    def _packed(self) -> Array:
        return np.array([[1.0 / self.gain_um_V]])

    def _rest_memory(self, plays_V: Array) -> Array:
        return np.zeros(0)

    def _fill(self, reference_um: Array, parameters: Array, state: Array, u: Array) -> None:
        np.multiply(reference_um - self.belief.offset_um, parameters[0], out=u)
        limit_block(u, state[0], *self.limits)
