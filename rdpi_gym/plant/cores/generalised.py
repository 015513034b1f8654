"""The generalised Prandtl-Ishlinskii model: plays between a rising and a falling envelope."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.families import (
    ThresholdCore,
    check_thresholds,
    check_weights,
    set_numbers,
    spread_thresholds,
)
from rdpi_gym.plant.cores.play import play
from rdpi_gym.plant.cores.rdpi import comb_roughness
from rdpi_gym.plant.parameters import DataScale, Parameter
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

# Plays of a fit's comb, and of the whole gain what a_0 is at least there.
_COMB, _LEAST_A0 = 40, 1e-6
# From here on tanh is 1 to the last digit.
_FLAT = 20.0
# Below this many lanes the vector units are better filled with the plays of one lane.
_VECTOR_LANES = 16
# Sums over the plays may be reordered (vector units); nothing else of IEEE 754 is given up.
_FAST = {"reassoc", "contract"}


@njit(cache=True, fastmath=_FAST, error_model="numpy", inline="always")
def _bent(u: float, k: float, centre: float, reach: float, at_rest: float) -> float:
    """tanh(k (u - centre)) / k + at_rest, without a branch and for k = 0 too.

    A fraction of the continued fraction of tanh at a sixteenth of its argument, doubled four times
    as w / q with w = tanh / k: right to the last two digits, and done for several lanes at once.
    """
    w = u - centre
    w = w if w < reach else reach
    w = w if w > -reach else -reach
    w *= 1.0 / 16.0
    z = (k * w) * (k * w)
    w *= 1.0 + z * (1.0 / 9.0 + z * (1.0 / 945.0))
    q = 1.0 + z * (4.0 / 9.0 + z * (1.0 / 63.0))
    for _ in range(4):
        w, q = 2.0 * w * q, q * q + (k * w) * (k * w)
    return w / q + at_rest


@njit(cache=True)
def _envelope(u: Array, k: float, centre: float, reach: float, at_rest: float) -> Array:
    bent = np.empty_like(u)
    for t in range(u.shape[0]):
        bent[t] = _bent(u[t], k, centre, reach, at_rest)
    return bent


@njit(cache=True)
def _columns(rising: Array, falling: Array, rest: Array, x: Array, columns: Array) -> None:
    for i in range(rest.shape[0]):
        state = x[i]
        for t in range(rising.shape[0]):
            state = play(state, rising[t] - rest[i], falling[t] + rest[i])
            columns[i, t] = state


@njit(cache=True, fastmath=_FAST, error_model="numpy", inline="never")
def _one_lane(u: Array, p: Array, weights: Array, rest: Array, x: Array, y: Array) -> None:
    n = rest.shape[0]
    e = 2 * n + 1
    for t in range(u.shape[0]):
        rising = _bent(u[t], p[e], p[e + 1], p[e + 2], p[e + 3])
        falling = p[e + 8] * _bent(u[t], p[e + 4], p[e + 5], p[e + 6], p[e + 7])
        total = weights[0] * 0.5 * (rising + falling) + p[e + 10]
        for i in range(n):
            low, high = rising - rest[i], falling + rest[i]
            state = x[i]
            state = state if state < high else high
            state = state if state > low else low
            x[i] = state
            total += weights[i + 1] * state
        y[t] = total


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _many_lanes(u: Array, p: Array, state: Array, y: Array) -> None:
    n = (p.shape[0] - 12) // 2
    e = 2 * n + 1
    lanes = u.shape[1]
    rising, falling = np.empty(lanes), np.empty(lanes)
    for t in range(u.shape[0]):
        for b in range(lanes):
            rising[b] = _bent(u[t, b], p[e, b], p[e + 1, b], p[e + 2, b], p[e + 3, b])
        for b in range(lanes):
            falling[b] = p[e + 8, b] * _bent(
                u[t, b], p[e + 4, b], p[e + 5, b], p[e + 6, b], p[e + 7, b]
            )
        for b in range(lanes):
            y[t, b] = p[0, b] * 0.5 * (rising[b] + falling[b]) + p[e + 10, b]
        for i in range(n):
            for b in range(lanes):
                low, high = rising[b] - p[n + 1 + i, b], falling[b] + p[n + 1 + i, b]
                x = play(state[2 + i, b], low, high)
                state[2 + i, b] = x
                y[t, b] += p[1 + i, b] * x


@njit(cache=True)
def generalised_block(u: Array, v: Array, p: Array, state: Array, y: Array) -> None:
    """Generalised plays and their sum.

    Rows of ``p``: a_0 ... a_n (µm/V), r_1 ... r_n (V), of the rising and then of the falling
    envelope curvature (1/V), centre, farthest command from it and value at rest (V), gain of the
    falling one, pole (unused), offset (µm). Rows of ``state`` from 2 on: x_1 ... x_n (V).
    """
    if u.shape[1] >= _VECTOR_LANES:
        _many_lanes(u, p, state, y)
        return
    n = (p.shape[0] - 12) // 2
    for b in range(u.shape[1]):
        column, x = p[:, b].copy(), state[2:, b].copy()
        _one_lane(u[:, b], column, column[: n + 1], column[n + 1 : 2 * n + 1], x, y[:, b])
        for k in range(x.shape[0]):
            state[2 + k, b] = x[k]


@dataclass(frozen=True)
class GeneralisedPI(ThresholdCore):
    """Sum of plays between two increasing envelopes of the command, a rising and a falling one.

    Parameters
    ----------
    weights
        a_0 ... a_n (µm/V): a_0 above zero, the others not negative.
    thresholds_V
        The n thresholds, r_1 < ... < r_n (V), above zero.
    rising_per_V, rising_centre_V
        How bent the rising envelope is (1/V), and the command (V) at which it is steepest; its
        slope is 1 there, and 0 per V is the command itself.
    falling_per_V, falling_centre_V
        The same of the falling envelope.
    falling_gain
        Factor of the falling envelope, above zero.
    rate_bandwidth_hz
        As every core has it; no rate matters here.

    Raises
    ------
    InputError
        A weight is negative or not finite, a_0 is not above zero, the thresholds do not increase
        from above zero or are not one for each play, or a number of an envelope is beyond its
        bounds.

    Examples
    --------
    >>> wire = GeneralisedPI((0.2, 1.0), (3.0,), rising_per_V=0.1, falling_per_V=0.1)
    >>> wire.envelopes([0.0, 10.0, 1000.0])[0].round(3).tolist()
    [0.0, 7.616, 10.0]
    >>> GeneralisedPI((0.2, 1.0), (3.0,)).envelopes([0.0, 10.0, 1000.0])[0].tolist()
    [0.0, 10.0, 1000.0]

    Notes
    -----
    Al Janaideh, Rakheja and Su have envelopes c_0 tanh(c_1 u + c_2) + c_3. Three of their eight
    numbers change nothing that others do not: both scales together are in weights and thresholds,
    the distance of the envelopes is in the thresholds, and their common height is in the plant's
    offset. What is left are the five above, and envelopes that are 0 at rest. A play whose
    envelopes cross, g_r(u) - r_i above g_f(u) + r_i, is the former there and remembers nothing.
    """

    weights: tuple[float, ...]
    thresholds_V: tuple[float, ...]
    rising_per_V: float = 0.0
    rising_centre_V: float = 0.0
    falling_per_V: float = 0.0
    falling_centre_V: float = 0.0
    falling_gain: float = 1.0
    rate_bandwidth_hz: float | None = None

    name = "generalised_pi"
    block = staticmethod(generalised_block)
    linear = ("weights",)
    title = "generalised Prandtl-Ishlinskii model"
    equation = (
        "y = a_0 (g_r(u) + g_f(u)) / 2 + sum of a_i x_i, x_i <- max(g_r(u) - r_i, min(g_f(u) + r_i, "
        "x_i)), g(u) = (tanh(k (u - m)) + tanh(k m)) / k"
    )
    source = (
        "Al Janaideh, Rakheja, Su, An analytical generalized Prandtl-Ishlinskii model inversion for "
        "hysteresis compensation in micropositioning control, IEEE/ASME Transactions on "
        "Mechatronics 16, 2011."
    )
    signature = (
        "Loops that turn counter-clockwise, saturate within themselves, and whose rising and "
        "falling branches are bent unlike; small loops of one size differ by where they stand."
    )
    experiment = "Triangles of one size at unlike bias, and one that drives it into saturation."
    hardware = "Shape-memory wires, magnetostrictive rods and piezoelectric stacks in large field."
    shape = (
        Parameter("rising_per_V", "1/V", 0.0, 1e3, (0.0, 0.05), "bend k_r, rising", neutral=0.0),
        Parameter("rising_centre_V", "V", -1e9, 1e9, (-20.0, 20.0), "centre m_r, rising"),
        Parameter("falling_per_V", "1/V", 0.0, 1e3, (0.0, 0.05), "bend k_f, falling", neutral=0.0),
        Parameter("falling_centre_V", "V", -1e9, 1e9, (-20.0, 20.0), "centre m_f, falling"),
        Parameter("falling_gain", "1", 0.05, 20.0, (0.8, 1.25), "falling over rising, q", 1.0),
    )
    spaced = True
    cases: ClassVar[Mapping[str, Mapping[str, float]]] = {
        "plays": {"rising_per_V": 0.0, "falling_per_V": 0.0, "falling_gain": 1.0}
    }
    loose = True

    def __post_init__(self) -> None:
        super().__post_init__()
        set_numbers(self, "weights", "thresholds_V")
        weights = self.weights
        if not weights or not (math.isfinite(weights[0]) and weights[0] > 0):
            found = weights[0] if weights else "missing"
            raise InputError(
                f"a_0 is {found}; the model needs a finite a_0 above 0 µm/V, what moves it right after a turn"
            )
        check_weights(weights)
        check_thresholds(self.thresholds_V, len(weights) - 1, "play")

    @property
    def a0(self) -> float:
        """a_0 times the mean slope of the envelopes at rest (µm/V)."""
        rising = _steepness(self.rising_per_V * self.rising_centre_V)
        falling = _steepness(self.falling_per_V * self.falling_centre_V)
        return self.weights[0] * 0.5 * (rising + self.falling_gain * falling)

    @property
    def A(self) -> float:
        """Gain (µm/V) where every envelope is steepest and every play slides."""
        mean, largest = 0.5 * (1.0 + self.falling_gain), max(1.0, self.falling_gain)
        return mean * self.weights[0] + largest * math.fsum(self.weights[1:])

    def with_gains(self, gains: Sequence[float]) -> GeneralisedPI:
        """Return the model with other weights (µm/V); a_0 stays above zero."""
        first, *others = (max(float(gain), 0.0) for gain in gains)
        least = _LEAST_A0 * max(math.fsum((first, *others)), _LEAST_A0)
        return replace(self, weights=(max(first, least), *others))

    def envelopes(self, u_V: Sequence[float] | Array) -> tuple[Array, Array]:
        """Return the rising and the falling envelope (V) at commands (V), of their shape."""
        u = np.atleast_1d(np.asarray(u_V, dtype=np.float64))
        rising, falling = self._bends()
        return _envelope(u, *rising), self.falling_gain * _envelope(u, *falling)

    def _bends(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Parameters of :func:`_bent` for the rising and the falling envelope."""
        rising = _bend(self.rising_per_V, self.rising_centre_V)
        return rising, _bend(self.falling_per_V, self.falling_centre_V)

    def responses(self, u: Array, v: Array, memory: Array) -> Array:
        """The mean envelope, and each play's output (V)."""
        rising, falling = self.envelopes(u)
        columns = np.empty((self.n + 1, len(u)))
        columns[0] = 0.5 * (rising + falling)
        _columns(rising, falling, np.array(self.thresholds_V), memory.copy(), columns[1:])
        return columns.T

    def roughness(self) -> Array:
        """Return that of the weights over their thresholds, which end in a play of no weight.

        Where the envelopes saturate, the widest plays hardly move: no record would keep their
        weights from growing.
        """
        if self.n < 2:
            return comb_roughness(self.thresholds_V)
        *_, last, widest = self.thresholds_V
        return comb_roughness((*self.thresholds_V, 2.0 * widest - last))[:-1, :-1]

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[GeneralisedPI, ...]:
        """Envelopes that saturate about the middle of the data, and a comb of thresholds.

        The falling envelope is the rising one, or higher by a fifth, or both are bent more, and
        apart: the optima that fits of random plants fell into.
        """
        # Where a play's threshold is all that its envelopes move, it is a relay at the ends of the
        # data, and takes any weight: half of what these envelopes move is tanh(1) = 0.76 of the span.
        thresholds = spread_thresholds(0.75 * scale.span_V, _COMB)
        gain = scale.stroke_um / scale.span_V
        weights = (0.5 * gain, *[0.5 * gain / _COMB] * _COMB)
        bend, centre, apart = 1.0 / scale.span_V, scale.centre_V, 0.3 * scale.span_V
        alike = cls(weights, thresholds, bend, centre, bend, centre)
        return (
            alike,
            replace(alike, falling_gain=1.2),
            replace(
                alike,
                rising_per_V=2.0 * bend,
                rising_centre_V=centre + apart,
                falling_per_V=2.0 * bend,
                falling_centre_V=centre - apart,
            ),
        )

    def coefficients(self) -> list[float]:
        """Weights (µm/V), thresholds (V), the rows of both envelopes, gain of the falling one."""
        rising, falling = self._bends()
        return [*self.weights, *self.thresholds_V, *rising, *falling, self.falling_gain]

    def settled(self, turns_V: Sequence[float]) -> Array:
        """Play states x_i (V) after a slow walk from rest through commands (V)."""
        rest, x = np.array(self.thresholds_V), np.zeros(self.n)
        for rising, falling in zip(*self.envelopes(turns_V), strict=True):
            x = np.maximum(rising - rest, np.minimum(falling + rest, x))
        return x

    def resting(self, memory: Array, u0_V: Array) -> Array:
        """Play states between the envelopes at the command."""
        rest = np.array(self.thresholds_V)[:, None]
        rising, falling = self.envelopes(u0_V)
        return np.asarray(np.maximum(rising - rest, np.minimum(falling + rest, memory)))


def _bend(k: float, centre: float) -> tuple[float, float, float, float]:
    """Curvature (1/V), centre, farthest command from it, value at rest (V)."""
    reach = _FLAT / k if k > 0.0 else math.inf
    return k, centre, reach, -float(_bent(0.0, k, centre, reach, 0.0))


def _steepness(distance: float) -> float:
    """1 / cosh², the slope of an envelope at a distance from its centre, for any distance."""
    e = math.exp(-2.0 * abs(distance))
    return 4.0 * e / (1.0 + e) ** 2
