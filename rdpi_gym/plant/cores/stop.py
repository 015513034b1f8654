"""The stop-type Prandtl-Ishlinskii model: elastic elements that slip, as friction has them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rdpi_gym.plant.cores.families import (
    ThresholdCore,
    check_thresholds,
    check_weights,
    set_numbers,
    spread_thresholds,
)
from rdpi_gym.plant.cores.play import given_rate_block, play_columns, rdpi_block
from rdpi_gym.plant.parameters import DataScale
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

# Stops of a fit's comb, and what is left at least of the gain at a turn.
_COMB, _LEAST_SHARE = 40, 1e-6
# Stops of a search's comb: with sixty, what lies between two of them shows beside little noise.
_SEARCHED = 100


@dataclass(frozen=True)
class Stop(ThresholdCore):
    """Sum of a line and of stop operators, whose loops turn clockwise.

    A stop is a spring with a slider: it follows the command until it carries its threshold, and
    slips from there on. The Maxwell-slip and Iwan models are this one, with forces w_i r_i at which
    their elements slip.

    Parameters
    ----------
    weights
        w_1 ... w_n (µm/V), not negative: the stiffness of each element.
    thresholds_V
        r_1 < ... < r_n (V), above zero: half of the travel between slipping one way and the other.
    slope
        c (µm/V), of either sign: the gain while every element slips. What follows a turn,
        c + w_1 + ... + w_n, is above zero.
    rate_bandwidth_hz
        As every core has it; no rate matters here.

    Raises
    ------
    InputError
        A weight is negative or not finite, the thresholds do not increase from above zero or are
        not one for each weight, or the gain at a turn is not above zero.

    Examples
    --------
    >>> friction = Stop(weights=(2.0, 1.0), thresholds_V=(1.0, 4.0))
    >>> friction.a0, friction.force_um
    (3.0, 6.0)

    Notes
    -----
    S_r[u] = u - P_r[u] with the play operator P_r, so that its kernel is that of RDPI, with
    c + w_1 + ... + w_n for a_0 and -w_i for a_i, and its memory is that of the plays: the place at
    which each spring would be slack.
    """

    weights: tuple[float, ...]
    thresholds_V: tuple[float, ...]
    slope: float = 0.0
    rate_bandwidth_hz: float | None = None

    name = "stop"
    block = staticmethod(given_rate_block)
    fused = staticmethod(rdpi_block)
    linear = ("slope", "weights")
    either_sign = ("slope",)
    title = "Prandtl-Ishlinskii model of stop operators"
    equation = "y = c u + sum of w_i S_i[u], S_i the stop operator of threshold r_i, w_i >= 0"
    source = (
        "Brokate, Sprekels, Hysteresis and Phase Transitions, 1996; Iwan, Journal of Applied "
        "Mechanics 33, 1966; Al-Bender, Lampaert, Swevers, IEEE Transactions on Automatic Control "
        "50, 2005 (Maxwell slip)."
    )
    signature = (
        "Loops that turn clockwise: steep right after a turn, flat once every element slips, odd "
        "about their middle, the same at every rate."
    )
    experiment = "Triangles of falling size about one point, down to less than the smallest slip."
    hardware = "Friction dampers, bearings and guides: force over displacement."
    clockwise = True
    spaced = True

    def __post_init__(self) -> None:
        super().__post_init__()
        set_numbers(self, "weights", "thresholds_V")
        if not self.weights:
            raise InputError("weights is empty; give one weight (µm/V) for each stop operator")
        check_weights(self.weights, first=1)
        check_thresholds(self.thresholds_V, len(self.weights), "stop")
        if not is_finite(self.slope):
            raise InputError(f"slope is {quoted(self.slope)}; c is a finite gain (µm/V)")
        if not self.a0 > 0:
            raise InputError(
                f"the gain right after a turn, c + the sum of the weights, is {self.a0}; it is above 0 µm/V"
            )

    @property
    def a0(self) -> float:
        """Gain (µm/V) while every stop sticks: c + w_1 + ... + w_n."""
        return math.fsum((self.slope, *self.weights))

    @property
    def A(self) -> float:
        """Sum of the sizes of all gains (µm/V): |c| + w_1 + ... + w_n."""
        return math.fsum((abs(self.slope), *self.weights))

    @property
    def force_um(self) -> float:
        """w_1 r_1 + ... + w_n r_n (µm): half of the loop's height while every stop slips."""
        return math.fsum(w * r for w, r in zip(self.weights, self.thresholds_V, strict=True))

    def with_gains(self, gains: Sequence[float]) -> Stop:
        """Return the model with another slope and weights (µm/V); its gain at a turn stays above zero."""
        slope, *others = (float(gain) for gain in gains)
        weights = [max(gain, 0.0) for gain in others]
        if not any(weights):  # a line alone: it has no loop, but it may have a gain
            weights[0] = _LEAST_SHARE * max(abs(slope), _LEAST_SHARE)
        least = -(1.0 - _LEAST_SHARE) * math.fsum(weights)
        return replace(self, weights=tuple(weights), slope=max(slope, least))

    def responses(self, u: Array, v: Array, memory: Array) -> Array:
        """The command, and each stop operator's output (V)."""
        columns = np.empty((self.n + 1, len(u)))
        columns[0] = u
        rest = np.array(self.thresholds_V)
        play_columns(u, v, rest, 0.0, memory.copy(), columns[1:])
        columns[1:] = u - columns[1:]
        return columns.T

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Stop, ...]:
        """A comb of thresholds up to half of the widest swing, finer where it is narrow."""
        return (cls._comb(scale, _COMB),)

    @classmethod
    def comb(cls, scale: DataScale) -> Stop:
        """The same comb with thresholds so close that a stop between two of them is not missed."""
        return cls._comb(scale, _SEARCHED)

    @classmethod
    def _comb(cls, scale: DataScale, stops: int) -> Stop:
        thresholds = spread_thresholds(scale.span_V, stops)
        # each slips at its share of the stroke
        return cls(tuple(scale.stroke_um / (stops * r) for r in thresholds), thresholds)

    def pruned(self) -> Stop:
        """The whole comb: friction has few elements, and those that bear an effect not yet there are others."""
        return self

    def coefficients(self) -> list[float]:
        """Those of the RDPI kernel: gain at a turn and weights of its plays (µm/V), thresholds (V), δ2 of 0 s."""
        return [self.a0, *(-w for w in self.weights), *self.thresholds_V, 0.0]
