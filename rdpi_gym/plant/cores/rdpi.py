"""The RDPI model's parameters, Eq. 2, 3 and 8, the paper's two sets, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rdpi_gym.plant.cores.base import check_rate_bandwidth
from rdpi_gym.plant.cores.families import (
    ThresholdCore,
    check_thresholds,
    check_weights,
    numbers,
    set_numbers,
    spread_thresholds,
)
from rdpi_gym.plant.cores.families import (
    settled_memory as settled_memory,  # its former place
)
from rdpi_gym.plant.cores.play import given_rate_block, play_columns, rdpi_block
from rdpi_gym.plant.parameters import DataScale, Parameter, moved
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

# Plays of a fit's comb, and of the whole gain what a_0 is at least there.
_COMB, _LEAST_A0 = 40, 1e-6
# Plays of a search's comb: enough that one between two of them is not missed.
_SEARCHED = 60
_LEAST_GAIN = 1e-9  # µm/V, of data that hardly move


@dataclass(frozen=True)
class RDPI(ThresholdCore):
    """Parameters of the rate-dependent Prandtl-Ishlinskii model.

    Parameters
    ----------
    weights
        a_0 ... a_n (µm/V): a_0 above zero, the others not negative.
    thresholds_V
        The n thresholds at rest, r_1 < ... < r_n (V), above zero.
    delta2_s
        δ2 of Eq. 8 (s): the thresholds grow by δ2 |v|. Zero is the static model.
    rate_bandwidth_hz
        Cut-off (Hz) of a first-order low-pass on the rate v; None is the literal Eq. 5.
        A literal plant rewards dither (it has a right-half-plane zero), so plants that score or
        train controllers have one of 800 Hz or below.

    Raises
    ------
    InputError
        A weight is negative or not finite, a_0 is not above zero, the thresholds do not increase
        from above zero, or their number is not n.

    Examples
    --------
    >>> model = RDPI.from_law([0.729, 0.211, 0.113], delta1_V=1.75, delta2_s=3.762e-4)
    >>> model.thresholds_V
    (1.75, 3.5)
    >>> round(model.A, 3)
    1.053

    Notes
    -----
    Aljanaideh, Al Janaideh, Rakotondrabe, Eq. 2, 3 and 8.
    """

    weights: tuple[float, ...]
    thresholds_V: tuple[float, ...]
    delta2_s: float
    rate_bandwidth_hz: float | None = None

    name = "rdpi"
    block = staticmethod(given_rate_block)
    fused = staticmethod(rdpi_block)
    linear = ("weights",)
    title = "rate-dependent Prandtl-Ishlinskii model"
    equation = "y = a_0 u + sum of a_i P_i[u], P_i the play operator of threshold r_i + δ2 |v|"
    source = "Aljanaideh, Al Janaideh, Rakotondrabe, Eq. 2 to 5 and 8."
    signature = (
        "Loops that turn counter-clockwise, are odd about their middle, and widen with the rate; "
        "small loops of one size are alike wherever they stand."
    )
    experiment = "Triangles of one size at unlike bias, and one loop at several frequencies."
    hardware = "Piezoelectric stacks, tubes and bending actuators driven by a voltage."
    shape = (Parameter("delta2_s", "s", 0.0, 1e3, (0.0, 1e-3), "δ2 of Eq. 8"),)
    rated = True
    cases: ClassVar[Mapping[str, Mapping[str, float]]] = {"plays": {"delta2_s": 0.0}}
    keeps_first = True  # Eq. 6 divides by it
    spaced = True
    drawn_as_packed = True

    def __post_init__(self) -> None:
        set_numbers(self, "weights", "thresholds_V")
        weights = self.weights
        if not weights or not (math.isfinite(weights[0]) and weights[0] > 0):
            found = weights[0] if weights else "missing"
            raise InputError(
                f"a_0 is {found}; the model needs a finite a_0 above 0 µm/V (Eq. 6 divides by it)"
            )
        check_weights(weights)
        check_thresholds(self.thresholds_V, len(weights) - 1, "play")
        if not (is_finite(self.delta2_s) and self.delta2_s >= 0):
            raise InputError(
                f"delta2_s is {quoted(self.delta2_s)}; δ2 is finite and not negative (s)"
            )
        check_rate_bandwidth(self.rate_bandwidth_hz)

    @classmethod
    def from_law(
        cls,
        weights: Sequence[float],
        delta1_V: float,
        delta2_s: float,
        rate_bandwidth_hz: float | None = None,
    ) -> RDPI:
        """Build the model with the paper's threshold law, Eq. 8: r_i = δ1 i + δ2 |v|.

        Parameters
        ----------
        weights
            a_0 ... a_n (µm/V).
        delta1_V
            δ1 (V), above zero.
        delta2_s
            δ2 (s).
        rate_bandwidth_hz
            Cut-off of the rate's low-pass (Hz), or None.

        Raises
        ------
        InputError
            As the class; δ1 not above zero.

        Examples
        --------
        >>> RDPI.from_law([1.0, 0.5], 2.0, 0.0).thresholds_V
        (2.0,)
        """
        if not (is_finite(delta1_V) and delta1_V > 0):
            raise InputError(f"delta1_V is {quoted(delta1_V)}; δ1 is finite and above 0 V")
        given = numbers("weights", weights)
        thresholds = tuple(delta1_V * i for i in range(1, len(given)))
        return cls(given, thresholds, delta2_s, rate_bandwidth_hz)

    @property
    def a0(self) -> float:
        """a_0 (µm/V): the gain while every play sticks."""
        return self.weights[0]

    @property
    def S(self) -> float:
        """S = a_1 + ... + a_n (µm/V)."""
        return math.fsum(self.weights[1:])

    @property
    def A(self) -> float:
        """A = a_0 + S (µm/V): the gain while every play slides."""
        return math.fsum(self.weights)

    @property
    def g(self) -> float:
        """Loop gain g = S / a_0 of Eq. 6."""
        return self.S / self.a0

    @property
    def rate_gain_um_s_V(self) -> float:
        """-S δ2 (µm s/V): by Eq. 8 every play lags by δ2 |v| more."""
        return -(self.S * self.delta2_s)

    def with_gains(self, gains: Sequence[float]) -> RDPI:
        """Return the model with other weights (µm/V); a_0 stays above zero."""
        first, *others = [0.0 if gain < 0.0 else gain for gain in map(float, gains)]
        least = first or _LEAST_A0 * max(math.fsum(others), _LEAST_A0)
        return self._moved((least, *others), self.delta2_s)

    def with_shape(self, values: Mapping[str, float]) -> RDPI:
        """Return the model with another δ2 (s), within its bounds."""
        return self._moved(self.weights, self._within(values).get("delta2_s", self.delta2_s))

    def _moved(self, weights: tuple[float, ...], delta2_s: float) -> RDPI:
        """The model with other numbers within their bounds: only whether they are finite is open."""
        if math.isfinite(delta2_s + sum(weights)):
            return moved(self, RDPI, weights=weights, delta2_s=delta2_s)
        return replace(self, weights=weights, delta2_s=delta2_s)  # which refuses them

    def responses(self, u: Array, v: Array, memory: Array) -> Array:
        """The command, and each play operator's output (V)."""
        columns = np.empty((self.n + 1, len(u)))
        columns[0] = u
        rest = np.array(self.thresholds_V)
        play_columns(u, v, rest, self.delta2_s, memory.copy(), columns[1:])
        return columns.T

    def roughness(self) -> Array:
        """Return that of the weights over their thresholds, ``comb_roughness``."""
        return comb_roughness(self.thresholds_V)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[RDPI, ...]:
        """A comb of thresholds up to half of the widest swing, finer where it is narrow."""
        return (cls.comb(scale, _COMB),)

    @classmethod
    def comb(cls, scale: DataScale, plays: int = _SEARCHED) -> RDPI:
        """A comb of `plays` thresholds up to half of the widest swing, finer where it is narrow.

        A play wider than that only shifts the offset after the first excursion.
        """
        gain = max(scale.stroke_um / scale.span_V, _LEAST_GAIN)
        weights = (0.5 * gain, *[0.5 * gain / plays] * plays)
        delta2_s = 0.05 * scale.span_V / scale.fastest_V_s
        return cls(weights, spread_thresholds(scale.span_V, plays), delta2_s)

    def rises_at(self, ts_s: float) -> bool:
        """Whether A Ts exceeds what the thresholds' growth takes, S δ2 (1 - pole)."""
        return self.A * ts_s > self.S * self.delta2_s * (1.0 - self.rate_pole(ts_s))

    def coefficients(self) -> list[float]:
        """Weights (µm/V), thresholds at rest (V), δ2 (s)."""
        return [*self.weights, *self.thresholds_V, self.delta2_s]

    def static(self) -> RDPI:
        """Return the same model without rate dependence (δ2 = 0)."""
        return replace(self, delta2_s=0.0)

    def rated_at(self, fastest_V_s: float) -> RDPI:
        """Return the model with its δ2, or with one that widens its last play by a tenth."""
        delta2_s = self.delta2_s or 0.1 * self.thresholds_V[-1] / fastest_V_s
        return replace(self, delta2_s=delta2_s)


