"""Foreign plants: their hysteresis, what is hidden in them, and the phenomena outside the catalogue."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.effect_discovery.forms import (
    CORE,
    TIMED,
    Grid,
    Mechanism,
    envelopes,
    weight_gain,
    wider_V,
)
from benchmarks.effect_discovery.outsiders import BoucWen
from benchmarks.effect_discovery.physics import (
    duhem,
    integrated,
    plays_by_substeps,
    plays_by_turning_points,
    stuck_and_slipped,
)
from benchmarks.effect_discovery.protocols import Drive, Experiment, between, held
from rdpi_gym.plant import RDPI, PlantModel
from rdpi_gym.support.arrays import Array

_DENSE = 120  # plays that stand for a continuous density
_FEWER = 20  # plays of the model about which visibility is judged
_RATED_SHARE = 0.45
_FIRST_NOISE = (1.0e-4, 2.5e-4)  # of peak to peak: the first study's
_TIMES = 10.0


@dataclass(frozen=True, eq=False)
class Foreign:
    """A plant without what is hidden in it."""

    a0_um_V: float  # gain without plays (µm/V)
    # float64[n]: Of the plays (V, µm/V)
    thresholds_V: Array
    weights: Array
    delta2_s: float  # growth of the thresholds with the rate (s)
    # range that is used
    centre_V: float
    span_V: float
    stroke_um: float  # half of the displacement over that range
    noise_um: float  # of the sensor (rms)
    colour: float  # correlation of the noise from sample to sample

    @property
    def gain_um_V(self) -> float:
        """Gain while every play slides."""
        return self.a0_um_V + float(self.weights.sum())

    def model(self) -> PlantModel:
        """Return a plant of the package that is like it, a density in few plays."""
        thresholds, weights = self.thresholds_V, self.weights
        if thresholds.size == _DENSE:
            groups = np.array_split(np.arange(_DENSE), _FEWER)
            thresholds = np.array([thresholds[g].mean() for g in groups])
            weights = np.array([weights[g].sum() for g in groups])
        hysteresis = RDPI(
            (self.a0_um_V, *weights.tolist()), tuple(thresholds.tolist()), self.delta2_s
        )
        return PlantModel(
            hysteresis, "foreign", (self.centre_V - self.span_V, self.centre_V + self.span_V),
            (self.gain_um_V * self.centre_V, self.stroke_um),
        )  # fmt: skip


def draw_plant(
    experiment: Experiment, rng: np.random.Generator, rated: bool | None = None
) -> Foreign:
    """Draw a plant to suit an experiment."""
    span, kind = experiment.span_V, rng.random()
    reach = span * rng.uniform(0.3, 0.9)
    n = _DENSE if kind < 0.25 else int(rng.integers(6, 26))
    if kind < 0.25:
        thresholds = reach * (np.arange(n) + 0.5) / n
        shape = np.exp(-thresholds / (reach * rng.uniform(0.2, 1.0)))
    else:
        thresholds = np.sort(reach * rng.uniform(0.01, 1.0, n) ** rng.uniform(1.0, 2.0))
        thresholds = np.maximum.accumulate(thresholds + 1e-3 * reach * np.arange(1, n + 1) / n)
        shape = rng.uniform(0.75, 1.0) ** np.arange(n) * np.exp(rng.normal(0.0, 0.3, n))
    share = rng.uniform(0.25, 0.9)
    stroke = 0.5 * float(np.exp(rng.uniform(np.log(1.0), np.log(100.0))))
    a0 = stroke / span / (1.0 + 0.6 * share)
    weights = a0 * share * shape / shape.sum()
    is_rated = bool(rng.random() < _RATED_SHARE)
    growth = rng.uniform(0.02, 0.25) * reach / max(experiment.fastest_rate_V_s, 1e-9)
    noise = 2.0 * stroke * rng.uniform(*_FIRST_NOISE) * _TIMES ** rng.uniform()
    colour = float(rng.uniform(0.1, 0.5)) if rng.random() < 0.3 else 0.0
    return Foreign(
        a0, thresholds, weights, growth if (is_rated if rated is None else rated) else 0.0,
        experiment.centre_V, span, stroke, noise, colour,
    )  # fmt: skip


def noise_of(plant: Foreign, samples: int, rng: np.random.Generator) -> Array:
    """Noise of the sensor (µm): white, or of first order, with the plant's rms."""
    from scipy.signal import lfilter

    white = rng.normal(0.0, plant.noise_um, samples)
    if plant.colour == 0.0:
        return white
    size = np.sqrt(1.0 - plant.colour**2)
    return np.asarray(lfilter([size], [1.0, -plant.colour], white))


