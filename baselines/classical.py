"""``classical-*``: the inverse of the RDPI model, itself a weighted sum of plays, by which rate it takes.

The thresholds grow with the command's rate, which an inverse does not have yet: it takes the rate of
the reference over A, that of its own last command, the same low-passed, or none. The parameters are
packed as the plant's (:mod:`rdpi_gym.plant.cores.play`), so with a given rate the inverse runs on the
plant's own kernel :func:`rdpi_gym.plant.cores.play.given_rate_block`, from µm to V.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from baselines.base import limit_block, limited
from baselines.feedforward import (
    Feedforward,
    classical_polynomial,
    default_cutoff_hz,
    limiting_cutoff_hz,
)
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.cores.play import given_rate_block, play
from rdpi_gym.support.arrays import Array


def pack_inverse(models: Sequence[RDPI], ts_s: float) -> Array:
    """Pack the inverse's parameters: 1/a_0, b_i, thresholds at rest s_i (µm), a_0 δ2, rate pole.

    Notes
    -----
    c_i = a_0 + ... + a_i, b_i = -a_i / (c_i c_{i-1}), s_i = Σ_{j<i} c_j (r_{j+1} - r_j); with Eq. 8
    the gaps do not depend on the rate, so it enters every s_i as a_0 δ2 |v| and the inverse exists.
    """
    columns = []
    for model in models:
        c = np.cumsum(model.weights)
        b = -np.asarray(model.weights[1:]) / (c[1:] * c[:-1])
        s = np.cumsum(c[:-1] * np.diff([0.0, *model.thresholds_V]))
        columns.append([1.0 / c[0], *b, *s, c[0] * model.delta2_s, model.rate_pole(ts_s), 0.0])
    return np.ascontiguousarray(np.array(columns, dtype=np.float64).T)


def inverse_memory(model: RDPI, memory_V: ArrayLike) -> Array:
    """State of the inverse that belongs to the plant's play states."""
    xi = np.asarray(memory_V, dtype=np.float64)
    a = np.asarray(model.weights[1:])
    c = np.cumsum(model.weights)[1:]
    behind = np.cumsum((a * xi)[::-1])[::-1] - a * xi
    return np.asarray(c * xi + behind, dtype=np.float64)


@njit(cache=True)
def classical_own_rate(
    y_r: Array,
    p: Array,
    state: Array,
    ts: float,
    u: Array,
    low: float = -np.inf,
    high: float = np.inf,
    step: float = np.inf,
) -> None:
    """Inverse at the rate of its own command, one sample old, literal or low-passed as `p` says."""
    n = (p.shape[0] - 4) // 2
    for t in range(y_r.shape[0]):
        for b in range(y_r.shape[1]):
            shift = p[2 * n + 1, b] * abs(state[1, b])
            command = p[0, b] * y_r[t, b]
            for i in range(n):
                s = p[n + 1 + i, b] + shift
                eta = play(state[2 + i, b], y_r[t, b] - s, y_r[t, b] + s)
                state[2 + i, b] = eta
                command += p[1 + i, b] * eta
            command = limited(command, state[0, b], low, high, step)
            last = command if np.isnan(state[0, b]) else state[0, b]
            pole = p[2 * n + 2, b]
            state[1, b] = pole * state[1, b] + (1.0 - pole) * ((command - last) / ts)
            state[0, b] = command
            u[t, b] = command


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
        """See :func:`baselines.feedforward.classical_polynomial`."""
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
