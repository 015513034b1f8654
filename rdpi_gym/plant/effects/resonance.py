"""Resonance: the stage's mass on the actuator's stiffness."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, Extension, Look, Picture, parameter, rows
from rdpi_gym.plant.effects.linear import linear_block, pack_modes
from rdpi_gym.support.arrays import Array

_PERIODS = 10.0
"""Least periods of a mode in a record; a slower one is a drift there."""
_BAND = 0.06
"""Logarithm of the ratio of the ends of a band of a spectrum: about the width of a mode (1)."""
_PEAKS = 3
"""Peaks of a spectrum that may be a mode: that of the hum and that of a triangle may be higher."""


def _lag_s(f0_hz: float, damping: float) -> float:
    """Lag of a mode behind a slow ramp (s)."""
    return damping / (math.pi * f0_hz)


@dataclass(frozen=True)
class Resonance(Effect):
    """One mode with a static gain of one.

    Examples
    --------
    >>> ringing = Resonance(f0_hz=500.0, damping=0.01).run([0.0] + [1.0] * 4000, 1e-5)
    >>> float(ringing.max().round(2)), int(ringing.argmax())  # overshoot after half a period
    (1.97, 101)
    """

    f0_hz: float = parameter(1000.0, "Hz", 0.1, 2e5, (300.0, 1e4), "undamped natural frequency")
    damping: float = parameter(
        0.02, "1", 1e-4, 0.7, (0.005, 0.1), "damping ratio ζ; from 0.71 it is a lag"
    )

    name = "resonance"
    slot = "output"
    order = 10
    equation = "y'' + 2 ζ ω0 y' + ω0² y = ω0² y_h, ω0 = 2π f0"
    source = (
        "A stage at 739 Hz (arXiv 2412.18374); bare stacks at tens to hundreds of kHz (Fleming, "
        "studylib.net/doc/18813258), lower with the mass they carry. The damping is an estimate."
    )
    signature = (
        "Residual like the acceleration, growing with f²; ringing at f0 after corners; the gain of "
        "small signals rises with frequency."
    )
    experiment = "A multisine smaller than the first threshold up to f0, or steps sampled fast."
    cause = (
        "The stiffness of stack and flexures and the moving mass form a lightly damped "
        "oscillator; the path is measured behind it."
    )
    hardware = (
        "Every stage with a moving platform, most of all long-stroke stages with levers and "
        "anything that carries a sample."
    )
    magnitude = (
        "A commercial stage has its first mode at 739 Hz (arXiv 2412.18374), bare stacks at tens "
        "to hundreds of kHz (Fleming, studylib.net/doc/18813258). Damping ratios of 0.005 to 0.1 "
        "are an estimate. At a tenth of f0 the gain is 1 % too high, at a third 12 %."
    )
    remedy = (
        "Hardware: a lighter platform, a stiffer flexure, damping. Compensation: invert the mode "
        "along a smooth reference (two derivatives, hence preview), notch or shape the command; "
        "in feedback, damp it actively before any integral gain is raised (Fleming and Leang, ACC "
        "2013)."
    )
    mistaken_for = ("delay", "sensor_lag", "actuator_lag")
    picture = Picture(
        {"f0_hz": 1000.0, "damping": 0.02},
        Look("gain", "A small multisine: every play sticks"),
        Look("response", "A step of 5 V", "step"),
    )
    block = staticmethod(linear_block)
    state_rows = rows(3)  # last input, displacement, velocity
    carried: ClassVar[Mapping[str, int]] = {"f0_hz": 2}

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """From the fastest mode that the sampling shows to the slowest that the longest record does.

        As close as a damping ratio of 0.05 makes a fit converge: a mode that rings for fifteen
        periods is not found from 10 % beside it. And broad ones, from which a step promises what
        the mode is worth: one that rings at another frequency promises nothing.
        """
        fastest, slowest = 0.25 / scale.shortest_s, _PERIODS / scale.longest_s
        count = max(math.ceil(math.log(fastest / slowest, 1.5)), 1)
        modes = (
            cls.within_bounds(f0_hz=fastest / 1.5**k, damping=damping)
            for k in range(count)
            for damping in (0.05, 0.3)
        )
        return tuple(dict.fromkeys(modes))  # the bound stands for all that are slower

    @classmethod
    def seen_in(cls, t_s: Array, left_um: Array) -> tuple[Self, ...]:
        """The highest peaks of its spectrum over that of the octaves around them."""
        n, ts_s = left_um.size, float(np.median(np.diff(t_s)))
        f_hz = np.fft.rfftfreq(n, ts_s)
        power = np.abs(np.fft.rfft(left_um * np.hanning(n))) ** 2
        edges_hz = np.exp(np.arange(math.log(_PERIODS / (n * ts_s)), math.log(0.25 / ts_s), _BAND))
        edges = np.unique(np.searchsorted(f_hz, edges_hz))
        if edges.size < 2:
            return ()
        level = np.log(np.add.reduceat(power, edges)[:-1] / np.diff(edges) + 1e-300)
        beside = round(math.log(2.0) / _BAND)
        around = [np.median(level[max(k - beside, 0) : k + beside + 1]) for k in range(level.size)]
        highest = np.argsort(around - level)[:_PEAKS]
        peaks_hz = np.sqrt(f_hz[edges[:-1]] * f_hz[edges[1:]])[highest]
        return tuple(cls.within_bounds(f0_hz=float(f0), damping=0.05) for f0 in peaks_hz)

    @property
    def slow_lag_s(self) -> float:
        """Twice the damping over the angular frequency."""
        return _lag_s(self.f0_hz, self.damping)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Displacement and velocity over ω0, so that both states are micrometres."""
        return pack_modes([(1.0, self.f0_hz, self.damping)], 0.0, ts_s)