PAUSE_S = 2.0
"""Between two records, on the clock of the experiment."""
_PASSES = 2  # of a loop whose plant is answered by the last pass
_BANDWIDTH = 0.02  # of the loop, of the sampling rate
_LOOP_SHARE = 0.7  # of the range, to leave room for overshoot


@dataclass(frozen=True, eq=False)
class Bench:
    """A plant with what is hidden in it, and how it is driven."""

    plant: Foreign  # without what is hidden
    hidden: tuple[Mechanism, ...]  # in the chain's order
    experiment: Experiment  # the experiment
    # where it is not zero, each record begins after a decaying motion of this reach, in spans,
    # that nobody recorded
    history_ratio: float = 0.0

    def starts_s(self) -> list[float]:
        """Clock at the first sample of every record (s)."""
        starts, now = [], 0.0
        for drive in self.experiment.drives:
            starts.append(now)
            now += drive.duration_s + PAUSE_S
        return starts

    def clocks_s(self) -> list[Array]:
        """Clock at the recorded samples (s), by record."""
        return [
            start + d.ts_s * np.arange(d.cut, d.command_V.size, dtype=np.float64)
            for d, start in zip(self.experiment.drives, self.starts_s(), strict=True)
        ]

    def displacements(
        self, hidden: Sequence[Mechanism] | None = None, linear: bool = False
    ) -> list[Array]:
        """Displacement at the recorded samples (µm), without noise, by record."""
        chosen = self.hidden if hidden is None else hidden
        return [
            self._displacement(drive, start, chosen, linear)
            for drive, start in zip(self.experiment.drives, self.starts_s(), strict=True)
        ]

    def by_input(self) -> list[Array]:
        """Displacement without the effects that go by the clock (µm), by record."""
        return self.displacements([m for m in self.hidden if m.effect not in TIMED])

    def _displacement(
        self, drive: Drive, start_s: float, hidden: Sequence[Mechanism], linear: bool
    ) -> Array:
        x = between(drive.command_V, drive.parts) if linear else drive.fine_V
        at = Grid(start_s + drive.step_s * np.arange(x.size, dtype=np.float64), drive.step_s)
        for m in hidden:
            if m.form.place < CORE and m.form.apply is not None:
                x = m.form.apply(x, at, m.numbers)
        x = self._ceramic(x, drive, {m.effect: m for m in hidden if m.form.place == CORE})
        for m in hidden:
            if m.form.place > CORE and m.form.apply is not None:
                x = m.form.apply(x, at, m.numbers)
        return x[:: drive.parts][drive.cut :]

    def _ceramic(self, u: Array, drive: Drive, changed: dict[str, Mechanism]) -> Array:
        """Hysteresis on the fine grid (µm), and what is changed about it."""
        p = self.plant
        past = changed.get("initial_memory")
        history: Sequence[float] = ()
        if past is not None:
            history = [float(u[0]) + turn for turn in past.numbers["turns_V"]]
        elif self.history_ratio:
            # turns of a decaying motion about the first command
            reach = self.history_ratio * p.span_V
            history = [float(u[0]) + reach, float(u[0]) + reach * -0.4]
        low = high = u
        if "asymmetry" in changed:
            low, high = envelopes(changed["asymmetry"].numbers, u)
        # Eq. 5 is of samples; between them its thresholds go on as the command does
        speed = np.abs(np.diff(u[:: drive.parts], prepend=u[0])) / drive.ts_s
        law = changed.get("rate_law")
        wider = wider_V(law.numbers, speed) if law is not None else p.delta2_s * speed
        wider = held(wider, drive.parts) if drive.is_held else between(wider, drive.parts)
        if low is u and not np.any(wider):
            plays = plays_by_turning_points(u, p.thresholds_V, p.weights, history)
        else:
            plays = plays_by_substeps(low, high, wider, p.thresholds_V, p.weights, history)
        if "congruency" in changed:
            plays = plays * weight_gain(changed["congruency"].numbers, u)
        return p.a0_um_V * u + plays


