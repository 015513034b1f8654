"""Phenomena outside the catalogue: an unrecorded force, and hysteresis of another kind."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np
from numba import njit

from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.virtual_lab.dataset import Truth, displacement


@dataclass(frozen=True)
class Outsider:
    """Something that displaces the stage and that no effect of the catalogue is."""

    name: ClassVar[str]

    def displacement(self, truth: Truth, t: Array, u: Array) -> Array:
        """Displacement (µm) at times on the clock (s), for commands (V), ``(T,)``.

        A hysteresis of another kind stands in the place of the plant of the truth.
        """
        return self.of_command(u)

    def of_command(self, u: Array) -> Array:
        """Displacement (µm) for commands (V), ``(T,)``."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Return kind and numbers, for the record of the truth."""
        return {"outside": self.name, **asdict(self)}


@dataclass(frozen=True)
class Force(Outsider):
    """Band-limited random force on the plant: a sum of sines that follows the clock."""

    rms_um: float  # displacement that it causes (µm rms)
    # band
    low_hz: float
    high_hz: float
    seed: int  # of frequencies and phases

    name: ClassVar[str] = "force"
    _LINES: ClassVar[int] = 100

    def displacement(self, truth: Truth, t: Array, u: Array) -> Array:
        """Displacement of the plant and of the force."""
        rng = np.random.default_rng(self.seed)
        frequencies = rng.uniform(self.low_hz, self.high_hz, self._LINES)
        phases = rng.uniform(0.0, 2.0 * math.pi, self._LINES)
        pushed = np.zeros_like(t)
        for frequency, phase in zip(frequencies, phases, strict=True):
            pushed += np.sin(2.0 * math.pi * frequency * t + phase)
        return displacement(truth, t, u) + self.rms_um * math.sqrt(2.0 / self._LINES) * pushed


@njit(cache=True)
def _bouc_wen(u: Array, width: float, exponent: float, share: float) -> Array:
    """Runge-Kutta over the voltage for w dz/du = 1 - |z|^n (σ sgn(du z) + 1 - σ)."""
    out, z = np.empty_like(u), 0.0
    out[0] = z
    for k in range(1, len(u)):
        change = u[k] - u[k - 1]
        parts = max(1, math.ceil(abs(change) / (0.02 * width)))
        h = change / parts / width
        way = 1.0 if change > 0.0 else -1.0
        for _ in range(parts):
            k1 = 1.0 - abs(z) ** exponent * (share * way * np.sign(z) + 1.0 - share)
            x = z + 0.5 * h * k1
            k2 = 1.0 - abs(x) ** exponent * (share * way * np.sign(x) + 1.0 - share)
            x = z + 0.5 * h * k2
            k3 = 1.0 - abs(x) ** exponent * (share * way * np.sign(x) + 1.0 - share)
            x = z + h * k3
            k4 = 1.0 - abs(x) ** exponent * (share * way * np.sign(x) + 1.0 - share)
            z += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        out[k] = z
    return out


@dataclass(frozen=True)
class BoucWen(Outsider):
    """Bouc-Wen hysteresis: y = A u - D z with w dz/du = 1 - |z|^n (σ sgn(du z) + 1 - σ).

    Low and Guo, "Modeling of a three-layer piezoelectric bimorph beam with hysteresis", J.
    Microelectromech. Syst. 4(4), 1995, use this form for a piezo actuator.
    """

    # A (µm/V) and D (µm)
    gain_um_V: float
    depth_um: float
    width_V: float  # width w (V)
    # n and σ
    exponent: float
    share: float

    name: ClassVar[str] = "bouc-wen"

    def of_command(self, u: Array) -> Array:
        """Displacement (µm) for commands (V), ``(T,)``."""
        z = _bouc_wen(u, self.width_V, self.exponent, self.share)
        return np.asarray(self.gain_um_V * u - self.depth_um * z)


@njit(cache=True)
def _relays(u: Array, half_width: Array, density: Array, spread: float, middle: float) -> Array:
    """Relays of one half width switch in the order of their middles, up to a front that follows u."""
    out, front = np.empty_like(u), np.zeros_like(half_width)
    for k in range(len(u)):
        total = 0.0
        for i in range(len(half_width)):
            # The front's relays have switched up where u passed m + h, down where it passed m - h.
            front[i] = max(u[k] - half_width[i], min(u[k] + half_width[i], front[i]))
            switched = math.tanh((front[i] - middle) / spread) + math.tanh(middle / spread)
            total += density[i] * spread * switched
        out[k] = total
    return out


@dataclass(frozen=True)
class Preisach(Outsider):
    """Preisach hysteresis whose relays are densest about one voltage.

    Density exp(-h / w) sech²((m - c) / s) over the half width h and the middle m of a relay. A
    Prandtl-Ishlinskii model has a density that does not depend on m.
    """

    # gain without relays, and that of all relays where they are densest (µm/V)
    gain_um_V: float
    relay_um_V: float
    # w, s and c (V)
    width_V: float
    spread_V: float
    middle_V: float

    name: ClassVar[str] = "preisach"
    _WIDTHS: ClassVar[int] = 120

    def of_command(self, u: Array) -> Array:
        """Displacement (µm) for commands (V), ``(T,)``."""
        # Half widths of equal share of the exponential density.
        shares = (np.arange(self._WIDTHS) + 0.5) / self._WIDTHS
        half_width = -self.width_V * np.log1p(-shares)
        density = np.full(self._WIDTHS, self.relay_um_V / self._WIDTHS)
        relays = _relays(u, half_width, density, self.spread_V, self.middle_V)
        return np.asarray(self.gain_um_V * u + relays)


OUTSIDERS = (Force.name, BoucWen.name, Preisach.name)


def draw_outsider(kind: str, truth: Truth, rng: np.random.Generator) -> Outsider:
    """Draw something outside the catalogue, in the size of a plant."""
    h, span = truth.plant.hysteresis, truth.span_V
    if kind == Force.name:
        return Force(
            rms_um=truth.noise_um * rng.uniform(3.0, 10.0),
            low_hz=rng.uniform(1.0, 20.0),
            high_hz=rng.uniform(50.0, 200.0),
            seed=int(rng.integers(2**31)),
        )
    if kind == BoucWen.name:
        width = span * rng.uniform(0.1, 0.3)
        return BoucWen(
            h.A, h.S * width, width, exponent=rng.uniform(1.0, 2.0), share=rng.uniform(0.5, 0.9)
        )
    if kind == Preisach.name:
        return Preisach(
            h.a0, h.S, width_V=span * rng.uniform(0.1, 0.3),
            spread_V=span * rng.uniform(0.6, 1.5), middle_V=span * rng.uniform(-0.3, 0.3),
        )  # fmt: skip
    raise InputError(
        f"nothing outside the catalogue is named {kind!r}; give {', '.join(OUTSIDERS)}"
    )
