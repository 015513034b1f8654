"""Plants of the third study: hysteresis of Maxwell-slip elements or of another kind, and the bench."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.effect_discovery.forms import CORE, TIMED, Grid, Mechanism, Scale
from rdpi_gym.support.arrays import Array
from studies.third_effects.forms import creep, weight_gain, wider_V
from studies.third_effects.physics import (
    bristles,
    coleman_hodgdon,
    dahl,
    endochronic,
    enveloped,
    jiles_atherton,
    loop_commands,
    slip_sums,
)
from studies.third_effects.protocols import STROKES_UM, Drive, Experiment, held

PAUSE_S = 3.0
"""Between two records, on the clock of the experiment."""
_WALK = 400  # points from 0 V, where the plant was at rest, to the first command
_COMB, _SPREAD = 36, 1.6  # elements of the base model that visibility is judged about
_LOOKED_AT = 4_000  # samples of all records
_NOISE = (5e-5, 3e-3)  # of peak to peak, log-uniform
_NO_PAST = np.zeros(0)

Core = Callable[[Array], Array]
"""Displacement (µm) for a command on the fine grid, in spans from the centre of the range, from rest."""


@dataclass(frozen=True, eq=False)
class Elements:
    """Maxwell-slip elements beside a spring: the hysteresis of the base model."""

    gain_um_V: float  # while every element slips
    yields_V: Array
    weights: Array  # µm/V, those of the elements
    delta2_s: float
    stroke_um: float  # half of it
    noise_um: float
    noise: str  # one of NOISES


def _white(n: int, rng: np.random.Generator) -> Array:
    return rng.normal(size=n)


def _pink(n: int, rng: np.random.Generator) -> Array:
    """White noise and as much of power 1/f, as of a bridge amplifier."""
    lines = np.fft.rfft(rng.normal(size=n))
    lines /= np.sqrt(np.maximum(np.arange(lines.size), 1.0))
    pink = np.fft.irfft(lines, n)
    mixed = pink / np.std(pink) + rng.normal(size=n)
    return np.asarray(mixed / np.std(mixed))


def _tailed(n: int, rng: np.random.Generator) -> Array:
    return rng.standard_t(5, n) / math.sqrt(5.0 / 3.0)


def _converter(n: int, rng: np.random.Generator) -> Array:
    """Triangular: the rounding of a dithered converter."""
    return math.sqrt(6.0) * (rng.random(n) + rng.random(n) - 1.0)


NOISES: Mapping[str, Callable[[int, np.random.Generator], Array]] = {
    "white": _white, "1/f": _pink, "heavy tails": _tailed, "dithered converter": _converter,
}  # fmt: skip
"""Noise of unit rms by its name."""


def draw_elements(experiment: Experiment, rng: np.random.Generator, rated: bool | None) -> Elements:
    """Draw elements whose yields have a density of its own kind, to suit an experiment."""
    span, n = experiment.span_V, int(rng.integers(5, 61))
    reach, kind = span * rng.uniform(0.2, 1.1), rng.random()
    quantiles = (np.arange(n) + 0.5) / n
    if kind < 0.35:  # even: Rayleigh's law
        yields = reach * quantiles
    elif kind < 0.7:  # Weibull
        yields = 0.5 * reach * (-np.log1p(-quantiles)) ** (1.0 / rng.uniform(0.8, 3.0))
    else:  # soft and hard grains
        soft = rng.uniform(0.05, 0.25)
        yields = reach * np.where(quantiles < 0.5, soft * (0.5 + quantiles), 0.6 + 0.4 * quantiles)
    shape = np.exp(rng.normal(0.0, 0.2, n))
    low, high = STROKES_UM[int(rng.integers(len(STROKES_UM)))]
    stroke = 0.5 * math.exp(rng.uniform(math.log(low), math.log(high)))
    share, gain = rng.uniform(0.12, 0.45), stroke / span
    is_rated = rng.random() < 0.35 if rated is None else rated
    held_back = any(d.is_held for d in experiment.drives)
    growth = rng.uniform(0.02, 0.2) * reach / experiment.rate_V_s
    noise = 2.0 * stroke * math.exp(rng.uniform(*np.log(_NOISE)))
    return Elements(
        gain, np.sort(yields), gain * share * shape / shape.sum(),
        growth if is_rated and not held_back else 0.0, stroke, noise,
        str(rng.choice(list(NOISES))),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Bench:
    """A plant with what is hidden in it, and how it is driven."""

    plant: Elements
    experiment: Experiment
    hidden: tuple[Mechanism, ...] = ()  # in the chain's order
    core: Core | None = None  # of another kind, in the place of the elements

    def clocks_s(self) -> list[Array]:
        """Clock at the samples (s), by record."""
        starts = np.cumsum(
            [0.0, *(d.samples.size * d.ts_s + PAUSE_S for d in self.experiment.drives)]
        )
        return [
            start + d.ts_s * np.arange(d.samples.size)
            for start, d in zip(starts, self.experiment.drives, strict=False)
        ]  # fmt: skip

    def scale(self) -> Scale:
        """Size of the experiment on the plant."""
        e, drives = self.experiment, self.experiment.drives
        ends = [d.samples.size * d.ts_s for d in drives]
        return Scale(
            e.centre_V, e.span_V, self.plant.stroke_um, e.rate_V_s, min(d.ts_s for d in drives),
            max(d.ts_s for d in drives), max(ends), sum(ends) + PAUSE_S * (len(ends) - 1),
            any(d.is_held for d in drives), is_coarse=False,
        )  # fmt: skip

    def displacements(
        self, hidden: Sequence[Mechanism] | None = None, straight: bool = False
    ) -> list[Array]:
        """Displacement at the samples (µm) without noise, by record."""
        chosen = self.hidden if hidden is None else hidden
        return [
            self._displacement(d, t[0], chosen, straight)
            for d, t in zip(self.experiment.drives, self.clocks_s(), strict=True)
        ]

    def by_input(self) -> list[Array]:
        """Displacement without the effects that go by the clock (µm), by record."""
        return self.displacements([m for m in self.hidden if m.effect not in TIMED])

    def _displacement(
        self, d: Drive, start_s: float, hidden: Sequence[Mechanism], straight: bool
    ) -> Array:
        x, points = d.fine, np.arange(d.fine.size)
        if straight:
            x = np.interp(points, points[:: d.parts], d.samples)
        at = Grid(np.asarray(start_s + d.step_s * points, np.float64), d.step_s)
        for m in hidden:
            if m.form.place < CORE and m.form.apply is not None:
                x = m.form.apply(x, at, m.numbers)
        inside = {m.effect: m for m in hidden if m.form.place == CORE}
        if self.core is not None:
            walked = np.concatenate([np.linspace(0.0, x[0], _WALK), x])
            walked = (walked - self.experiment.centre_V) / self.experiment.span_V
            x = self.core(walked)[_WALK:]
        else:
            x = self._elements(x, d, at, inside)
        for m in hidden:
            if m.form.place > CORE and m.form.apply is not None:
                x = m.form.apply(x, at, m.numbers)
        return np.asarray(x[:: d.parts])

    def _elements(self, u: Array, d: Drive, at: Grid, inside: Mapping[str, Mechanism]) -> Array:
        p = self.plant
        speed = np.abs(np.diff(u[:: d.parts], prepend=u[0])) / d.ts_s
        speed = np.interp(np.arange(u.size), np.arange(speed.size) * d.parts, speed)
        law, past = inside.get("rate_law"), inside.get("initial_memory")
        wider = p.delta2_s * speed if law is None else wider_V(law.numbers, speed, at.step_s)
        turns = _NO_PAST if past is None else u[0] + np.array(past.numbers["turns_V"])
        plays = slip_sums(u, wider, p.yields_V, p.weights[:, None], turns)[:, 0]
        if "creep" in inside:
            plays = creep(plays, at, inside["creep"].numbers)
        if "congruency" in inside:
            plays = plays * weight_gain(inside["congruency"].numbers, u)
        return np.asarray((p.gain_um_V - p.weights.sum()) * u + plays)


def close_loops(bench: Bench, noise_um: Sequence[Array], rng: np.random.Generator) -> Bench:
    """Let a PI controller make the commands of references, the sensor's noise among them."""
    p, e, drives = bench.plant, bench.experiment, []
    integral, proportional = rng.uniform(0.03, 0.15), rng.uniform(0.0, 0.3)
    for d, noise in zip(e.drives, noise_um, strict=True):
        if d.is_loop:
            u = loop_commands(
                p.gain_um_V * d.samples, noise, p.gain_um_V, p.yields_V, p.weights, integral,
                proportional, e.centre_V - e.span_V, e.centre_V + e.span_V,
            )  # fmt: skip
            drives.append(replace(d, fine=held(np.asarray(u), d.parts)))
        else:
            drives.append(d)
    return replace(bench, experiment=replace(e, drives=tuple(drives)))