def close_loop(bench: Bench, noise_um: Sequence[Array]) -> Bench:
    """Let an integrator make the commands from what the sensor shows, noise among it.

    The drives hold references. The loop is closed around the plays alone, sample by sample, and
    what the whole plant does besides comes in as a disturbance that the last pass has shown.
    """
    p, references = bench.plant, bench.experiment.drives
    low, high = p.centre_V - 1.2 * p.span_V, p.centre_V + 1.2 * p.span_V
    gain = 2.0 * np.pi * _BANDWIDTH / p.gain_um_V
    besides = [np.zeros(d.command_V.size) for d in references]
    found = bench
    for _ in range(_PASSES):
        drives = []
        for d, noise, other in zip(references, noise_um, besides, strict=True):
            wish = p.centre_V + _LOOP_SHARE * (d.command_V - p.centre_V)
            u = integrated(
                p.gain_um_V * wish, float(wish[0]), gain, low, high, p.a0_um_V, p.thresholds_V,
                p.weights, noise + other,
            )  # fmt: skip
            drives.append(replace(d, fine_V=held(np.asarray(u), d.parts)))
        found = replace(bench, experiment=replace(bench.experiment, drives=tuple(drives)))
        commands = [d.command_V for d in drives]
        alone = [
            p.a0_um_V * u + plays_by_turning_points(u, p.thresholds_V, p.weights) for u in commands
        ]
        besides = [w - a for w, a in zip(found.displacements(), alone, strict=True)]
    return found


# --- phenomena outside the catalogue ---

Displaced = tuple[list[Array], list[Array], dict[str, Any]]
"""Displacement at the recorded samples (µm), the part that follows from the input, the numbers."""


def _force(bench: Bench, rng: np.random.Generator) -> Displaced:
    """Push with band-limited noise: twenty lines that go by the clock."""
    still = bench.displacements()
    size = bench.plant.noise_um * rng.uniform(3.0, 12.0)
    fastest = 0.2 / min(d.ts_s for d in bench.experiment.drives)
    hz = np.exp(rng.uniform(math.log(0.005 * fastest), math.log(fastest), 20))
    phases = rng.uniform(0.0, 2.0 * math.pi, hz.size)
    pushed = []
    for y, t in zip(still, bench.clocks_s(), strict=True):
        force = sum(np.sin(2.0 * math.pi * f * t + p) for f, p in zip(hz, phases, strict=True))
        pushed.append(y + size * math.sqrt(2.0 / hz.size) * force)
    return pushed, still, {"rms_um": size, "low_hz": float(hz.min()), "high_hz": float(hz.max())}


def _second_input(bench: Bench, rng: np.random.Generator) -> Displaced:
    """Move another axis, which nobody recorded, in steps that couple into this one."""
    still = bench.displacements()
    size = bench.plant.noise_um * rng.uniform(6.0, 25.0)
    moved = []
    for y, t in zip(still, bench.clocks_s(), strict=True):
        ends = np.sort(rng.uniform(t[0], t[-1], int(rng.integers(8, 30))))
        levels = rng.uniform(-1.0, 1.0, ends.size + 1)
        moved.append(y + size * levels[np.searchsorted(ends, t)])
    return moved, still, {"peak_um": size}


def _bouc_wen(bench: Bench, rng: np.random.Generator) -> Displaced:
    p = bench.plant
    width = p.span_V * rng.uniform(0.1, 0.3)
    depth = float(p.weights.sum()) * width * rng.uniform(0.7, 1.5)
    model = BoucWen(
        p.gain_um_V, depth, width, exponent=rng.uniform(1.0, 2.0), share=rng.uniform(0.5, 0.9)
    )
    y = _of_commands(bench, model.of_command)
    return y, y, model.to_dict()


def _duhem(bench: Bench, rng: np.random.Generator) -> Displaced:
    p = bench.plant
    alpha = rng.uniform(1.5, 6.0) / p.span_V
    numbers = {"alpha": alpha, "slope_um_V": p.gain_um_V, "initial_um_V": p.a0_um_V}
    y = _of_commands(bench, lambda u: np.asarray(duhem(u, alpha, p.gain_um_V, p.a0_um_V)))
    return y, y, numbers


def _stick_slip(bench: Bench, rng: np.random.Generator) -> Displaced:
    sticks = bench.plant.noise_um * rng.uniform(8.0, 30.0)
    slips = sticks * rng.uniform(0.1, 0.5)
    y = [np.asarray(stuck_and_slipped(x, sticks, slips)) for x in bench.displacements()]
    return y, y, {"sticks_um": sticks, "slips_um": slips}


def _of_commands(bench: Bench, respond: Callable[[Array], Array]) -> list[Array]:
    """Displacement of a core that stands in the place of the plays, by record."""
    found = []
    for drive in bench.experiment.drives:
        about = drive.fine_V - bench.plant.centre_V  # symmetric about the middle of the range
        found.append(respond(about)[:: drive.parts][drive.cut :])
    return found


OUTSIDE: Mapping[str, Callable[[Bench, np.random.Generator], Displaced]] = {
    "force": _force,
    "second input": _second_input,
    "bouc-wen": _bouc_wen,
    "duhem": _duhem,
    "stick-slip": _stick_slip,
}
"""Phenomena outside the catalogue, by name."""
