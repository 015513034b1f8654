"""What the classical inverses share: plays on the reference, with the weights b_i of the inverse."""

from __future__ import annotations

from baselines.classical_inverse_kernels import inverse_memory, pack_inverse
from baselines.feedforward import Feedforward
from rdpi_gym.support.arrays import Array


class ClassicalInverse(Feedforward):
    """u = y/a_0 + Σ b_i Φ_{s_i}[y], thresholds s_i that grow with the command's rate by a_0 δ2 |v|.

    Its plays slide along the reference: where the command is clipped they know nothing of it.
    """

    def _packed(self) -> Array:
        return pack_inverse([self.model], self.layout.ts_s)

    def _rest_memory(self, plays_V: Array) -> Array:
        return inverse_memory(self.model, plays_V)
