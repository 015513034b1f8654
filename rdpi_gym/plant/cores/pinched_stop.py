"""The pinched stop: a spring with a gap in it that slips, as friction devices with backlash have it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.cores.families import (
    check_weights,
    set_numbers,
    settled_memory,
)
from rdpi_gym.plant.cores.play import play, play_columns
from rdpi_gym.plant.parameters import DataScale, Parameter
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

# Sections of a fit's spring, and what is left at least of the gain at a turn.
_SECTIONS, _LEAST_SHARE = 12, 1e-6


@njit(cache=True)
def pinched_block(u: Array, v: Array, p: Array, state: Array, y: Array) -> None:
    """A slider, and the spring in front of it by its sections.

    Rows of ``p``: c, w_1 ... w_K (µm/V), the spring's sections continued to no deflection (µm),
    r (V), sections a volt, pole (unused), offset (µm). Row 2 of ``state``: where the spring is
    slack (V).
    """
    count = (p.shape[0] - 5) // 2
    for b in range(u.shape[1]):
        slope, offset = p[0, b], p[2 * count + 4, b]
        r, density = p[2 * count + 1, b], p[2 * count + 2, b]
        x = state[2, b]
        for t in range(u.shape[0]):
            x = play(x, u[t, b] - r, u[t, b] + r)
            s = u[t, b] - x
            k = min(max(int((s + r) * density), 0), count - 1)
            y[t, b] = slope * u[t, b] + p[1 + k, b] * s + p[1 + count + k, b] + offset
        state[2, b] = x


@dataclass(frozen=True)
class PinchedStop(Core):
    """A slider behind a spring that is as stiff as its deflection has it.

    The spring is carried along until its deflection reaches the threshold, and slips from there on.
    Where its middle is soft, as a gap makes it, the force rests near zero after every turn until
    the gap is closed, and loops are pinched. Slipping at unlike forces either way is a spring that
    is stiffer on one side.

    Parameters
    ----------
    weights
        w_1 ... w_K (µm/V), not negative: stiffness in K equal sections of the deflection from
        -r to r, the first and the last above zero.
    threshold_V
        r (V), above zero: half of the travel between slipping one way and the other.
    slope
        c (µm/V), of either sign: the gain while it slips. With the stiffness after a turn it makes
        more than zero.
    rate_bandwidth_hz
        As every core has it; no rate matters here.

    Raises
    ------
    InputError
        A weight is negative or not finite, the threshold is not above zero, or the gain right after
        a turn is not above zero.

    Examples
    --------
    >>> damper = PinchedStop(weights=(4.0, 0.0, 3.0), threshold_V=1.5)
    >>> damper.deflections_V.round(3).tolist(), damper.forces_um.round(3).tolist()
    ([-1.5, -0.5, 0.5, 1.5], [-4.0, 0.0, 0.0, 3.0])
    """

    weights: tuple[float, ...]
    threshold_V: float
    slope: float = 0.0
    rate_bandwidth_hz: float | None = None

    name = "pinched_stop"
    block = staticmethod(pinched_block)
    linear = ("slope", "weights")
    either_sign = ("slope",)
    title = "stop operator with a spring of sections"
    equation = "y = c u + phi(S_r[u]), S_r the stop operator, phi increasing and linear in sections"
    source = (
        "Iwan, Journal of Applied Mechanics 33, 1966 (a slider and a spring); Baber, Noori, Journal "
        "of Vibration and Acoustics 108, 1986 (pinching)."
    )
    signature = (
        "Loops that turn clockwise and are pinched: after a turn the force falls to zero, rests "
        "there while a gap closes, rises again, and stays once the slider slips."
    )
    experiment = "Triangles of falling size about one point, down to less than the gap."
    hardware = "Friction dampers, brakes and joints with backlash: force over displacement."
    shape = (Parameter("threshold_V", "V", 1e-9, 1e9, (1.0, 20.0), "deflection r of slip"),)
    clockwise = True

    def __post_init__(self) -> None:
        super().__post_init__()
        set_numbers(self, "weights")
        if not self.weights:
            raise InputError("weights is empty; give one weight (µm/V) for each section")
        check_weights(self.weights, first=1)
        if not is_finite(self.slope):
            raise InputError(f"slope is {quoted(self.slope)}; c is a finite gain (µm/V)")
        if not self.a0 > 0:
            raise InputError(
                f"the gain right after a turn, c + the first or the last weight, is {self.a0}; it is above 0 µm/V"
            )

    @property
    def n(self) -> int:
        """Rows of memory: the place where the spring is slack."""
        return 1

    @property
    def a0(self) -> float:
        """Gain (µm/V) right after slipping: c + w_1 or c + w_K, the smaller one."""
        return self.slope + min(self.weights[0], self.weights[-1])

    @property
    def A(self) -> float:
        """Size of the slope, and the stiffest section (µm/V)."""
        return abs(self.slope) + max(self.weights)

    @property
    def deflections_V(self) -> Array:
        """Deflections (V) between which the spring is linear, ``float64[K + 1]``."""
        return self.threshold_V * np.linspace(-1.0, 1.0, len(self.weights) + 1)

    @property
    def forces_um(self) -> Array:
        """Displacement (µm) added by the spring at :attr:`deflections_V`; zero at no deflection."""
        knots = self.deflections_V
        forces = np.concatenate([[0.0], np.cumsum(np.array(self.weights) * np.diff(knots))])
        return np.asarray(forces - float(np.interp(0.0, knots, forces)))

    def with_gains(self, gains: Sequence[float]) -> PinchedStop:
        """Return the model with other gains (µm/V); what follows a turn stays above zero."""
        slope, *others = (float(gain) for gain in gains)
        weights = [max(gain, 0.0) for gain in others]
        least = _LEAST_SHARE * max(math.fsum((abs(slope), *weights)), _LEAST_SHARE)
        weights[0], weights[-1] = max(weights[0], least), max(weights[-1], least)
        lowest = -(1.0 - _LEAST_SHARE) * min(weights[0], weights[-1])
        return replace(self, weights=tuple(weights), slope=max(slope, lowest))

    def responses(self, u: Array, v: Array, memory: Array) -> Array:
        """The command, and how far the deflection has gone within each section (V)."""
        slack, knots = np.empty((1, len(u))), self.deflections_V
        play_columns(u, v, np.array([self.threshold_V]), 0.0, memory.copy(), slack)
        low, high = knots[:-1], knots[1:]
        within = np.clip((u - slack[0])[:, None], low, high) - np.clip(0.0, low, high)
        return np.column_stack([u, within])

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[PinchedStop, ...]:
        """Springs of one stiffness that slip at a tenth and at four tenths of the data's half swing."""
        reaches = 0.1 * scale.span_V, 0.4 * scale.span_V
        return tuple(cls((scale.stroke_um / r,) * _SECTIONS, r) for r in reaches)

    def coefficients(self) -> list[float]:
        """Slope, stiffnesses (µm/V), forces continued to no deflection (µm), threshold (V), sections a volt."""
        weights = np.array(self.weights)
        continued = self.forces_um[:-1] - weights * self.deflections_V[:-1]
        density = len(weights) / (2.0 * self.threshold_V)
        return [self.slope, *self.weights, *continued.tolist(), self.threshold_V, density]

    def settled(self, turns_V: Sequence[float]) -> Array:
        """Place (V) at which the spring is slack after a slow walk from rest through commands (V)."""
        return settled_memory([self.threshold_V], turns_V)

    def resting(self, memory: Array, u0_V: Array) -> Array:
        """The place within the threshold of the command."""
        return np.clip(memory, u0_V - self.threshold_V, u0_V + self.threshold_V)
