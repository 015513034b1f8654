"""Resonance: the stage's mass on the actuator's stiffness."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, Look, Parameter, Picture
from rdpi_gym.plant.effects.linear import linear_block, pack_linear


@dataclass(frozen=True)
class Resonance(Effect):
    """One mode with a static gain of one.

    Examples
    --------
    >>> ringing = Resonance(f0_hz=500.0, damping=0.01).run([0.0] + [1.0] * 4000, 1e-5)
    >>> float(ringing.max().round(2)), int(ringing.argmax())  # overshoot after half a period
    (1.97, 101)
    """

    f0_hz: float = 1000.0
    damping: float = 0.02

    name = "resonance"
    slot = "output"
    order = 10
    parameters = (
        Parameter("f0_hz", "Hz", 10.0, 2e5, (300.0, 1e4), "undamped natural frequency"),
        Parameter(
            "damping", "1", 1e-4, 0.7, (0.005, 0.1), "damping ratio ζ; from 0.71 it is a lag"
        ),
    )
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

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """From half the slowest to the fastest mode that the sampling shows."""
        fastest = 0.25 / scale.shortest_s
        return tuple(cls.within_bounds(f0_hz=fastest / 3.0**k, damping=0.05) for k in range(4))

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Displacement and velocity over ω0, so that both states are micrometres."""
        w = 2.0 * math.pi * self.f0_hz
        a = np.array([[0.0, w], [-w, -2.0 * self.damping * w]])
        return pack_linear(a, np.array([0.0, w]), np.array([1.0, 0.0]), 0.0, ts_s)

    def state_rows(self, ts_s: float) -> int:
        """Last input, displacement, velocity."""
        return 3
