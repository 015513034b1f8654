"""The references of the suite: sines, scans, steps and broad bands."""

from __future__ import annotations

from benchmarks.tracking.case import Case, References
from rdpi_gym.signals import (
    BandLimitedNoise,
    Multisine,
    NestedLoops,
    Raster,
    Signal,
    Sine,
    Steps,
    Triangle,
)

SINE_HZ = (1.0, 10.0, 25.0, 50.0, 80.0, 100.0, 200.0)


def _sines(amplitude_um: float, base_hz: float) -> tuple[Case, ...]:
    """Make sines whose frequencies do not depend on the plant."""
    return tuple(
        Case.smooth(
            Sine(amplitude_um=amplitude_um, frequency_hz=hz),
            hz,
            start_s=1.0 / hz,
            periods=min(8, max(1, round(0.2 * hz))),
        )
        for hz in SINE_HZ
    )


def _one(signal: Signal, hz: float, base_hz: float, periods: int = 1) -> tuple[Case, ...]:
    return (Case.smooth(signal, hz, start_s=1.0 / base_hz, periods=periods),)


def _triangle(amplitude_um: float, base_hz: float) -> tuple[Case, ...]:
    return _one(Triangle(amplitude_um=amplitude_um, frequency_hz=base_hz), base_hz, base_hz, 2)


def _raster(amplitude_um: float, base_hz: float) -> tuple[Case, ...]:
    return _one(Raster(amplitude_um=amplitude_um, frequency_hz=base_hz), base_hz, base_hz, 2)


def _steps(amplitude_um: float, base_hz: float) -> tuple[Case, ...]:
    holds = 4.0 * base_hz
    return _one(Steps(amplitude_um=amplitude_um, hold_s=1.0 / holds), holds, base_hz)


def _multisine(amplitude_um: float, base_hz: float) -> tuple[Case, ...]:
    signal = Multisine(amplitude_um=amplitude_um, frequency_hz=0.5 * base_hz, lines=10)
    return _one(signal, 5.0 * base_hz, base_hz)


def _nested_loops(amplitude_um: float, base_hz: float) -> tuple[Case, ...]:
    return _one(NestedLoops(amplitude_um=amplitude_um, frequency_hz=base_hz), base_hz, base_hz)


def _noise(amplitude_um: float, base_hz: float) -> tuple[Case, ...]:
    highest = 5.0 * base_hz
    signal = BandLimitedNoise(amplitude_um=amplitude_um, high_hz=highest, repeat_s=3.0 / base_hz)
    return _one(signal, highest, base_hz)


REFERENCES: References = {
    "sine": _sines,
    "triangle": _triangle,
    "raster": _raster,
    "steps": _steps,
    "multisine": _multisine,
    "nested-loops": _nested_loops,
    "noise": _noise,
}
