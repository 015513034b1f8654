"""Commands of foreign records: six protocols, none of them the laboratory's own, on a fine grid."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.measurement.record import Role
from rdpi_gym.support.arrays import Array


@dataclass(frozen=True, eq=False)
class Drive:
    """Command of one record."""

    # of the record
    name: str
    role: Role
    ts_s: float  # sampling time (s)
    parts: int  # points of the fine grid in a sampling time; even
    # float64[(T - 1) parts + 1]: True command (V); the k-th sample is taken at point k times
    # `parts`
    fine_V: Array
    cut: int = 0  # samples at the beginning that are not recorded

    @property
    def step_s(self) -> float:
        """Step of the fine grid (s)."""
        return self.ts_s / self.parts

    @property
    def command_V(self) -> Array:
        """Command at every sample, those that are not recorded among them."""
        return self.fine_V[:: self.parts]

    @property
    def duration_s(self) -> float:
        """From the first to the last sample (s)."""
        return self.ts_s * (len(self.command_V) - 1)

    @property
    def is_held(self) -> bool:
        """Whether the command is level about every sample, and jumps between."""
        return bool(np.array_equal(self.fine_V[1 :: self.parts], self.command_V[:-1]))


def smooth(curve: Callable[[Array], Array], samples: int, ts_s: float, parts: int) -> Array:
    """Evaluate a command that is a function of time (s) on the fine grid."""
    return curve((ts_s / parts) * np.arange((samples - 1) * parts + 1, dtype=np.float64))


def between(values: Array, parts: int) -> Array:
    """Go from sample to sample in straight lines."""
    points = np.arange((len(values) - 1) * parts + 1)
    return np.interp(points / parts, np.arange(len(values)), values)


def held(u_V: Array, parts: int) -> Array:
    """Hold each sample of a command; a sample is taken in the middle of its hold."""
    points = np.arange((len(u_V) - 1) * parts + 1)
    return u_V[(points + parts // 2) // parts]


Draw = Callable[[np.random.Generator], "tuple[Drive, ...]"]
RANGES_V = ((0.0, 100.0), (-20.0, 120.0), (-10.0, 10.0), (0.0, 3.6), (0.0, 60.0), (-150.0, 150.0))
"""Lowest and highest command (V) of the amplifiers."""

_FEW, _MANY = 8, 16
_BUSY = 15_000  # samples of a record from which on its grid is coarser


@dataclass(frozen=True, eq=False)
class Experiment:
    """The experiment on one plant."""

    protocol: str  # one of :data:`PROTOCOLS`
    drives: tuple[Drive, ...]  # commands of its records (V), one after the other
    # middle and half width of the range that is used
    centre_V: float
    span_V: float
    has_validation: bool  # whether a record is for validation alone
    in_motion: bool  # whether the records begin in mid-motion

    @property
    def samples(self) -> int:
        """Recorded samples."""
        return sum(len(d.command_V) - d.cut for d in self.drives)

    @property
    def fastest_rate_V_s(self) -> float:
        """Rate of the command that one sample in a hundred exceeds, of its fastest record (V/s)."""
        fastest = 0.0
        for drive in self.drives:
            changes = np.abs(np.diff(drive.command_V))
            usual = float(np.quantile(changes, 0.99)) or float(changes.max())
            fastest = max(fastest, usual / drive.ts_s)
        return fastest


def _grid(samples: int) -> int:
    return _FEW if samples > _BUSY else _MANY


def _choose(rng: np.random.Generator, *values: float) -> float:
    return float(values[int(rng.integers(len(values)))])


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def _smooth(
    name: str, role: Role, curve: Callable[[Array], Array], samples: int, ts_s: float
) -> Drive:
    parts = _grid(samples)
    return Drive(name, role, ts_s, parts, smooth(curve, samples, ts_s, parts))


def _held(name: str, role: Role, u: Array, ts_s: float) -> Drive:
    parts = _grid(len(u))
    return Drive(name, role, ts_s, parts, held(u, parts))


def _steps(
    rng: np.random.Generator, name: str, role: Role, levels: Array, holds: NDArray[np.int64], ts_s: float,
    is_held: bool,
) -> Drive:  # fmt: skip
    """Levels with holds of so many samples: jumps, or ramps of eight samples without a corner."""
    if is_held:
        return _held(name, role, np.repeat(levels, holds), ts_s)
    ends = np.cumsum(holds)[:-1] * ts_s
    ramp = float(_choose(rng, 6, 12, 25)) * ts_s
    jumps = np.diff(levels)

    def curve(t: Array) -> Array:
        out = np.full_like(t, levels[0])
        for end, jump in zip(ends, jumps, strict=True):
            s = np.clip((t - end) / ramp, 0.0, 1.0)
            out += jump * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        return out

    return _smooth(name, role, curve, int(holds.sum()), ts_s)


def _random_levels(
    rng: np.random.Generator, samples: int, shortest: int, longest: int
) -> tuple[Array, NDArray[np.int64]]:
    holds: list[int] = []
    while sum(holds) < samples:
        holds.append(int(_log(rng, shortest, longest)))
    levels = rng.uniform(-1.0, 1.0, len(holds))
    levels[0] = 0.0
    levels[len(holds) // 3 : len(holds) // 3 + 2] = (1.0, -1.0)  # the whole range once
    return levels, np.array(holds)


def _chirp_and_staircase(rng: np.random.Generator) -> tuple[Drive, ...]:
    ts = 1.0 / _choose(rng, 1e3, 2e3, 5e3, 1e4, 2e4, 5e4)
    samples = int(rng.integers(6_000, 12_000))
    duration = samples * ts
    low, high = 3.0 / duration, rng.uniform(0.008, 0.03) / ts
    growth = math.log(high / low)
    level = rng.uniform(0.5, 1.0)

    def chirp(t: Array) -> Array:
        phase = 2.0 * math.pi * low * duration / growth * (np.exp(growth * t / duration) - 1.0)
        return level * np.sin(phase)

    slow_ts, is_held = 1.0 / _log(rng, 200.0, 2e3), bool(rng.random() < 0.15)
    steps = int(rng.integers(7, 15))
    levels = np.concatenate([np.linspace(0.0, 1.0, steps), np.linspace(1.0, -1.0, steps)])
    holds = np.full(2 * steps, int(rng.integers(2_500, 6_000)) // (2 * steps))
    other, other_holds = _random_levels(rng, int(rng.integers(2_500, 5_000)), 40, 400)
    return (
        _smooth("chirp", "train", chirp, samples, ts),
        _steps(rng, "staircase", "train", levels, holds, slow_ts, is_held),
        _steps(rng, "other-steps", "validation", other, other_holds, slow_ts, is_held),
    )


def _random_steps(rng: np.random.Generator) -> tuple[Drive, ...]:
    ts, is_held = 1.0 / _log(rng, 200.0, 1e4), bool(rng.random() < 0.6)
    samples = int(rng.integers(5_000, 14_000))
    shortest, longest = int(rng.integers(10, 40)), int(rng.integers(150, 900))
    train = _random_levels(rng, samples, shortest, longest)
    drives = [_steps(rng, "steps", "train", *train, ts, is_held)]
    if rng.random() < 0.6:
        other = _random_levels(rng, samples // 2, shortest, longest)
        drives.append(_steps(rng, "more-steps", "validation", *other, ts, is_held))
    return tuple(drives)


def slow_reference(rng: np.random.Generator, samples: int, fastest: float) -> Array:
    """Sum of twelve sines of random frequencies up to `fastest` cycles a sample; peak 1."""
    k = np.arange(samples)
    lines = np.exp(rng.uniform(math.log(4.0 / samples), math.log(fastest), 12))
    x = np.zeros(samples)
    for line in lines:
        x += rng.normal() * np.sin(2.0 * math.pi * line * k + rng.uniform(0.0, 2.0 * math.pi))
    x *= np.minimum(1.0, k / (0.02 * samples))
    return x / float(np.max(np.abs(x)))


def _closed_loop(rng: np.random.Generator) -> tuple[Drive, ...]:
    ts = 1.0 / _choose(rng, 20.0, 200.0, 1e3)
    samples = int(rng.integers(12_000, 24_000))
    x = slow_reference(rng, samples, rng.uniform(0.002, 0.01))
    if rng.random() < 0.5:
        return (_held("closed-loop", "train", x, ts),)
    cut = 2 * samples // 3
    other = slow_reference(rng, samples - cut, rng.uniform(0.002, 0.01))
    return (
        _held("closed-loop", "train", x[:cut] / float(np.max(np.abs(x[:cut]))), ts),
        _held("closed-loop-again", "validation", other, ts),
    )


def _triangle(frequency_hz: float, amplitude: float, decay_s: float) -> Callable[[Array], Array]:
    def curve(t: Array) -> Array:
        x = 2.0 / math.pi * np.arcsin(np.sin(2.0 * math.pi * frequency_hz * t))
        return np.asarray(amplitude * x * np.exp(-t / decay_s))

    return curve


def _two_triangles(rng: np.random.Generator) -> tuple[Drive, ...]:
    slow_ts = 1.0 / _log(rng, 200.0, 2e3)
    fast_ts = 1.0 / _choose(rng, 2e3, 5e3, 1e4, 2e4)
    slow, fast = int(rng.integers(5_000, 9_000)), int(rng.integers(4_000, 8_000))
    slow_s, fast_s = slow * slow_ts, fast * fast_ts
    decay = slow_s * _choose(rng, 0.5, 1.0, 1e9)
    drives = [
        _smooth("slow-triangle", "train", _triangle(rng.uniform(2.2, 5.0) / slow_s, 1.0, decay), slow, slow_ts),
        _smooth(
            "fast-triangle", "train",
            _triangle(rng.uniform(8.0, 30.0) / fast_s, rng.uniform(0.5, 1.0), 1e9 * fast_s), fast, fast_ts,
        ),
    ]  # fmt: skip
    if rng.random() < 0.7:
        other = _triangle(rng.uniform(5.0, 20.0) / fast_s, rng.uniform(0.4, 0.9), fast_s)
        drives.append(_smooth("other-triangle", "validation", other, fast // 2, fast_ts))
    return tuple(drives)


def _sum_of_sines(
    rng: np.random.Generator, low_hz: float, high_hz: float
) -> Callable[[Array], Array]:
    lines = int(rng.integers(3, 25))
    hz = np.exp(rng.uniform(math.log(low_hz), math.log(high_hz), lines))
    sizes, phases = (low_hz / hz) ** rng.uniform(0.0, 0.5), rng.uniform(0.0, 2.0 * math.pi, lines)

    def curve(t: Array) -> Array:
        x = np.zeros_like(t)
        for f, a, p in zip(hz, sizes, phases, strict=True):
            x += a * np.sin(2.0 * math.pi * f * t + p)
        return x

    return curve


def _multisines(rng: np.random.Generator) -> tuple[Drive, ...]:
    ts = 1.0 / _log(rng, 500.0, 5e4)
    samples = int(rng.integers(5_000, 9_000))
    low_hz, high_hz = 3.0 / (samples * ts), rng.uniform(0.008, 0.03) / ts
    small = rng.uniform(0.15, 0.5)

    def scaled(level: float) -> Callable[[Array], Array]:
        curve = _sum_of_sines(rng, low_hz, high_hz)
        peak = float(np.max(np.abs(curve(ts * np.arange(samples, dtype=np.float64)))))
        return lambda t: level * curve(t) / peak

    if rng.random() < 0.35:  # one file, the level changes on the way
        first, second = scaled(1.0), scaled(small)
        middle = 0.5 * samples * ts
        fade = 0.02 * samples * ts

        def both(t: Array) -> Array:
            s = 0.5 + 0.5 * np.tanh((t - middle) / fade)
            return np.asarray((1.0 - s) * first(t) + s * second(t))

        return (_smooth("multisine", "train", both, samples, ts),)
    drives = [
        _smooth("multisine", "train", scaled(1.0), samples, ts),
        _smooth("small-multisine", "train", scaled(small), samples // 2, ts),
    ]
    if rng.random() < 0.7:
        level = rng.uniform(0.6, 0.95)
        drives.append(_smooth("other-multisine", "validation", scaled(level), samples // 2, ts))
    return tuple(drives)


def _nested(rng: np.random.Generator, samples: int, ts_s: float) -> Callable[[Array], Array]:
    """A large loop with smaller ones inside, at random places."""
    turns = [0.0, 1.0, -1.0]
    for _ in range(int(rng.integers(3, 6))):
        top = turns[-1] + rng.uniform(0.7, 1.0) * (1.0 - turns[-1])
        inner = top - rng.uniform(0.1, 0.6) * (top - turns[-1])
        turns += [top, inner, top, rng.uniform(-1.0, inner)]
    lengths = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(turns)))])
    times = lengths / lengths[-1] * samples * ts_s
    return lambda t: np.interp(t, times, turns)


def _nested_and_chirp(rng: np.random.Generator) -> tuple[Drive, ...]:
    slow_ts, ts = 1.0 / _log(rng, 200.0, 2e3), 1.0 / _choose(rng, 2e3, 5e3, 1e4, 2e4)
    slow, samples = int(rng.integers(4_000, 8_000)), int(rng.integers(4_000, 8_000))
    level, duration = rng.uniform(0.2, 0.7), samples * ts
    low, high = 4.0 / duration, rng.uniform(0.01, 0.03) / ts

    def chirp(t: Array) -> Array:
        return np.asarray(
            level * np.sin(2.0 * math.pi * (low * t + 0.5 * (high - low) * t**2 / duration))
        )

    drives = [
        _smooth("nested-loops", "train", _nested(rng, slow, slow_ts), slow, slow_ts),
        _smooth("chirp", "train", chirp, samples, ts),
    ]
    if rng.random() < 0.7:
        other = _nested(rng, slow // 2, slow_ts)
        drives.append(_smooth("other-loops", "validation", other, slow // 2, slow_ts))
    return tuple(drives)


PROTOCOLS: Mapping[str, Draw] = {
    "chirp and staircase": _chirp_and_staircase,
    "random steps": _random_steps,
    "closed loop": _closed_loop,
    "two triangles": _two_triangles,
    "multisines": _multisines,
    "nested loops and a chirp": _nested_and_chirp,
}
"""Commands between -1 and 1 by the name of the protocol; of a closed loop, its reference."""


def draw_experiment(protocol: str, rng: np.random.Generator) -> Experiment:
    """Draw an experiment."""
    low, high = RANGES_V[int(rng.integers(len(RANGES_V)))]
    centre, span = 0.5 * (low + high), 0.5 * (high - low) * rng.uniform(0.8, 1.0)
    in_motion = protocol != "closed loop" and bool(rng.random() < 0.12)
    drives = tuple(
        replace(
            d,
            fine_V=centre + span * d.fine_V,
            cut=int(rng.uniform(0.03, 0.12) * len(d.command_V)) if in_motion else 0,
        )
        for d in PROTOCOLS[protocol](rng)
    )
    has_validation = any(d.role == "validation" for d in drives)
    return Experiment(protocol, drives, centre, span, has_validation, in_motion)
