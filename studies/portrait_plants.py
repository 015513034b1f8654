"""Plants with fourteen sorts of effects outside the catalogue, each on a fine grid, and their records."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from benchmarks.effect_discovery.physics import (
    gap,
    linear,
    plays_by_substeps,
    plays_by_turning_points,
)
from benchmarks.effect_discovery.plants import Foreign, draw_plant, noise_of
from benchmarks.effect_discovery.protocols import Drive, Experiment, between
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.measurement.record import Role
from rdpi_gym.signals.experiments import PAUSE_S, standard_protocol
from rdpi_gym.support.arrays import Array
from rdpi_gym.virtual_lab.draws import MaskedError, refit_residuals


@dataclass(frozen=True, eq=False)
class World:
    """A plant under way during one record."""

    plant: Foreign  # its hysteresis
    drive: Drive  # the record
    fastest_1_s: float  # rate of the command, over its span, that is the unit of rates (1/s)
    numbers: Mapping[str, float]  # drawn for the effect

    @property
    def s(self) -> Array:
        """Command about the middle of its range, over its span."""
        return (self.drive.fine_V - self.plant.centre_V) / self.plant.span_V

    @property
    def size(self) -> float:
        """Signed size of the effect."""
        return self.numbers["size"] * self.numbers["sign"]

    def rate(self, x: Array) -> Array:
        """Rate of a share of the range, in units of the fastest; the stage rests before the record."""
        found = np.gradient(x, self.drive.step_s) / self.fastest_1_s
        found[0] = 0.0
        return np.asarray(found)

    def lag(self, x: Array, name: str = "tau_s") -> Array:
        """First-order low-pass, settled where the record begins."""
        return linear(x, [1.0], [self.numbers[name], 1.0], self.drive.step_s)

    def plays(self, u_V: Array) -> Array:
        """Displacement (µm) of the plays alone."""
        plant, drive = self.plant, self.drive
        speed = np.abs(np.diff(u_V[:: drive.parts], prepend=u_V[0])) / drive.ts_s
        if plant.delta2_s == 0.0:
            return plays_by_turning_points(u_V, plant.thresholds_V, plant.weights)
        wider = between(plant.delta2_s * speed, drive.parts)
        return plays_by_substeps(u_V, u_V, wider, plant.thresholds_V, plant.weights)

    def bent(self, more: Array) -> Array:
        """Displacement (µm) of a command with more, in spans."""
        u = self.drive.fine_V + self.plant.span_V * more
        return self.plant.a0_um_V * u + self.plays(u)

    def weighted(self, more: Array) -> Array:
        """Displacement (µm) of plays whose weights are larger by a share."""
        u = self.drive.fine_V
        return self.plant.a0_um_V * u + (1.0 + more) * self.plays(u)

    def added(self, more: Callable[[Array], Array]) -> Array:
        """Displacement (µm) with more, in strokes, that depends on the displacement in strokes."""
        y = self.bent(np.zeros_like(self.s))
        middle = self.plant.gain_um_V * self.plant.centre_V
        return y + self.plant.stroke_um * more((y - middle) / self.plant.stroke_um)


@njit(cache=True)
def _since_turn(u: Array, step_s: float) -> Array:
    """Time since the last reversal (s)."""
    out, way, since = np.empty_like(u), 0.0, 1e9
    for k in range(u.shape[0]):
        change = u[k] - u[k - 1] if k > 0 else 0.0
        if change * way < 0.0:
            since = 0.0
        if change != 0.0:
            way = 1.0 if change > 0.0 else -1.0
        since += step_s
        out[k] = since
    return out


@njit(cache=True)
def _relay(x: Array, width: float) -> Array:
    out, now = np.empty_like(x), 1.0 if x[0] > 0.0 else -1.0
    for k in range(x.shape[0]):
        if x[k] > width:
            now = 1.0
        elif x[k] < -width:
            now = -1.0
        out[k] = now
    return out


def _late(x: Array, samples: int) -> Array:
    at = np.maximum(np.arange(x.size) - samples, 0)
    return x[at]


def _bumper(w: World) -> Array:
    """Push back beyond a part of the stroke, with a play of its own."""
    reach, width = w.numbers["from"], w.numbers["play"]
    size = abs(w.size)

    def more(y: Array) -> Array:
        beyond = np.sign(y) * np.maximum(np.abs(y) - reach, 0.0)
        return -size * np.asarray(gap(beyond, width))

    return w.added(more)


def _relaxing(w: World) -> Array:
    def more(y: Array) -> Array:
        return 0.5 * w.size * (w.lag(np.abs(y)) + w.lag(np.abs(y), "second_tau_s"))

    return w.added(more)


@dataclass(frozen=True)
class Sort:
    """One sort of effect."""

    # what is true of it
    place: str
    memory: bool
    parity: str
    displace: Callable[[World], Array]  # the displacement (µm) on the fine grid
    tau_s: tuple[float, float] = (0.2, 20.0)  # range of its time constant (s)


SORTS: Mapping[str, Sort] = {
    "input bent by |u|^1.5": Sort(
        "before", False, "even", lambda w: w.bent(w.size * np.abs(w.s) ** 1.5)
    ),
    "input bent by u^3": Sort("before", False, "odd", lambda w: w.bent(abs(w.size) * w.s**3)),
    "input droops after u^2": Sort(
        "before", True, "even", lambda w: w.bent(w.size * w.lag(w.s**2))
    ),
    "input follows past speed": Sort(
        "before", True, "even", lambda w: w.bent(w.size * w.lag(np.abs(w.rate(w.s))))
    ),
    "plays follow the mean position": Sort(
        "in", True, "even", lambda w: w.weighted(w.size * w.lag(w.s))
    ),
    "plays follow past u^2": Sort("in", True, "odd", lambda w: w.weighted(w.size * w.lag(w.s**2))),
    "plays recover after a turn": Sort(
        "in",
        True,
        "odd",
        lambda w: w.weighted(
            w.size * np.exp(-_since_turn(w.drive.fine_V, w.drive.step_s) / w.numbers["tau_s"])
        ),
        (0.02, 1.0),
    ),
    "hysteretic bumper": Sort("behind", False, "odd", _bumper),
    "output follows past speed": Sort(
        "behind", True, "even", lambda w: w.added(lambda y: w.size * w.lag(np.abs(w.rate(y))))
    ),
    "drag by speed squared": Sort(
        "behind",
        False,
        "odd",
        lambda w: w.added(lambda y: -abs(w.size) * w.rate(y) * np.abs(w.rate(y))),
    ),
    "relay with dead time": Sort(
        "behind",
        True,
        "odd",
        lambda w: w.added(
            lambda y: (
                w.size
                * _late(_relay(y, w.numbers["width"]), round(w.numbers["tau_s"] / w.drive.step_s))
            )
        ),
        (0.01, 0.2),
    ),
    "|y| relaxes twice": Sort("behind", True, "even", _relaxing, (0.1, 1.0)),
    "u times its rate": Sort(
        "behind", False, "even", lambda w: w.added(lambda y: w.size * w.s * w.rate(w.s))
    ),
    "output follows past u^2": Sort(
        "behind", True, "even", lambda w: w.added(lambda y: w.size * w.lag(w.s**2))
    ),
}
"""The sorts by name. A dead time counts as a memory; what depends on the rate at once as none."""


def drawn_numbers(sort: Sort, longest_s: float, rng: np.random.Generator) -> dict[str, float]:
    """Draw an effect's numbers; its size is set later."""
    low, high = sort.tau_s
    tau = math.exp(rng.uniform(math.log(low), math.log(min(high, longest_s / 3.0))))
    return {
        "tau_s": tau,
        "second_tau_s": tau * rng.uniform(5.0, 15.0),
        "sign": float(rng.choice([-1.0, 1.0])),
        "from": rng.uniform(0.3, 0.6),
        "play": rng.uniform(0.02, 0.1),
        "width": rng.uniform(0.1, 0.3),
    }


