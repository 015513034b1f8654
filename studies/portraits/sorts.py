"""Fourteen sorts of effects outside the catalogue, each on a fine grid and with what is true of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numba import njit

from benchmarks.effect_discovery.physics import (
    gap,
    linear,
    plays_by_substeps,
    plays_by_turning_points,
)
from benchmarks.effect_discovery.plants import Foreign
from benchmarks.effect_discovery.protocols import Drive, between
from rdpi_gym.support.arrays import Array


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
        """Of the effect, of either sign."""
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
