"""Commands of the third study: what scanners, ageing rigs and network analysers play."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from rdpi_gym.measurement.record import Role
from rdpi_gym.support.arrays import Array

RANGES_V = (
    (-500.0, 1500.0), (-30.0, 150.0), (0.0, 200.0), (-250.0, 1000.0), (0.0, 24.0), (-1.2, 1.2),
)  # fmt: skip
"""Command ranges: macro-fibre composite, multilayer stack, bender, high-voltage stack, drop-on-demand,
voice coil of a current source (A)."""
STROKES_UM = ((0.15, 0.9), (1.5, 15.0), (120.0, 800.0))
"""Strokes, peak to peak: a shear chip, a stack, an amplified actuator."""
_SHORT, _LONG = (1_500, 4_000), (45_000, 70_000)
_PARTS, _FEWER, _BUSY = 8, 4, 20_000


@dataclass(frozen=True, eq=False)
class Drive:
    """Command of one record on a fine grid."""

    name: str
    role: Role
    ts_s: float
    parts: int
    fine: Array  # ``[(T - 1) parts + 1]``; the k-th sample is point k parts
    is_held: bool = False  # by a converter; a sample is taken in the middle of its hold
    is_loop: bool = False  # a reference, of which a controller makes the command

    @property
    def samples(self) -> Array:
        """Command at the samples."""
        return self.fine[:: self.parts]

    @property
    def step_s(self) -> float:
        """Step of the fine grid (s)."""
        return self.ts_s / self.parts


Curve = Callable[[Array], Array]
Draw = Callable[[np.random.Generator, int], "Curve | Array"]
"""A number of samples to a curve over 0 to 1, or to values that are held; between -1 and 1."""


def held(values: Array, parts: int) -> Array:
    """Values that a converter holds, on the fine grid."""
    points = np.arange((values.size - 1) * parts + 1)
    return values[(points + parts // 2) // parts]


def _polygon(turns: Array, lengths: Array) -> Curve:
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    return lambda x: np.interp(x, ends / ends[-1], turns)


def _raster(rng: np.random.Generator, n: int) -> Curve | Array:
    """Fast axis of a raster scan: slow forward, quick flyback, zoomed and moved once or twice."""
    lines, duty = int(rng.integers(8, 30)), rng.uniform(0.6, 0.95)
    frames = int(rng.integers(1, 4))
    turns, lengths = [0.0], []
    for _ in range(frames):
        size = rng.uniform(0.15, 1.0)
        middle = rng.uniform(-1.0, 1.0) * (1.0 - size)
        turns.append(middle - size)
        lengths.append(duty)
        for _ in range(lines):
            turns += [middle + size, middle - size]
            lengths += [duty, 1.0 - duty]
    return _polygon(np.array(turns), np.array(lengths))


def _reversal_curves(rng: np.random.Generator, n: int) -> Curve | Array:
    """First-order reversal curves: from saturation down to each level, and back."""
    levels = np.linspace(0.85, -1.0, int(rng.integers(6, 16)))
    turns = np.concatenate([[0.0], *[[1.0, level] for level in levels], [1.0]])
    return _polygon(turns, np.abs(np.diff(turns)))


def _growing_holds(rng: np.random.Generator, n: int) -> Curve | Array:
    """Moves up, back and down, held for times that grow by decades."""
    count = int(rng.integers(6, 14))
    holds = np.maximum((10.0 ** rng.uniform(0.0, 2.2, count) * 5).astype(int), 4)
    levels = rng.choice([-1.0, -0.5, 0.0, 0.4, 1.0], count) * rng.uniform(0.5, 1.0)
    ends = np.cumsum(holds) / holds.sum()
    width = 8.0 / n

    def curve(x: Array) -> Array:
        y = np.zeros_like(x)
        before = 0.0
        for end, level in zip(np.concatenate([[0.02], ends[:-1]]), levels, strict=True):
            s = np.clip((x - end) / width, 0.0, 1.0)
            y += (level - before) * s * s * (3.0 - 2.0 * s)
            before = level
        return y

    return curve


def _binary(rng: np.random.Generator, n: int) -> Curve | Array:
    """Pseudo-random binary sequence of one or two amplitudes on a bias that changes."""
    shortest = int(rng.integers(8, 40))
    bits = rng.choice([-1.0, 1.0], n // shortest + 1)
    bias = np.repeat(rng.uniform(-0.5, 0.5, 4), bits.size // 4 + 1)[: bits.size]
    size = np.where(np.arange(bits.size) < bits.size // 2, 0.5, rng.uniform(0.1, 0.4))
    return np.repeat(bias + size * bits, shortest)[:n]


def _stepped_sines(rng: np.random.Generator, n: int) -> Curve | Array:
    """Bursts of sines, the frequency stepped, each at two amplitudes."""
    count = int(rng.integers(3, 7))
    cycles = np.exp(np.linspace(math.log(2.0), math.log(rng.uniform(12.0, 40.0)), count))
    cycles = np.repeat(np.round(cycles * 30.0 / cycles.sum() + 1.0), 2)
    small = rng.uniform(0.15, 0.5)

    def curve(x: Array) -> Array:
        part = np.minimum((x * cycles.size).astype(int), cycles.size - 1)
        phase = 2.0 * math.pi * cycles[part] * (x * cycles.size - part)
        return np.asarray(np.where(part % 2 == 0, 1.0, small) * np.sin(phase))

    return curve


def _biased_ripple(rng: np.random.Generator, n: int) -> Curve | Array:
    """Small ripple of three lines on a bias that goes up and down slowly."""
    lines, size = rng.integers(25, 120, 3), rng.uniform(0.03, 0.15)
    phases = rng.uniform(0.0, 2.0 * math.pi, 3)

    def curve(x: Array) -> Array:
        ripple = np.sum(
            [np.sin(2 * math.pi * c * x + p) for c, p in zip(lines, phases, strict=True)], 0
        )
        return np.asarray((1.0 - size) * np.sin(2.0 * math.pi * 1.25 * x) + size / 3.0 * ripple)

    return curve


def _spiral(rng: np.random.Generator, n: int) -> Curve | Array:
    """One axis of a spiral scan out and back; the angle runs evenly or with the square root."""
    turns, even = rng.uniform(8.0, 30.0), rng.random() < 0.5

    def curve(x: Array) -> Array:
        r = 1.0 - np.abs(2.0 * x - 1.0)
        angle = x if even else np.sqrt(x)
        return np.asarray(r * np.sin(2.0 * math.pi * turns * angle))

    return curve


def _coloured(rng: np.random.Generator, n: int) -> Curve | Array:
    """Dense random lines whose power falls with the frequency, faded in."""
    lines = np.arange(2, int(rng.integers(60, 160)))
    sizes = lines ** -rng.uniform(0.3, 1.0) * rng.normal(size=lines.size)
    phases = rng.uniform(0.0, 2.0 * math.pi, lines.size)

    def curve(x: Array) -> Array:
        y = np.zeros_like(x)
        for line, size, phase in zip(lines, sizes, phases, strict=True):
            y += size * np.sin(2.0 * math.pi * line * x + phase)
        y *= np.clip(x / 0.03, 0.0, 1.0)
        return np.asarray(y / np.max(np.abs(y)))

    return curve


def _trapezoids(rng: np.random.Generator, n: int) -> Curve | Array:
    """Reference of trapezoids that a controller follows; its command is what is recorded."""
    times, values = [0.0, 0.1], [0.0, 0.0]
    for level in rng.uniform(-0.8, 0.8, int(rng.integers(5, 12))):
        ramp, rest = 0.05 + 0.3 * abs(level - values[-1]), rng.uniform(0.1, 0.6)
        times += [times[-1] + ramp, times[-1] + ramp + rest]
        values += [level, level]
    return np.interp(np.arange(n) / (n - 1), np.array(times) / times[-1], values)


PROTOCOLS: Mapping[str, Draw] = {
    "raster scan": _raster,
    "reversal curves": _reversal_curves,
    "growing holds": _growing_holds,
    "binary sequence": _binary,
    "stepped sines": _stepped_sines,
    "ripple on a bias": _biased_ripple,
    "spiral": _spiral,
    "coloured noise": _coloured,
    "controlled trapezoids": _trapezoids,
}
"""Commands by the name of the protocol."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """Drives of one plant, in V, one after the other."""

    protocol: str
    drives: tuple[Drive, ...]
    centre_V: float
    span_V: float

    @property
    def rate_V_s(self) -> float:
        """Rate that one sample in a hundred exceeds, of the fastest record (V/s)."""
        rates = []
        for d in self.drives:
            steps = np.abs(np.diff(d.samples))
            rates.append(float(np.quantile(steps, 0.99) or steps.max()) / d.ts_s)
        return max(rates)


def _drive(
    protocol: str, name: str, role: Role, n: int, ts: float, rng: np.random.Generator
) -> Drive:
    made = PROTOCOLS[protocol](rng, n)
    parts = _FEWER if n > _BUSY else _PARTS
    if isinstance(made, np.ndarray):
        is_loop = protocol == "controlled trapezoids"
        return Drive(name, role, ts, parts, held(made, parts), True, is_loop)
    points = (n - 1) * parts + 1
    return Drive(name, role, ts, parts, np.asarray(made(np.arange(points) / (points - 1))))


def draw_experiment(rng: np.random.Generator) -> Experiment:
    """Draw range, protocols, lengths and rates; validation by another protocol, by the same, or without."""
    low, high = RANGES_V[int(rng.integers(len(RANGES_V)))]
    centre, span = 0.5 * (low + high), 0.5 * (high - low) * rng.uniform(0.35, 1.0)
    names = list(PROTOCOLS)
    protocol = names[int(rng.integers(len(names)))]
    size = rng.random()
    low_n, high_n = _SHORT if size < 0.3 else _LONG if size > 0.95 else (4_000, 16_000)
    kind = rng.random()
    decades = (0.0, 1.2) if kind < 0.12 else (4.8, 5.3) if kind > 0.92 else (2.0, 4.3)
    rate = 10.0 ** rng.uniform(*decades)
    drives = [_drive(protocol, "run-1", "train", int(rng.integers(low_n, high_n)), 1.0 / rate, rng)]
    if rng.random() < 0.6:  # a second one of another kind, slower or faster
        other = names[int(rng.integers(len(names)))]
        near = rate * 10.0 ** rng.uniform(-1.0, 0.3)
        n = int(rng.integers(1_000, max(1_500, low_n)))
        drives.append(_drive(other, "run-2", "train", n, 1.0 / near, rng))
    last = rng.random()
    if last < 0.65:
        name = names[int(rng.integers(len(names)))] if last < 0.35 else protocol
        n = int(rng.integers(1_000, max(1_500, low_n)))
        drives.append(_drive(name, "check", "validation", n, 1.0 / rate, rng))
    scaled = [replace(d, fine=centre + span * d.fine) for d in drives]
    return Experiment(protocol, tuple(scaled), centre, span)