class BaseModel:
    """Flexibility of a refit of the base model: gain, a comb of elements, their growth, offsets.

    A linear fit whose weights may be negative takes up more than a fit with bounds.
    """

    def __init__(self, bench: Bench) -> None:
        e = bench.experiment
        self._every = max(1, sum(d.samples.size for d in e.drives) // _LOOKED_AT)
        yields = 1.3 * e.span_V * (np.arange(1, _COMB + 1) / _COMB) ** _SPREAD
        parts = []
        for d in e.drives:
            u = d.samples
            speed = np.abs(np.diff(u, prepend=u[0])) / d.ts_s
            widths = (p * e.span_V / e.rate_V_s * speed for p in (0.0, 0.03))
            still, wide = (slip_sums(u, w, yields, np.eye(_COMB), _NO_PAST) for w in widths)
            parts.append(self._centred(np.column_stack([u, still, wide - still])))
        self._bounds = np.cumsum([len(part) for part in parts])[:-1]
        columns = np.concatenate(parts)
        size = np.linalg.norm(columns, axis=0)
        q, s, _ = np.linalg.svd(columns / np.where(size > 0.0, size, 1.0), full_matrices=False)
        self._basis = q[:, s > 1e-7 * s[0]]

    def _centred(self, x: Array) -> Array:
        part = x[:: self._every]
        return np.asarray(part - part.mean(axis=0))

    def left(self, signal: Sequence[Array], others: Sequence[Sequence[Array]] = ()) -> Array:
        """Signal that a refit leaves, with `others` as further columns, over the looked-at samples."""
        y = np.concatenate([self._centred(x) for x in signal])
        y = y - self._basis @ (self._basis.T @ y)
        if others:
            more = np.column_stack([self.left(other) for other in others])
            y = y - more @ np.linalg.lstsq(more, y, rcond=1e-9)[0]
        return np.asarray(y)

    def left_um(self, signal: Sequence[Array], others: Sequence[Sequence[Array]] = ()) -> float:
        """Largest rms of a record that a refit leaves (µm)."""
        parts = np.split(self.left(signal, others), self._bounds)
        return max(float(np.sqrt(np.mean(part**2))) for part in parts)


# --- hysteresis of another kind ---


def _slips(z: Array, limits: Array, sizes: Array) -> Array:
    """Sum of slips from rest at the first command, at any rate, ``(T,)``."""
    found: Array = slip_sums(z - z[0], np.zeros_like(z), limits, sizes[:, None], _NO_PAST)[:, 0]
    return found


def _preisach(centres: Sequence[float], spread: float, width: float, stroke: float) -> Core:
    """Relays of log-normal coercive and normal interaction fields, as of measured reversal curves."""
    from scipy.special import ndtr

    deviations = np.linspace(-2.2, 2.2, 40)
    half, density = width * np.exp(0.6 * deviations), np.exp(-0.5 * deviations**2)
    density /= density.sum()

    def respond(z: Array) -> Array:
        total = np.zeros_like(z)
        for h, share in zip(half, density, strict=True):
            front = z[0] + _slips(z, np.array([h]), np.ones(1))
            for centre in centres:
                total += share / len(centres) * ndtr((front - centre) / spread)
        return np.asarray(stroke * (2.0 * total + 0.15 * z))

    return respond


def draw_core(kind: str, stroke: float, ts_points: float, rng: np.random.Generator) -> Core:
    """Draw a core of a kind; `ts_points`: usual change of the command from point to point, in spans."""
    width, depth = rng.uniform(0.1, 0.35), rng.uniform(0.15, 0.4)
    power, share = rng.uniform(1.0, 2.0), rng.uniform(0.55, 0.9)
    skew = rng.uniform(0.15, 0.4) * (1.0 if rng.random() < 0.5 else -1.0)
    cores: dict[str, Core] = {
        "bouc_wen": lambda z: stroke * (z - depth * endochronic(z, width, power, share, 0.0, 0.0)),
        "asymmetric_bouc_wen": lambda z: (
            stroke * (z - depth * endochronic(z, width, power, share, skew, 0.0))
        ),
        "duhem": lambda z: stroke * coleman_hodgdon(z, 1.0 / width, 1.0, 1.0 - 1.5 * depth, 0.4),
        "dahl": lambda z: stroke * dahl(z, 0.5 * width, power),
        "lugre": lambda z: (
            stroke * bristles(np.diff(z, prepend=z[0]), 8.0, 0.5, 1.0, 1.0 + 2.0 * depth, ts_points)
        ),
        "pinched": lambda z: stroke * (z - depth * endochronic(z, width, power, share, 0.0, 0.85)),
        "jiles_atherton": lambda z: stroke * jiles_atherton(z, 0.6 * width, 0.6 * width, 0.2),
    }
    if kind in cores:
        return cores[kind]
    limits = rng.uniform(0.05, 1.0, 12)
    sizes = rng.dirichlet(np.ones(12))
    if kind == "stop":
        return lambda z: stroke * (1.1 * z - _slips(z, limits, sizes))
    if kind == "generalised_pi":
        rise, fall = rng.uniform(0.8, 1.6, 2)
        return lambda z: stroke * (
            0.3 * z + enveloped(np.tanh(fall * z) / fall, np.tanh(rise * z) / rise, 0.6 * limits, sizes)
        )  # fmt: skip
    two = (-rng.uniform(0.3, 0.5), rng.uniform(0.3, 0.5)) if kind == "pinched_preisach" else (0.1,)
    return _preisach(two, rng.uniform(0.2, 0.5), 0.8 * width, stroke)


KINDS: Mapping[str, tuple[str, ...]] = {
    "bouc_wen": ("bouc_wen",), "asymmetric_bouc_wen": ("asymmetric_bouc_wen",),
    "duhem": ("duhem",), "dahl": ("dahl",), "lugre": ("lugre",), "stop": ("stop",),
    "generalised_pi": ("generalised_pi",), "preisach": ("preisach",),
    "pinched_preisach": ("preisach",), "pinched": (), "jiles_atherton": (),
}  # fmt: skip
"""Kinds of core, with the catalogue's names that are right; none where it is something else."""

# --- outside the catalogue ---

Displaced = tuple[list[Array], list[Array], dict[str, Any]]
"""Displacement (µm), the part that follows from the input, numbers."""
Outside = Callable[[Bench, np.random.Generator, float], Displaced]


def _added(bench: Bench, extra: Callable[[Array], Array], numbers: dict[str, Any]) -> Displaced:
    """Add a function of the clock."""
    still = bench.displacements()
    return [y + extra(t) for y, t in zip(still, bench.clocks_s(), strict=True)], still, numbers


def _periodic(bench: Bench, rng: np.random.Generator, size: float) -> Displaced:
    """Nonlinearity of an interferometer: two lines over the displacement, periods λ/2 and λ/4."""
    period = min(0.3164, 0.5 * bench.plant.stroke_um)
    phases = rng.uniform(0.0, 6.28, 2)
    y = [
        x + size * (np.sin(6.2832 * x / period + phases[0]) + 0.4 * np.sin(12.566 * x / period + phases[1]))
        for x in bench.displacements()
    ]  # fmt: skip
    return y, y, {"period_um": period, "amplitude_um": size}


def _self_heating(bench: Bench, rng: np.random.Generator, size: float) -> Displaced:
    tau = bench.scale().longest_s * rng.uniform(0.1, 0.5)
    found = [
        _leaky((np.gradient(d.samples) / d.ts_s) ** 2, math.exp(-d.ts_s / tau))
        for d in bench.experiment.drives
    ]
    top = max(float(np.max(heat)) for heat in found)
    still = bench.displacements()
    y = [x + 2.0 * size * heat / top for x, heat in zip(still, found, strict=True)]
    return y, y, {"time_constant_s": tau, "peak_um": 2.0 * size}


def _leaky(x: Array, decay: float) -> Array:
    from scipy.signal import lfilter

    return np.asarray(lfilter([1.0 - decay], [1.0, -decay], x))


def _oscillating(bench: Bench, rng: np.random.Generator, size: float) -> Displaced:
    """A driver that oscillates, its frequency far from the mains."""
    hz = 0.3 / bench.scale().slowest_ts_s * rng.uniform(0.3, 1.0)
    return _added(bench, lambda t: size * np.sin(6.2832 * hz * t), {"frequency_hz": hz})


def _footsteps(bench: Bench, rng: np.random.Generator, size: float) -> Displaced:
    s = bench.scale()
    hz, starts = 0.05 / s.slowest_ts_s, rng.uniform(0.0, s.total_s, 60)

    def bursts(t: Array) -> Array:
        y = np.zeros_like(t)
        for start in starts:
            since = np.maximum(t - start, 0.0)
            y += 4.0 * size * np.exp(-hz * since) * np.sin(6.2832 * hz * since)
        return y

    return _added(bench, bursts, {"frequency_hz": hz})


def _other_axis(bench: Bench, rng: np.random.Generator, size: float) -> Displaced:
    hz = rng.uniform(3.0, 20.0) / bench.scale().longest_s
    return _added(
        bench, lambda t: 2.0 * size * np.arcsin(np.sin(6.2832 * hz * t)) / 1.571, {"frequency_hz": hz}
    )  # fmt: skip


def _slipping_clamp(bench: Bench, rng: np.random.Generator, size: float) -> Displaced:
    slips = np.sort(rng.uniform(0.0, bench.scale().total_s, 5))
    steps = np.concatenate([[0.0], np.cumsum(rng.normal(size=5))]) * 2.0 * size
    return _added(bench, lambda t: steps[np.searchsorted(slips, t)], {"slips_s": slips.tolist()})


def _telegraph(bench: Bench, rng: np.random.Generator, size: float) -> Displaced:
    """Popcorn noise of an amplifier: two levels, random times."""
    flips = np.sort(rng.uniform(0.0, bench.scale().total_s, 150))

    def levels(t: Array) -> Array:
        return np.where(np.searchsorted(flips, t) % 2 == 1, size, -size)

    return _added(bench, levels, {"flips": flips.size})


def _guide_friction(bench: Bench, rng: np.random.Generator, size: float) -> Displaced:
    y, still = [], bench.displacements()
    for x in still:
        v = np.diff(x, prepend=x[0])
        usual = float(np.median(np.abs(v))) + 1e-12
        y.append(x - 2.0 * size * bristles(v, 1.0 / (4.0 * size), 0.0, 0.6, 1.0, usual))
    return y, y, {"force_um": 2.0 * size}


def _leaking_sensor(bench: Bench, rng: np.random.Generator, size: float) -> Displaced:
    """A sensor that forgets, as a charge amplifier does."""
    tau = bench.scale().longest_s * rng.uniform(0.5, 3.0)
    y = [
        x - _leaky(x - x[0], math.exp(-d.ts_s / tau))
        for x, d in zip(bench.displacements(), bench.experiment.drives, strict=True)
    ]
    return y, y, {"time_constant_s": tau}


def _square_drag(bench: Bench, rng: np.random.Generator, size: float) -> Displaced:
    y, still = [], bench.displacements()
    top = max(float(np.max(np.abs(np.gradient(x)))) / d.ts_s for x, d in zip(still, bench.experiment.drives, strict=True))  # fmt: skip
    for x, d in zip(still, bench.experiment.drives, strict=True):
        v = np.gradient(x) / d.ts_s / top
        y.append(x - 6.0 * size * v * np.abs(v))
    return y, y, {"peak_um": 6.0 * size}


OUTSIDE: Mapping[str, Outside] = {
    "periodic error": _periodic,
    "self-heating": _self_heating,
    "oscillating driver": _oscillating,
    "footsteps": _footsteps,
    "another axis": _other_axis,
    "slipping clamp": _slipping_clamp,
    "telegraph noise": _telegraph,
    "guide friction": _guide_friction,
    "leaking sensor": _leaking_sensor,
    "square drag": _square_drag,
}
"""Phenomena outside the catalogue, by name; drawn for a size in µm."""
