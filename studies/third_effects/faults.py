"""Faults of clocks, converters and cables that neither other study draws."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.effect_discovery.cases import Sampled
from rdpi_gym.measurement.record import BoolArray
from rdpi_gym.support.arrays import Array

Fault = Callable[[Sequence[Sampled], np.random.Generator, float], list[Sampled]]
"""Records, a generator and the noise (µm rms) to the faulty records."""


def _changed(s: Sampled, y: Array, bad: BoolArray | None = None) -> Sampled:
    sound = s.is_sound if bad is None else s.is_sound & ~bad
    return replace(s, record=replace(s.record, y_um=y), is_sound=sound)


def _at(s: Sampled, places: NDArray[np.floating[Any]]) -> Sampled:
    """Take the displacement at other places, in samples."""
    k = np.arange(places.size, dtype=np.float64)
    y, clean, part = (
        np.interp(places, k, x) for x in (s.record.y_um, s.clean_um, s.by_input_um)
    )  # fmt: skip
    return replace(s, record=replace(s.record, y_um=y), clean_um=clean, by_input_um=part)


def _of_one(records: Sequence[Sampled], rng: np.random.Generator, change: Callable[[Sampled], Sampled]) -> list[Sampled]:  # fmt: skip
    chosen = int(rng.integers(len(records)))
    return [change(s) if k == chosen else s for k, s in enumerate(records)]


def _multiplexed(records: Sequence[Sampled], rng: np.random.Generator, noise: float) -> list[Sampled]:  # fmt: skip
    """Channels converted in turn: y a part of a sample after u."""
    share = rng.uniform(0.3, 0.8)
    return [_at(s, np.arange(s.clean_um.size) + share) for s in records]


def _other_clock(records: Sequence[Sampled], rng: np.random.Generator, noise: float) -> list[Sampled]:  # fmt: skip
    """The displacement of one record stamped by a clock that is 0.5 to 2 % slow."""
    rate = 1.0 - rng.uniform(0.005, 0.02)
    return _of_one(records, rng, lambda s: _at(s, rate * np.arange(s.clean_um.size)))


def _late_trigger(records: Sequence[Sampled], rng: np.random.Generator, noise: float) -> list[Sampled]:  # fmt: skip
    """The displacement of one record begins some samples late."""
    late = float(rng.integers(3, 25))
    return _of_one(records, rng, lambda s: _at(s, np.arange(s.clean_um.size) - late))


def _lost_buffer(records: Sequence[Sampled], rng: np.random.Generator, noise: float) -> list[Sampled]:  # fmt: skip
    """A block of displacements lost on the way: all later ones are early."""
    share = rng.uniform(0.3, 0.7)

    def lost(s: Sampled) -> Sampled:
        k = np.arange(s.clean_um.size, dtype=np.float64)
        return _at(s, k + np.where(k > share * k.size, max(8.0, 0.01 * k.size), 0.0))

    return _of_one(records, rng, lost)


def _drifting_clock(records: Sequence[Sampled], rng: np.random.Generator, noise: float) -> list[Sampled]:  # fmt: skip
    """Clocks of u and y that run apart as a crystal warms: quadratically."""
    end = rng.uniform(2.0, 8.0)
    return [_at(s, np.arange(s.clean_um.size) - end * np.linspace(0.0, 1.0, s.clean_um.size) ** 2) for s in records]  # fmt: skip


def _stuck_bit(records: Sequence[Sampled], rng: np.random.Generator, noise: float) -> list[Sampled]:  # fmt: skip
    """A bit of the converter that is always set, 6 to 20 noise floors of weight."""
    bit = noise * rng.uniform(6.0, 20.0)

    def stuck(s: Sampled) -> Sampled:
        is_low = np.floor(s.record.y_um / bit) % 2 == 0
        return _changed(s, s.record.y_um + bit * is_low, is_low)

    return [stuck(s) for s in records]


def _other_range(records: Sequence[Sampled], rng: np.random.Generator, noise: float) -> list[Sampled]:  # fmt: skip
    """One record taken on another range of the sensor, whose gain is 1 to 6 % off."""
    gain = 1.0 + rng.uniform(0.01, 0.06)
    return _of_one(records, rng, lambda s: _changed(s, gain * s.record.y_um))


def _coarse(records: Sequence[Sampled], rng: np.random.Generator, noise: float) -> list[Sampled]:
    """A converter of few bits: steps of 6 to 15 noise floors."""
    step = noise * rng.uniform(6.0, 15.0)
    return [_changed(s, step * np.round(s.record.y_um / step)) for s in records]


def _repeated(records: Sequence[Sampled], rng: np.random.Generator, noise: float) -> list[Sampled]:
    """A sensor that is read more often than it measures: every value two to four times."""
    times = int(rng.integers(2, 5))

    def repeated(s: Sampled) -> Sampled:
        k = np.arange(s.clean_um.size)
        return _changed(s, s.record.y_um[k // times * times], k % times != 0)

    return [repeated(s) for s in records]


def _loose_cable(records: Sequence[Sampled], rng: np.random.Generator, noise: float) -> list[Sampled]:  # fmt: skip
    """A cable that opens twice: the value decays to zero, and returns."""

    def loose(s: Sampled) -> Sampled:
        y, bad = s.record.y_um.copy(), np.zeros(s.clean_um.size, dtype=np.bool_)
        length = max(6, y.size // 60)
        for start in rng.integers(y.size // 10, y.size - length, 2):
            part = slice(int(start), int(start) + length)
            y[part] *= np.exp(-np.arange(length) / (0.2 * length))
            bad[part] = True
        return _changed(s, y, bad)

    return [loose(s) for s in records]


FAULTS: Mapping[str, Fault] = {
    "multiplexed channels": _multiplexed,
    "one record by another clock": _other_clock,
    "late trigger of one record": _late_trigger,
    "lost buffer": _lost_buffer,
    "clock that warms": _drifting_clock,
    "stuck bit": _stuck_bit,
    "one record on another range": _other_range,
    "coarse converter": _coarse,
    "repeated values": _repeated,
    "loose cable": _loose_cable,
}
"""Faults by name."""
EXCUSED: Mapping[str, tuple[str, ...]] = {
    "multiplexed channels": ("delay", "sensor_lag"), "late trigger of one record": ("delay",),
    "repeated values": ("delay", "sensor_lag"), "one record on another range": ("gain_drift",),
}  # fmt: skip
"""Names that describe what was done, and are neither right nor wrong."""
CLOCKS = ("multiplexed channels", "one record by another clock", "late trigger of one record",
          "lost buffer", "clock that warms")  # fmt: skip
"""Faults of a clock."""