PROTOCOLS = ("standard", "bursts")
_PARTS = 4
_WANTED = (6.0, 40.0)
# An effect is half a stroke from peak to peak at most; what shows too little is drawn again.
_LARGEST, _TOLERANCE, _ATTEMPTS, _LOOKED_AT = 0.5, 1.1, 12, 5_000
_LEAST, _REDRAWS = 4.0, 8
_RAMP_S = 0.06


@dataclass(frozen=True, eq=False)
class Measured:
    """A plant with its records."""

    sort: Sort  # what it has
    # as :class:`~studies.portrait_plants.World` has them
    plant: Foreign
    fastest_1_s: float
    numbers: dict[str, float]
    # what a refit of the bare model leaves of the effect, on the record to fit that shows most,
    # in noise floors
    floors: float
    dataset: Dataset  # the records

    def answer(self, drive: Drive) -> Array:
        """Displacement (µm) at the samples of a command, without noise."""
        world = World(self.plant, drive, self.fastest_1_s, self.numbers)
        return self.sort.displace(world)[:: drive.parts]


def measured(name: str, protocol: str, seed: int, number: int) -> Measured:
    """Draw a plant with an effect of a sort, and take its records."""
    places = list(SORTS).index(name), PROTOCOLS.index(protocol)
    for redraw in range(_REDRAWS):
        rng = np.random.default_rng([seed, number, *places, redraw])
        found = _draw_once(name, protocol, rng)
        if found.floors >= _LEAST:
            return found
    raise MaskedError(f"{name} cannot be seen in {_REDRAWS} draws of {protocol}")


