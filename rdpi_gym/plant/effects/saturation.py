"""Saturation: an amplifier whose gain softens towards its rails, or that clips at them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, Look, Picture, Stateless, parameter
from rdpi_gym.support.arrays import Array

FAR = 10.0
"""Half swings of the command from which on rails are out of its reach."""


@njit(cache=True)
def saturation_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: limit, centre (V). No state."""
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            limit, centre = p[0, b], p[1, b]
            y[t, b] = centre + limit * math.tanh((x[t, b] - centre) / limit)


@dataclass(frozen=True)
class Saturation(Stateless):
    """Amplifier that softens towards limit_V above and below centre_V.

    Examples
    --------
    >>> Saturation(limit_V=100.0).run([1.0, 50.0, 1000.0], 1e-3).round(2).tolist()
    [1.0, 46.21, 100.0]
    """

    limit_V: float = parameter(
        100.0, "V", 1e-9, 1e9, (60.0, 160.0), "distance of both rails from the centre, u_s"
    )
    centre_V: float = parameter(
        0.0, "V", -1e9, 1e9, (0.0, 0.0), "middle of the amplifier's range, u_c", fixed=True
    )

    name = "saturation"
    slot = "input"
    order = 10
    equation = "u' = u_c + u_s tanh((u - u_c) / u_s)"
    source = "Smooth limiter; the amount is an estimate (limits of the amplifier)."
    signature = (
        "An odd, single-valued curve: the gain falls with amplitude, which no Prandtl-Ishlinskii "
        "model with non-negative weights can do."
    )
    experiment = "Slow sines or triangles at four amplitudes up to the full range."
    cause = (
        "The amplifier's output stage runs out of supply voltage, and the strain of the ceramic "
        "itself flattens as more and more of its domains are aligned."
    )
    hardware = (
        "Any stack or tube driven close to the rails of its amplifier; unipolar stacks rated for "
        "-30 to 150 V that are used over their whole range."
    )
    magnitude = (
        "Within the rated range most amplifiers are linear to about 1 %; the last tenth before "
        "the rails may lose 5 to 10 % of the gain (both estimates). With u_s = 100 V the voltage "
        "at 50 V is 46.2 V, 8 % short."
    )
    remedy = (
        "Hardware: leave a tenth of the supply unused, or take an amplifier with higher rails. "
        "Compensation: the limiter has a closed inverse short of its rails, u_s artanh(u / u_s); "
        "beyond them no command helps and the reference must be made smaller."
    )
    mistaken_for = ("asymmetry", "congruency", "slew_limit")
    picture = Picture(
        {"limit_V": 60.0},
        Look("loops", "A slow decaying triangle", "triangle-slow"),
        Look("left_over_command", "What a refit leaves of it", "triangle-slow"),
    )
    block = staticmethod(saturation_block)

    def is_idle(self, scale: DataScale) -> bool:
        """Whether no command comes near a rail."""
        return self.limit_V - abs(self.centre_V - scale.centre_V) > FAR * scale.span_V

    @classmethod
    def traces(cls, scale: DataScale) -> tuple[Effect, ...]:
        """Hard rails at either end: what bends there at all is near a sum of such corners."""
        reach = [share * scale.span_V for share in _CORNERS]
        upper = [HardUpperRail.within_bounds(high_V=scale.centre_V + far) for far in reach]
        lower = [HardLowerRail.within_bounds(low_V=scale.centre_V - far) for far in reach]
        return (*upper, *lower)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Rails not far and far beyond the measured command."""
        return tuple(
            cls.within_bounds(limit_V=k * scale.span_V, centre_V=scale.centre_V) for k in (1.5, 4.0)
        )


@njit(cache=True)
def hard_rails_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: lower and upper rail (V). No state."""
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = min(max(x[t, b], p[0, b]), p[1, b])


_FAR_V = 1e30
# Of half the swing, where its corners are looked for.
_CORNERS = (0.5, 0.7, 0.85, 0.95)


class _Hard(Stateless):
    """Rails that clip."""

    signature = "Flat tops: beyond a command the displacement stays where it is."
    block = staticmethod(hard_rails_block)


@dataclass(frozen=True)
class HardUpperRail(_Hard, of=Saturation):
    """Amplifier or converter that is linear below high_V and clips there.

    Examples
    --------
    >>> HardUpperRail(high_V=19.0).run([-30.0, 5.0, 30.0], 1e-3).tolist()
    [-30.0, 5.0, 19.0]
    """

    high_V: float = parameter(100.0, "V", -1e9, 1e9, (60.0, 120.0), "upper rail, u_h")

    form = "hard upper rail"
    equation = "u' = min(u, u_h)"

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """A rail within the measured range: outside of it nothing would draw it in."""
        return tuple(
            cls.within_bounds(high_V=scale.centre_V + share * scale.span_V) for share in (0.6, 0.9)
        )

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Lower and upper rail (V)."""
        return [-_FAR_V, self.high_V]


@dataclass(frozen=True)
class HardLowerRail(_Hard, of=Saturation):
    """Amplifier or converter that is linear above low_V and clips there.

    Examples
    --------
    >>> HardLowerRail(low_V=-22.0).run([-30.0, 5.0, 30.0], 1e-3).tolist()
    [-22.0, 5.0, 30.0]
    """

    low_V: float = parameter(-30.0, "V", -1e9, 1e9, (-60.0, -20.0), "lower rail, u_l")

    form = "hard lower rail"
    equation = "u' = max(u, u_l)"

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """A rail within the measured range: outside of it nothing would draw it in."""
        return tuple(
            cls.within_bounds(low_V=scale.centre_V - share * scale.span_V) for share in (0.6, 0.9)
        )

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Lower and upper rail (V)."""
        return [self.low_V, _FAR_V]


