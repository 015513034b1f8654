"""What the inversion-free compensators share: the model restructured, Eq. 6 and 7."""

from __future__ import annotations

from baselines.feedforward import Feedforward
from rdpi_gym.plant import pack
from rdpi_gym.support.arrays import Array


class InversionFree(Feedforward):
    """Eq. 6, u(k) = (y_r(k) - Ω[u](k-1)) / a_0, on the belief's own parameters.

    Its plays slide along the command that is applied: where that is clipped, they see what the
    plant sees.
    """

    def _packed(self) -> Array:
        return pack([self.model], self.layout.ts_s, [self.belief.offset_um])

    def _rest_memory(self, plays_V: Array) -> Array:
        return plays_V
