"""Backlash: lost motion between the actuator and what is measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.play import play
from rdpi_gym.plant.effects.base import DataScale, Effect, Look, Picture, parameter, rows
from rdpi_gym.support.arrays import Array


@njit(cache=True)
def backlash_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; row of ``p``: half width (µm). Row of the state: last output (µm)."""
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = x[0, b]
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            out = play(state[0, b], x[t, b] - p[0, b], x[t, b] + p[0, b])
            state[0, b] = out
            y[t, b] = out


@dataclass(frozen=True)
class Backlash(Effect):
    """Play operator on the displacement, in the middle of its gap at the first sample.

    Examples
    --------
    >>> Backlash(half_width_um=0.5).run([0.0, 2.0, 1.5, 0.0], 1e-3).tolist()
    [0.0, 1.5, 1.5, 0.5]
    """

    half_width_um: float = parameter(
        0.3, "µm", 0.0, 50.0, (0.05, 0.5), "half of the gap, w", neutral=0.0
    )

    name = "backlash"
    slot = "output"
    order = 20
    equation = "y(k) = max(y_m(k) - w, min(y_m(k) + w, y(k-1)))"
    source = (
        "Play operator, Eq. 4 of the paper, on a length. None in flexures; 0.1 to 5 µm in screws is "
        "an estimate."
    )
    signature = "A dead zone after every reversal, however small the motion; a_0 tends to zero."
    experiment = "Reversals smaller than the first threshold."
    cause = (
        "Parts that push but do not pull: a gap between nut and screw or between stack and lever "
        "has to be crossed after each reversal."
    )
    hardware = (
        "Coarse stages with screws, motors with gears, a stack that touches its lever under too "
        "small a preload. Not flexure stages."
    )
    magnitude = (
        "None in flexures; 0.1 to 5 µm in screws (estimate), less with two nuts preloaded against "
        "each other."
    )
    remedy = (
        "Hardware: preload, or flexures in place of guides. Compensation: cross the gap at once "
        "at each reversal by a jump of twice its half-width; what the amplifier cannot jump stays "
        "as an error. Approach every target from the same side where the task allows."
    )
    mistaken_for = ("rate_law", "initial_memory")
    picture = Picture(
        {"half_width_um": 0.2},
        Look("small_loop", "Reversals while every play sticks", "small-triangle", 0.5),
        Look("left_over_command", "What a refit leaves of minor loops", "minor-loops"),
    )
    stands_still = True
    block = staticmethod(backlash_block)
    state_rows = rows(1)  # last output of the play

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Gaps from small to wide: plays imitate one that is far from the start."""
        shares = (3e-3, 0.03, 0.2)
        return tuple(cls.within_bounds(half_width_um=k * scale.stroke_um) for k in shares)


@njit(cache=True)
def bridged_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: half width (µm), share of the bridge. Row of the state: last play (µm)."""
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = x[0, b]
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            out = play(state[0, b], x[t, b] - p[0, b], x[t, b] + p[0, b])
            state[0, b] = out
            y[t, b] = out + p[1, b] * (x[t, b] - out)


@dataclass(frozen=True)
class BridgedGap(Backlash, of=Backlash):
    """Gap bridged by a spring, which moves the load by a share of the motion inside it.

    Examples
    --------
    >>> BridgedGap(half_width_um=0.5, bridge=0.2).run([0.0, 2.0, 1.5, 0.0], 1e-3).round(2).tolist()
    [0.0, 1.6, 1.5, 0.4]
    """

    bridge: float = parameter(0.2, "", 1e-3, 1.0, (0.05, 0.5), "share of the bridge, c")

    form = "bridged by a spring"
    equation = "y(k) = c y_m(k) + (1 - c) z(k), z(k) = max(y_m(k) - w, min(y_m(k) + w, z(k-1)))"
    source = (
        "Play operator, Eq. 4 of the paper, beside a spring: nuts preloaded against each other. "
        "Shares are an estimate."
    )
    signature = (
        "A smaller slope after every reversal, however small the motion, until the gap is crossed."
    )
    block = staticmethod(bridged_block)

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The fitted gap and a wider one, with a soft and a stiff bridge."""
        width = simpler.values["half_width_um"]
        return tuple(
            cls.within_bounds(half_width_um=more * width, bridge=share)
            for more in (1.0, 2.0)
            for share in (0.05, 0.3)
        )
