"""Mains hum: a line of the mains in the measurement."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import (
    Clocked,
    DataScale,
    Effect,
    Extension,
    Look,
    Picture,
    parameter,
    rows,
)
from rdpi_gym.support.arrays import Array

# Samples after which the phasor is set anew: rounding stays far below a picometre.
_RENEWED = 256
# Samples in which a line is looked for, how far from the mains' frequency, and lines at most.
_SEEN, _NEAR, _MOST_LINES = 20_000, 0.01, 120


@njit(cache=True)
def mains_hum_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: amplitude (µm), 2π f (rad/s), phase.

    Rows of the state: samples since t = 0, sine and cosine (µm) of a phasor that is turned from
    sample to sample: a sine for each would cost more than all other stages together.
    """
    turn_sine, turn_cosine = np.sin(p[1] * ts), np.cos(p[1] * ts)
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = 0.0
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            if np.isnan(state[1, b]) or state[0, b] % _RENEWED == 0.0:
                phase = p[1, b] * (state[0, b] * ts) + p[2, b]
                state[1, b] = p[0, b] * math.sin(phase)
                state[2, b] = p[0, b] * math.cos(phase)
            sine, cosine = state[1, b], state[2, b]
            y[t, b] = x[t, b] + sine
            state[1, b] = sine * turn_cosine[b] + cosine * turn_sine[b]
            state[2, b] = cosine * turn_cosine[b] - sine * turn_sine[b]
            state[0, b] += 1.0


@dataclass(frozen=True)
class MainsHum(Clocked):
    """Sine of the mains' frequency added to the measured displacement.

    Examples
    --------
    >>> MainsHum(0.02, 50.0, 0.0).run([0.0] * 4, 5e-3).round(3).tolist()
    [0.0, 0.02, 0.0, -0.02]
    """

    amplitude_um: float = parameter(0.03, "µm", 0.0, 10.0, (0.01, 0.05), "amplitude h", neutral=0.0)
    frequency_hz: float = parameter(
        50.0, "Hz", 45.0, 65.0, (50.0, 50.0), "50 or 60 Hz, f", step=1e-6
    )
    phase_rad: float = parameter(
        0.0, "rad", -2 * math.pi, 2 * math.pi, (-math.pi, math.pi), "phase φ at t = 0"
    )

    name = "mains_hum"
    slot = "output"
    order = 70
    equation = "y = y_m + h sin(2π f t + φ)"
    source = "Pick-up of the mains in sensor and wiring; the amplitude is an estimate (1 to 50 nm)."
    signature = "A line at 50 or 60 Hz that has nothing to do with the command."
    experiment = "A quiet record at constant command; keep 50 and 60 Hz out of multisines."
    cause = (
        "Fields and ground loops of the mains, and vibration of transformers and fans, in the "
        "sensor, its cable or the stage."
    )
    hardware = (
        "Long unshielded cables, switched supplies, transformers and pumps on the same table."
    )
    magnitude = (
        "1 to 50 nm (estimate). Lines at the mains' frequency or a multiple nearly always come "
        "from some electrically driven vibration in the set-up (Physik Instrumente, blog, "
        "February 2012)."
    )
    remedy = (
        "Hardware: one ground, shielded cables, fans and pumps off the table; average over whole "
        "periods of the mains. Compensation: subtract the fitted line from a record. In tracking "
        "do not follow it if only the sensor sees it; a resonant controller at 50 or 60 Hz if the "
        "stage does move."
    )
    mistaken_for = ()
    picture = Picture(
        {"amplitude_um": 0.05},
        Look("over_time", "A quiet record", "quiet", 0.0, 0.1),
        Look("spectrum", "What a refit leaves of a slow triangle", "triangle-slow", 120.0),
    )
    block = staticmethod(mains_hum_block)
    state_rows = rows(3)  # the clock and the phasor

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Both mains frequencies, in two phases."""
        return tuple(
            cls.within_bounds(amplitude_um=1e-3 * scale.stroke_um, frequency_hz=f, phase_rad=phase)
            for f in (50.0, 60.0)
            for phase in (0.0, 0.5 * math.pi)
        )

    @classmethod
    def seen_in(cls, t_s: Array, left_um: Array) -> tuple[Self, ...]:
        """The strongest line near either mains frequency: no slope leads from one beat to the next."""
        t, left = t_s[:_SEEN], left_um[:_SEEN]
        step = 0.25 / max(float(t[-1] - t[0]), 1e-9)
        found = []
        for mains in (50.0, 60.0):
            count = min(max(1, math.ceil(_NEAR * mains / step)), _MOST_LINES)
            lines = mains + step * np.arange(-count, count + 1)
            waves = [complex(np.exp(-2j * np.pi * f * t) @ left) * 2.0 / t.size for f in lines]
            k = int(np.argmax(np.abs(waves)))
            phase = math.remainder(float(np.angle(waves[k])) + 0.5 * math.pi, 2.0 * math.pi)
            found.append(
                cls.within_bounds(
                    amplitude_um=abs(waves[k]), frequency_hz=float(lines[k]), phase_rad=phase
                )
            )
        return tuple(found)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Amplitude (µm), angular frequency (rad/s), phase (rad)."""
        return [self.amplitude_um, 2.0 * math.pi * self.frequency_hz, self.phase_rad]


