"""Asymmetry: a stack that stretches and shrinks by different amounts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, Look, Parameter, Picture
from rdpi_gym.support.arrays import Array


@njit(cache=True)
def asymmetry_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; row of ``p``: c / Y (1/µm). No state."""
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            y[t, b] = x[t, b] + p[0, b] * x[t, b] * x[t, b]


@dataclass(frozen=True)
class Asymmetry(Effect):
    """Quadratic distortion of the hysteretic displacement.

    Where its zero lies does not matter: a shift of it is a change of all weights and of the offset.

    Examples
    --------
    >>> Asymmetry(coefficient=0.05, span_um=20.0).run([-20.0, 0.0, 20.0], 1e-3).tolist()
    [-19.0, 0.0, 21.0]
    """

    coefficient: float = 0.03
    span_um: float = 40.0

    name = "asymmetry"
    slot = "hysteresis"
    order = 20
    parameters = (
        Parameter(
            "coefficient", "1", -0.4, 0.4, (0.01, 0.05),
            "distortion c at the displacement Y, as a share of it", neutral=0.0,
        ),
        Parameter("span_um", "µm", 1e-3, 1e4, (40.0, 40.0), "displacement Y", fixed=True),
    )  # fmt: skip
    equation = "y = y_h + c y_h² / Y"
    source = (
        "Even part of a memoryless curve behind the plays, in the place where Kuhnen's modified "
        "Prandtl-Ishlinskii model has one-sided dead zones; Gu, Zhu, Su (IEEE TIE 61(3), 2014) add "
        "a cubic polynomial of the command instead. 1 to 5 % of the stroke is an estimate."
    )
    signature = (
        "Even harmonics of a half-wave symmetric input, alike on both branches and at every rate; "
        "play operators are odd and leave none."
    )
    experiment = "Sines about zero at two amplitudes or more; the half-wave test needs no model."
    cause = (
        "Poled ceramic is not the same in both directions: strain along the poling direction "
        "grows differently from strain against it, and preload and mechanics bend the curve "
        "further."
    )
    hardware = (
        "Unipolar stacks, benders and tubes driven about an offset; levers and flexures that are "
        "bent far."
    )
    magnitude = (
        "A few per cent of the stroke: 1 to 5 % is an estimate. The measured PICMA record of this "
        "project is described with 8.6 %. Modified Prandtl-Ishlinskii models were made for it "
        "(Gu, Zhu, Su, IEEE TIE 61(3), 2014)."
    )
    remedy = (
        "Hardware: a charge drive, or a sensor and feedback. Compensation: a static inverse of "
        "the curve in front of the inverse of the hysteresis; where y_h² is added, it is the root "
        "of a quadratic."
    )
    mistaken_for = ("congruency", "saturation", "thermal_drift")
    picture = Picture(
        {"coefficient": 0.05},
        Look("loops", "A large sine about zero", "sine-10hz"),
        Look("left_over_command", "What a refit leaves of it", "sine-10hz"),
    )
    block = staticmethod(asymmetry_block)

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """One start, at the measured stroke."""
        return (cls.within_bounds(coefficient=0.01, span_um=scale.stroke_um),)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Coefficient of the square, c / Y (1/µm)."""
        return [self.coefficient / self.span_um]

    def state_rows(self, ts_s: float) -> int:
        """None: the curve has no memory."""
        return 0