@dataclass(frozen=True)
class ResonanceWithZero(Extension, of=Resonance):
    """One mode beside a part of the path that does not vibrate: an antiresonance at f0 / √s.

    Examples
    --------
    >>> stiff = ResonanceWithZero(f0_hz=500.0, damping=0.01, static_share=0.25)
    >>> stiff.run([0.0, 1.0, 1.0], 1e-6).round(2).tolist()  # a quarter follows at once
    [0.0, 0.25, 0.25]
    """

    f0_hz: float = 1000.0
    damping: float = 0.02
    static_share: float = parameter(
        0.1, "1", 0.0, 4.0, (0.05, 0.5), "share without the mode, s", neutral=0.0
    )

    form = "with a zero"
    equation = "y = (1 - s) y_1 + s y_h, y_1'' + 2 ζ ω0 y_1' + ω0² y_1 = ω0² y_h, ω0 = 2π f0"
    source = (
        "The residual of a modal series that is cut off: what higher modes add is static (Ewins, "
        "Modal Testing, 2000). Shares are an estimate."
    )
    cause = (
        "The sensor sees the actuator's end and not the mass, or modes above those that the "
        "sampling shows: a share of the path follows at once, and cancels the mode at one frequency."
    )
    signature = (
        "As a resonance, with a notch above it (below it where the share exceeds 1) at which small "
        "signals vanish and the phase comes back."
    )
    block = staticmethod(linear_block)
    state_rows = rows(3)  # last input, displacement, velocity
    carried: ClassVar[Mapping[str, int]] = {"f0_hz": 2}

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The same mode with a notch far above it, and one below it."""
        return tuple(
            cls.within_bounds(**simpler.values, static_share=share) for share in (0.02, 1.5)
        )

    @property
    def slow_lag_s(self) -> float:
        """That of the share with the mode."""
        return (1.0 - self.static_share) * _lag_s(self.f0_hz, self.damping)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """One mode and a feedthrough."""
        share = self.static_share
        return pack_modes([(1.0 - share, self.f0_hz, self.damping)], share, ts_s)


@dataclass(frozen=True)
class TwoModes(Extension, of=Resonance):
    """Two modes side by side, together with a static gain of one.

    Examples
    --------
    >>> both = TwoModes(500.0, 0.05, 1700.0, 0.05, 0.2).run([0.0] + [1.0] * 20000, 1e-5)
    >>> float(both[-1].round(6))
    1.0
    """

    f0_hz: float = 1000.0
    damping: float = 0.02
    second_hz: float = parameter(
        3000.0, "Hz", 0.1, 2e5, (1e3, 2e4), "undamped natural frequency of the second, f2"
    )
    second_damping: float = parameter(0.02, "1", 1e-4, 0.7, (0.005, 0.1), "its damping ratio ζ2")
    second_share: float = parameter(
        0.1, "1", -0.5, 0.5, (0.05, 0.3), "its share of the displacement at rest, s"
    )

    form = "two modes"
    equation = "y = (1 - s) y_1 + s y_2, y_i'' + 2 ζi ωi y_i' + ωi² y_i = ωi² y_h, ωi = 2π fi"
    source = (
        "Modal series (Ewins, Modal Testing, 2000). A share below zero is a mode that moves against "
        "the other. Shares are an estimate."
    )
    cause = (
        "Flexures, levers and the base have modes of their own; a share of the motion passes "
        "through each."
    )
    signature = (
        "Two peaks in the gain of small signals, with a notch in between where both shares have the "
        "same sign; beats after corners."
    )
    block = staticmethod(linear_block)
    state_rows = rows(5)  # last input, displacement and velocity of each mode
    carried: ClassVar[Mapping[str, int]] = {"f0_hz": 2, "second_hz": 4}

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The same mode with one above it and below it, of the static share where there is one, else small."""
        f0_hz, share = simpler.values["f0_hz"], simpler.values.get("static_share", 0.02)
        return tuple(
            cls.within_bounds(
                f0_hz=f0_hz, damping=simpler.values["damping"],
                second_hz=ratio * f0_hz, second_damping=0.03, second_share=share,
            )
            for ratio in (2.5, 0.5)
        )  # fmt: skip

    @property
    def slow_lag_s(self) -> float:
        """That of each mode by its share."""
        share = self.second_share
        first_s = _lag_s(self.f0_hz, self.damping)
        return (1.0 - share) * first_s + share * _lag_s(self.second_hz, self.second_damping)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Two modes, each with its share."""
        share = self.second_share
        first = (1.0 - share, self.f0_hz, self.damping)
        return pack_modes([first, (share, self.second_hz, self.second_damping)], 0.0, ts_s)