@dataclass(frozen=True)
class HardRails(_Hard, of=Saturation):
    """Amplifier or converter that is linear between low_V and high_V and clips there.

    Examples
    --------
    >>> HardRails(low_V=-22.0, high_V=19.0).run([-30.0, 5.0, 30.0], 1e-3).tolist()
    [-22.0, 5.0, 19.0]
    """

    low_V: float = parameter(-30.0, "V", -1e9, 1e9, (-60.0, -20.0), "lower rail, u_l")
    high_V: float = parameter(100.0, "V", -1e9, 1e9, (60.0, 120.0), "upper rail, u_h")

    form = "hard rails"
    equation = "u' = min(max(u, u_l), u_h)"

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Rails within the measured range: outside of it nothing would draw them in."""
        return tuple(
            cls.within_bounds(
                low_V=scale.centre_V - share * scale.span_V,
                high_V=scale.centre_V + share * scale.span_V,
            )
            for share in (0.6, 0.85)
        )


def _free_centre() -> Any:
    return parameter(0.0, "V", -1e9, 1e9, (-40.0, 40.0), Saturation.parameters[1].meaning)


@dataclass(frozen=True)
class SoftUnlikeRails(Saturation, of=Saturation):
    """Amplifier that softens towards rails whose middle is not that of the command.

    Examples
    --------
    >>> SoftUnlikeRails(100.0, 20.0).run([-1000.0, 20.0, 1000.0], 1e-3).round(2).tolist()
    [-80.0, 20.0, 120.0]
    """

    centre_V: float = _free_centre()

    form = "soft unlike rails"
    equation = "u' = u_c + u_s tanh((u - u_c) / u_s), u_c free"
    signature = "Flattening of one end of the range more than of the other."

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """A centre on either side of the measured one."""
        return tuple(
            cls.within_bounds(
                limit_V=1.5 * scale.span_V, centre_V=scale.centre_V + side * scale.span_V
            )
            for side in (-0.3, 0.3)
        )


@njit(cache=True)
def knee_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: limit above, limit below, centre (V), sharpness. No state."""
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            swing = x[t, b] - p[2, b]
            share, power = abs(swing) / (p[0, b] if swing > 0.0 else p[1, b]), p[3, b]
            if share <= 1.0:
                swing *= (1.0 + share**power) ** (-1.0 / power)
            else:  # the same, without a power that overflows
                swing = swing * (1.0 + share**-power) ** (-1.0 / power) / share
            y[t, b] = p[2, b] + swing


@dataclass(frozen=True)
class RailsWithAKnee(Stateless, of=Saturation):
    """Amplifier that is linear up to a knee of any sharpness in front of its rails.

    Examples
    --------
    >>> amplifier = RailsWithAKnee(100.0, 50.0, 0.0, sharpness=4.0)
    >>> amplifier.run([10.0, 50.0, 100.0, 1000.0, -1000.0], 1e-3).round(2).tolist()
    [10.0, 49.25, 84.09, 100.0, -50.0]
    """

    up_V: float = parameter(
        100.0, "V", 1e-9, 1e9, (60.0, 160.0), "distance of the upper rail from the centre, u_h"
    )
    down_V: float = parameter(
        100.0, "V", 1e-9, 1e9, (60.0, 160.0), "distance of the lower rail from the centre, u_l"
    )
    centre_V: float = _free_centre()
    sharpness: float = parameter(3.0, "1", 1.0, 50.0, (2.0, 6.0), "sharpness of the knee, p")

    form = "rails with a knee"
    equation = (
        "u' = u_c + (u - u_c) / (1 + |(u - u_c) / u_s|^p)^(1/p), u_s = u_h above u_c, u_l below"
    )
    source = "Rapp's model of amplifiers: soft for a small p, hard rails for a large one."
    signature = SoftUnlikeRails.signature
    block = staticmethod(knee_block)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Rails a little beyond the measured command, and one of them farther."""
        return tuple(
            cls.within_bounds(
                up_V=up * scale.span_V, down_V=down * scale.span_V,
                centre_V=scale.centre_V, sharpness=3.0,
            )
            for up, down in ((1.1, 1.1), (1.1, 2.0), (2.0, 1.1))
        )  # fmt: skip
