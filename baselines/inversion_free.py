"""``inversion-free-*``: the model restructured, Eq. 6 and 7, by which rate sets its thresholds.

Parameters and state of the kernels are laid out as the plant's own (:mod:`rdpi_gym.plant.cores.play`).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from baselines.base import limited
from baselines.feedforward import (
    Feedforward,
    default_cutoff_hz,
    inversion_free_polynomial,
    limiting_cutoff_hz,
)
from rdpi_gym.plant import RDPI, pack
from rdpi_gym.plant.cores.play import play
from rdpi_gym.support.arrays import Array


@njit(cache=True)
def _command(y_r: float, b: int, p: Array, state: Array) -> float:
    n = (p.shape[0] - 4) // 2
    omega = 0.0
    for i in range(n):
        omega += p[1 + i, b] * state[2 + i, b]  # Eq. 7, one sample old
    return float((y_r - p[2 * n + 3, b] - omega) / p[0, b])  # Eq. 6


@njit(cache=True)
def _slide(u: float, v: float, b: int, p: Array, state: Array) -> None:
    n = (p.shape[0] - 4) // 2
    for i in range(n):
        r = p[n + 1 + i, b] + p[2 * n + 1, b] * abs(v)
        state[2 + i, b] = play(state[2 + i, b], u - r, u + r)


@njit(cache=True)
def inversion_free_own_rate(
    y_r: Array,
    p: Array,
    state: Array,
    ts: float,
    u: Array,
    low: float = -np.inf,
    high: float = np.inf,
    step: float = np.inf,
) -> None:
    """Eq. 6 with the rate of its own command: literal, or low-passed where `p` says so."""
    pole_row = p.shape[0] - 2
    for t in range(y_r.shape[0]):
        for b in range(y_r.shape[1]):
            command = limited(_command(y_r[t, b], b, p, state), state[0, b], low, high, step)
            last = command if np.isnan(state[0, b]) else state[0, b]
            pole = p[pole_row, b]
            v = pole * state[1, b] + (1.0 - pole) * ((command - last) / ts)
            state[0, b], state[1, b] = command, v
            _slide(command, v, b, p, state)
            u[t, b] = command


@njit(cache=True)
def inversion_free_given_rate(
    y_r: Array,
    v: Array,
    p: Array,
    state: Array,
    u: Array,
    low: float = -np.inf,
    high: float = np.inf,
    step: float = np.inf,
) -> None:
    """Eq. 6 with thresholds given through a rate."""
    for t in range(y_r.shape[0]):
        for b in range(y_r.shape[1]):
            command = limited(_command(y_r[t, b], b, p, state), state[0, b], low, high, step)
            state[0, b] = u[t, b] = command
            _slide(command, v[t, b], b, p, state)


class InversionFree(Feedforward):
    """Eq. 6, u(k) = (y_r(k) - Ω[u](k-1)) / a_0, on the belief's own parameters.

    Its plays slide along the command that is applied: where that is clipped, they see what the
    plant sees.
    """

    def _packed(self) -> Array:
        return pack([self.model], self.layout.ts_s, [self.belief.offset_um])

    def _rest_memory(self, plays_V: Array) -> Array:
        return plays_V


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

    name = "inversion-free-literal"

    def compensator_model(self, hysteresis: RDPI) -> RDPI:
        """Return the model with the literal rate of Eq. 5."""
        return hysteresis.band_limited(None)

    def loop_polynomial(self) -> Array:
        """See :func:`baselines.feedforward.inversion_free_polynomial`."""
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


class InversionFreeReferenceRate(InversionFree):
    """Eq. 6 at the rate of the reference over A, (r(k+1) - r(k)) / (A Ts).

    It is the command's rate while every play slides, known without a loop through the rate; what is
    left of the loop is z + g = 0.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P10")
    >>> layout = ObservationLayout.for_plant(plant, ts_s=5e-5)
    >>> print(InversionFreeReferenceRate(plant, layout).warning())
    None
    """

    name = "inversion-free-reference-rate"

    def loop_polynomial(self) -> Array:
        """Return z + g."""
        return np.array([1.0, self.model.g])

    def certificate(self) -> str | None:
        """Return the small gain of Eq. 6: the plays answer a change by S at most, 1 / a_0 brings it back."""
        g = self.model.g
        return f"small gain: g = S / a_0 = {g:.3g}, below 1" if g < 1.0 else None

    def stable_where(self) -> str:
        """Say the limit on g."""
        return "for g = S / a_0 below 1"

    def _fill(self, reference_um: Array, parameters: Array, state: Array, u: Array) -> None:
        v = self._reference_rate(reference_um, state)
        inversion_free_given_rate(reference_um, v, parameters, state[:-1], u, *self.limits)


class StaticInverseMultiplicative(InversionFreeReferenceRate):
    """Eq. 6 with δ2 ignored: the static compensator that the paper extends.

    u(k) = (y_r(k) - Σ a_i Φ_{r_i}[u](k-1)) / a_0 on a classical Prandtl-Ishlinskii model: the
    inverse multiplicative structure, which needs the model alone and no inverse of it. Its loop is
    z + g = 0.

    Source: M. Rakotondrabe, American Control Conference 2012, the paper's [8].

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P10")
    >>> layout = ObservationLayout.for_plant(plant, ts_s=5e-5)
    >>> StaticInverseMultiplicative(plant, layout).model.delta2_s
    0.0
    """

    name = "static-inverse-multiplicative"

    def compensator_model(self, hysteresis: RDPI) -> RDPI:
        """Return the static model."""
        return hysteresis.static()


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

    name = "inversion-free-low-passed"

    def compensator_model(self, hysteresis: RDPI) -> RDPI:
        """Return the model with its rate low-passed at the compensator's cut-off."""
        return hysteresis.band_limited(default_cutoff_hz(hysteresis))

    def stable_where(self) -> str:
        """Say the limits as Ts → 0."""
        limit = limiting_cutoff_hz(self.model)
        return f"at small Ts for g = S / a_0 below 1 (it is {self.model.g:.3g}) and a low-pass below {limit:.3g} Hz"