def comb_roughness(thresholds_V: Sequence[float]) -> Array:
    """Matrix R of the roughness a'R a of weights a of plays over their thresholds (µm²).

    It is U³ ∫ (r dp/dr)² dr of the density p(r) of the weights, U the largest threshold: a change
    within the same ratio of thresholds costs the same at small and at large ones.
    """
    r = np.array(thresholds_V, dtype=np.float64)
    if len(r) < 2:
        return np.zeros((len(r) + 1, len(r) + 1))
    middle, apart = 0.5 * (r[1:] + r[:-1]), np.diff(r)
    edges = np.concatenate([[r[0] - 0.5 * apart[0]], middle, [r[-1] + 0.5 * apart[-1]]])
    density = np.hstack([np.zeros((len(r), 1)), np.diag(1.0 / np.diff(edges))])
    slope = np.diff(density, axis=0) * (r[-1] ** 1.5 * middle / np.sqrt(apart))[:, None]
    products: Array = slope.T @ slope
    return products


# Section III-B. The paper does not print its threshold law there; Eq. 8 is used.
PAPER_III_B = RDPI.from_law([0.729, 0.211, 0.113, 0.061, 0.032, 0.071], 1.750, 3.762e-4)

# Section IV-B, identified from the paper's piezoelectric cantilever.
PAPER_IV_B = RDPI.from_law(
    [0.621, 0.135, 0.1079, 0.0862, 0.0689, 0.0550, 0.0439, 0.0351, 0.0280, 0.0224, 0.0179],
    1.0136,
    3.948e-4,
)