def _draw_once(name: str, protocol: str, rng: np.random.Generator) -> Measured:
    experiment = _standard(rng) if protocol == PROTOCOLS[0] else _bursts(rng)
    plant = draw_plant(experiment, rng)
    longest_s = max(d.duration_s for d in experiment.drives)
    numbers = drawn_numbers(SORTS[name], longest_s, rng)
    steps = [
        float(np.quantile(np.abs(np.diff(d.command_V)), 0.99)) / d.ts_s for d in experiment.drives
    ]
    empty = Dataset(f"{name}, {protocol}", tuple(_records(experiment)))
    found = Measured(SORTS[name], plant, max(steps) / experiment.span_V, numbers, 0.0, empty)
    found = _sized(
        found, experiment, math.exp(rng.uniform(math.log(_WANTED[0]), math.log(_WANTED[1])))
    )
    records = tuple(
        replace(r, y_um=y + noise_of(plant, len(y), rng))
        for r, y in zip(empty.records, map(found.answer, experiment.drives), strict=True)
    )
    return replace(found, dataset=replace(empty, records=records))


def _sized(found: Measured, experiment: Experiment, wanted: float) -> Measured:
    fits = [
        k for k, d in enumerate(experiment.drives) if d.role == "train" and np.ptp(d.command_V) > 0
    ]
    drives = [experiment.drives[k] for k in fits]
    records = [found.dataset.records[k] for k in fits]
    every = max(1, sum(len(r.u_V) for r in records) // _LOOKED_AT)
    without = replace(found, numbers={**found.numbers, "size": 0.0})
    still = [without.answer(d) for d in drives]
    size, model = 0.01, found.plant.model()
    for _ in range(_ATTEMPTS):
        numbers = {**found.numbers, "size": size}
        trial = replace(found, numbers=numbers)
        more = [trial.answer(d) - y for d, y in zip(drives, still, strict=True)]
        room = _LARGEST * 2.0 * found.plant.stroke_um / max(float(np.ptp(d)) for d in more)
        left = refit_residuals(model, (), experiment.span_V, records, more, (), every)
        found = replace(trial, floors=max(left.values()) / found.plant.noise_um)
        if wanted / _TOLERANCE < found.floors < wanted * _TOLERANCE or room < 1.01:
            break
        size *= min(max(wanted / max(found.floors, 1e-9), 0.05), 20.0, room)
    return found


def _records(experiment: Experiment) -> list[Record]:
    records, begins = [], 0.0
    for d in experiment.drives:
        u = d.command_V
        t = begins + d.ts_s * np.arange(len(u), dtype=np.float64)
        records.append(Record(d.name, t, u, u, ts_s=d.ts_s, role=d.role))
        begins += d.duration_s + PAUSE_S
    return records


def _grid(seconds: float, ts_s: float) -> Array:
    samples = round(seconds / ts_s)
    return ts_s / _PARTS * np.arange((samples - 1) * _PARTS + 1, dtype=np.float64)


def _standard(rng: np.random.Generator) -> Experiment:
    """Take the laboratory's own protocol about zero, at a half or a quarter of its sampling rates."""
    span = float(rng.choice([10.0, 50.0]))
    drives = []
    for e in standard_protocol(0.0, span, 0.02 * span, seed=int(rng.integers(1000))):
        ts_s = e.ts_s * (4.0 if e.ts_s >= 5e-4 else 2.0)
        drives.append(Drive(e.name, e.role, ts_s, _PARTS, e.signal(_grid(e.duration_s, ts_s))))
    return Experiment(PROTOCOLS[0], tuple(drives), 0.0, span, True, False)


def _bursts(rng: np.random.Generator) -> Experiment:
    """Take random levels with holds, bursts of a slow multisine that wander, and a fast multisine."""
    centre, span = float(rng.choice([0.0, 50.0])), float(rng.choice([10.0, 50.0]))

    def levels(name: str, role: Role, seconds: float) -> Drive:
        t, ends, values = _grid(seconds, 8e-3), [0.0, 0.5, 1.5, 2.5], [0.0, 1.0, -1.0]
        while ends[-1] < seconds:
            ends.append(ends[-1] + math.exp(rng.uniform(math.log(0.1), math.log(8.0))))
            values.append(rng.uniform(-1.0, 1.0))
        knots, at = [0.0], [0.0]
        for begin, value in zip(ends[:-1], values, strict=True):
            knots += [begin + 1e-9, begin + _RAMP_S]
            at += [at[-1], value]
        return Drive(name, role, 8e-3, _PARTS, centre + span * np.interp(t, knots, at))

    def sines(
        name: str, role: Role, seconds: float, ts_s: float, hz: tuple[float, float], wander: bool
    ) -> Drive:
        t = _grid(seconds, ts_s)
        lines = np.exp(rng.uniform(math.log(hz[0]), math.log(hz[1]), 12))
        phases = rng.uniform(0.0, 2.0 * math.pi, 12)
        x = np.zeros_like(t)
        for f, phase in zip(lines, phases, strict=True):
            x += (hz[0] / f) ** 0.3 * np.sin(2.0 * math.pi * f * t + phase)
        if wander:
            knots = np.linspace(0.0, seconds, 9)
            slow = 0.5 * float(x.std()) * np.interp(t, knots, rng.uniform(-1.0, 1.0, 9))
            x = x * np.interp(t, knots, rng.uniform(0.05, 1.0, 9)) + slow
        x *= np.minimum(1.0, t / (0.02 * seconds))
        return Drive(name, role, ts_s, _PARTS, centre + span * x / float(np.abs(x).max()))

    slow, fast = (0.8, 10.0), (10.0, 120.0)
    drives = (
        levels("levels", "train", 50.0),
        sines("bursts", "train", 16.0, 2e-3, slow, True),
        sines("fast", "train", 1.2, 2e-4, fast, False),
        levels("validation-levels", "validation", 30.0),
        sines("validation-bursts", "validation", 10.0, 2e-3, slow, True),
        sines("validation-fast", "validation", 0.6, 2e-4, fast, False),
    )
    return Experiment(PROTOCOLS[1], drives, centre, span, True, False)