@njit(cache=True)
def hum_harmonics_block(x: Array, u: Array, p: Array, state: Array, ts: float, y: Array) -> None:
    """Kernel; rows of ``p``: 2π f (rad/s), then sine and cosine (µm) of each harmonic.

    Rows of the state: samples since t = 0, sine and cosine of a phasor at f; the harmonics are its
    powers.
    """
    turn_sine, turn_cosine = np.sin(p[0] * ts), np.cos(p[0] * ts)
    for b in range(x.shape[1]):
        if np.isnan(state[0, b]):
            state[0, b] = 0.0
    for t in range(x.shape[0]):
        for b in range(x.shape[1]):
            if np.isnan(state[1, b]) or state[0, b] % _RENEWED == 0.0:
                phase = p[0, b] * (state[0, b] * ts)
                state[1, b], state[2, b] = math.sin(phase), math.cos(phase)
            s, c = state[1, b], state[2, b]
            sine, cosine, hum = s, c, 0.0
            for k in range(1, p.shape[0], 2):
                hum += p[k, b] * sine + p[k + 1, b] * cosine
                sine, cosine = sine * c + cosine * s, cosine * c - sine * s
            y[t, b] = x[t, b] + hum
            state[1, b] = s * turn_cosine[b] + c * turn_sine[b]
            state[2, b] = c * turn_cosine[b] - s * turn_sine[b]
            state[0, b] += 1.0


def _part(part: str, harmonic: str, symbol: str) -> Any:
    text = f"{part} part of the {harmonic} harmonic at t = 0, {symbol}"
    return parameter(0.0, "µm", -10.0, 10.0, (-0.02, 0.02), text, neutral=0.0)


@dataclass(frozen=True)
class HumWithHarmonics(Clocked, Extension, of=MainsHum):
    """Line of the mains with lines at twice and three times its frequency.

    Examples
    --------
    >>> HumWithHarmonics(0.02, 50.0, 0.0, third_sine_um=0.01).run([0.0] * 4, 5e-3).round(3).tolist()
    [0.0, 0.01, 0.0, -0.01]
    """

    amplitude_um: float = 0.03
    frequency_hz: float = 50.0
    phase_rad: float = 0.0
    second_sine_um: float = _part("sine", "second", "a2")
    second_cosine_um: float = _part("cosine", "second", "b2")
    third_sine_um: float = _part("sine", "third", "a3")
    third_cosine_um: float = _part("cosine", "third", "b3")

    form = "with harmonics"
    equation = "y = y_m + h sin(2π f t + φ) + Σ_k ak sin(2π k f t) + bk cos(2π k f t), k = 2, 3"
    cause = (
        "Rectifiers, dimmers and saturated transformers distort the mains; transformers and motors "
        "vibrate at twice its frequency."
    )
    signature = (
        "Lines at 50 or 60 Hz and at their multiples that have nothing to do with the command."
    )
    block = staticmethod(hum_harmonics_block)
    state_rows = rows(3)  # the clock and the phasor

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """The same line alone: harmonics act linearly."""
        return (cls.within_bounds(**simpler.values),)

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Angular frequency (rad/s), then sine and cosine (µm) of each harmonic."""
        return [
            2.0 * math.pi * self.frequency_hz,
            self.amplitude_um * math.cos(self.phase_rad),
            self.amplitude_um * math.sin(self.phase_rad),
            *list(self.values.values())[len(MainsHum.parameters) :],
        ]


@dataclass(frozen=True)
class HumToTheFifth(HumWithHarmonics, of=MainsHum):
    """Line of the mains with lines at twice to five times its frequency.

    Examples
    --------
    >>> hum = HumToTheFifth(0.0, 50.0, 0.0, fifth_sine_um=0.01)
    >>> hum.run([0.0] * 5, 1e-3).round(3).tolist()
    [0.0, 0.01, 0.0, -0.01, -0.0]
    """

    fourth_sine_um: float = _part("sine", "fourth", "a4")
    fourth_cosine_um: float = _part("cosine", "fourth", "b4")
    fifth_sine_um: float = _part("sine", "fifth", "a5")
    fifth_cosine_um: float = _part("cosine", "fifth", "b5")

    form = "with harmonics to the fifth"
    equation = "y = y_m + h sin(2π f t + φ) + Σ_k ak sin(2π k f t) + bk cos(2π k f t), k = 2 ... 5"
