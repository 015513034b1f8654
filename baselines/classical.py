"""``classical-*``: the inverse of the RDPI model, itself a weighted sum of plays, by which rate it takes.

The thresholds grow with the command's rate, which an inverse does not have yet: it takes the rate of
the reference over A, that of its own last command, the same low-passed, or none.
"""

from __future__ import annotations

from baselines.classical_inverse_kernels import (
    classical_own_rate,
    inverse_memory,
    pack_inverse,
)
from baselines.feedforward import Feedforward
from baselines.limits import limit_block
from baselines.stability import classical_polynomial, default_cutoff_hz, limiting_cutoff_hz
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.cores.play import given_rate_block
from rdpi_gym.support.arrays import Array


class ClassicalInverse(Feedforward):
    """u = y/a_0 + Σ b_i Φ_{s_i}[y], thresholds s_i that grow with the command's rate by a_0 δ2 |v|.

    Its plays slide along the reference: where the command is clipped they know nothing of it.
    """

    def _packed(self) -> Array:
        return pack_inverse([self.model], self.layout.ts_s)

    def _rest_memory(self, plays_V: Array) -> Array:
        return inverse_memory(self.model, plays_V)


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

    name = "classical-reference-rate"

    def _fill(self, reference_um: Array, parameters: Array, state: Array, u: Array) -> None:
        v = self._reference_rate(reference_um, state)
        given_rate_block(reference_um - self.belief.offset_um, v, parameters, state[:-1], u)
        limit_block(u, state[0], *self.limits)


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

    name = "classical-static"

    def compensator_model(self, hysteresis: RDPI) -> RDPI:
        """Return the static model."""
        return hysteresis.static()


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

    name = "classical-literal"

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

    name = "classical-low-passed"

    def compensator_model(self, hysteresis: RDPI) -> RDPI:
        """Return the model with its rate low-passed at the compensator's cut-off."""
        return hysteresis.band_limited(default_cutoff_hz(hysteresis))

    def stable_where(self) -> str:
        """Say the limit on the cut-off."""
        return f"for a low-pass below {limiting_cutoff_hz(self.model):.3g} Hz"
