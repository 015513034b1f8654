"""The LuGre model: Dahl's friction with a limit that falls with the rate, and with viscous terms."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.elementary import expm1_lanes
from rdpi_gym.plant.cores.families import (
    LENGTHS,
    InnerVariable,
    check_gain,
)
from rdpi_gym.plant.parameters import DataScale, Parameter
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

_LEAST = 1e-12
# Stribeck rates of a fit's starts, of the command's fastest.
_RATES = (0.02, 0.3)


@njit(cache=True, error_model="numpy")
def lugre_block(u: Array, v: Array, p: Array, state: Array, y: Array) -> None:
    """LuGre model, with the exact step of z over a sampling interval in which the rate is constant.

    There dz/du = 1 - sgn(u') z / zg with one limit zg = g(v) / s0, however stiff it is in time. The
    way is that of the command itself; a rate that is low-passed stands in g and in the two terms
    that it drives, so that a slow walk ends where an exact one does.
    """
    last_row, lanes = p.shape[0] - 1, u.shape[1]
    limit, w, fall = np.empty(lanes), np.empty(lanes), np.empty(lanes)
    for t in range(u.shape[0]):
        for b in range(lanes):
            relative = v[t, b] * p[5, b]
            w[b] = -relative * relative
        expm1_lanes(w, fall)
        for b in range(lanes):
            limit[b] = p[3, b] + p[4, b] * (1.0 + fall[b])
            w[b] = -abs(u[t, b] - state[3, b]) / limit[b]
        expm1_lanes(w, fall)
        for b in range(lanes):
            ahead = math.copysign(limit[b], u[t, b] - state[3, b])
            state[3, b] = u[t, b]
            z = state[2, b] - (ahead - state[2, b]) * fall[b]
            state[2, b] = z
            rate = v[t, b]
            moves = rate - abs(rate) * z / limit[b]
            y[t, b] = p[0, b] * z + p[1, b] * moves + p[2, b] * rate + p[last_row, b]


@dataclass(frozen=True)
class LuGre(InnerVariable):
    """Friction with Stribeck effect: z' = v - s0 |v| z / g(v), y = s0 z + s1 z' + s2 v, v = u'.

    Here g(v) = Fc + (Fs - Fc) exp(-(v / vs)²), with the two forces as lengths of z.

    Parameters
    ----------
    s0
        Stiffness (µm/V; of a force over a displacement N/m), above zero.
    s1_s, s2_s
        Damping of z and of the command's rate (µm s/V), not negative.
    coulomb_V
        Fc / s0 (V): z while it slides fast.
    static_ratio
        Fs / Fc, from one: one has no Stribeck effect.
    stribeck_V_s
        vs (V/s): the rate around which the force falls from Fs to Fc.
    rate_bandwidth_hz
        Cut-off (Hz) of a first-order low-pass on the rate v; None is the difference of samples.

    Raises
    ------
    InputError
        A gain is not finite or negative, s0 is zero, or another number is beyond its bounds.

    Examples
    --------
    >>> friction = LuGre(10.0, 0.01, 0.02, coulomb_V=0.1, static_ratio=1.5, stribeck_V_s=5.0)
    >>> friction.steady_um(1000.0), round(friction.steady_um(0.0), 3)  # Fc + s2 v, and Fs
    (21.0, 1.5)

    Notes
    -----
    It takes energy for certain where s2 > s1 (Fs / Fc - 1) (Barabanov, Ortega 2000). Where the force
    falls with the rate, the displacement may fall as the newest command rises.
    """

    s0: float
    s1_s: float
    s2_s: float
    coulomb_V: float
    static_ratio: float
    stribeck_V_s: float
    rate_bandwidth_hz: float | None = None

    name = "lugre"
    block = staticmethod(lugre_block)
    linear = ("s0", "s1_s", "s2_s")
    title = "LuGre model of friction"
    equation = (
        "z' = v - s0 |v| z / g, g = Fc + (Fs - Fc) exp(-(v / vs)²), y = s0 z + s1 z' + s2 v, v = u'"
    )
    source = (
        "Canudas de Wit, Olsson, Åström, Lischinsky, A new model for control of systems with "
        "friction, IEEE Trans. Automat. Contr. 40 (1995) 419."
    )
    signature = (
        "A friction that falls as slow motion grows faster (Stribeck) and rises again with fast "
        "motion; clockwise loops. Small loops do not close."
    )
    experiment = (
        "Constant rates from very slow to fast, each for as long as the force takes to settle."
    )
    hardware = "Lubricated guides, gears and bearings, pneumatic and hydraulic cylinders."
    shape = (
        Parameter("coulomb_V", "V", 1e-9, 1e9, (0.1, 10.0), "z while it slides fast, Fc / s0"),
        Parameter("static_ratio", "1", 1.0, 10.0, (1.0, 2.0), "Fs / Fc", neutral=1.0),
        Parameter("stribeck_V_s", "V/s", 1e-9, 1e9, (0.1, 100.0), "Stribeck rate vs"),
    )
    clockwise = True
    rated = True
    cases: ClassVar[Mapping[str, Mapping[str, float]]] = {
        "one length, no line": {"static_ratio": 1.0, "s1_s": 0.0, "s2_s": 0.0}
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("s0", "s1_s", "s2_s"):
            check_gain(name, getattr(self, name))
        if not self.s0 > 0:
            raise InputError(f"s0 is {self.s0}; give a stiffness above 0")

    @property
    def reach_V(self) -> tuple[float, float]:
        """Lowest and highest z (V)."""
        return -self.static_ratio * self.coulomb_V, self.static_ratio * self.coulomb_V

    @property
    def a0(self) -> float:
        """Stiffness s0 (µm/V) from rest."""
        return self.s0

    @property
    def A(self) -> float:
        """2 s0 (µm/V): a slow walk to and fro can carry z up to twice as far as the command goes."""
        return 2.0 * self.s0

    @property
    def rate_gain_um_s_V(self) -> float:
        """Damping s1 + s2 (µm s/V) of a small command; s2 while it slides."""
        return self.s1_s + self.s2_s

    def with_gains(self, gains: Sequence[float]) -> Self:
        """Return the model with other s0 (µm/V), s1 and s2 (µm s/V); s0 stays above zero."""
        s0, s1, s2 = (max(float(gain), 0.0) for gain in gains)
        return replace(self, s0=max(s0, _LEAST), s1_s=s1, s2_s=s2)

    def static(self) -> Self:
        """Return the model of slow motion: friction at Fs, whatever the rate, without damping."""
        highest = self.shape[0].high  # nothing slides there
        limit = min(self.coulomb_V * self.static_ratio, highest)
        return replace(self, s1_s=0.0, s2_s=0.0, coulomb_V=limit, static_ratio=1.0)

    def steady_um(self, rate_V_s: float) -> float:
        """Displacement (µm) while the command keeps sliding at a rate (V/s): g(v) sgn(v) + s2 v."""
        fall = math.exp(-((rate_V_s / self.stribeck_V_s) ** 2))
        limit = self.coulomb_V * (1.0 + (self.static_ratio - 1.0) * fall)
        return math.copysign(self.s0 * limit, rate_V_s) + self.s2_s * rate_V_s

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Limits from small to larger than the command's span, each at a slow and a fast Stribeck rate.

        Where that rate begins too far from the data's own, a fit takes the effect out of their range.
        """
        viscous = 0.05 * scale.stroke_um / scale.fastest_V_s
        return tuple(
            cls(
                scale.stroke_um / (min(length, 1.0) * scale.span_V), viscous, viscous,
                length * scale.span_V, 1.3, rate * scale.fastest_V_s,
            )
            for length in LENGTHS
            for rate in _RATES
        )  # fmt: skip

    def coefficients(self) -> list[float]:
        """Gains s0, s1, s2; Fc / s0 (V), (Fs - Fc) / s0 (V), 1 / vs (s/V)."""
        more = (self.static_ratio - 1.0) * self.coulomb_V
        return [*self.gains, self.coulomb_V, more, 1.0 / self.stribeck_V_s]
