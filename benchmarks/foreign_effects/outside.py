"""What no effect of the catalogue is: forces, other inputs, other hysteresis, stick and slip."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from benchmarks.foreign_effects.chain import Bench
from benchmarks.foreign_effects.physics import duhem, stuck_and_slipped
from benchmarks.hidden_effects.outside import BoucWen
from rdpi_gym.support.arrays import Array

Displaced = tuple[list[Array], list[Array], dict[str, Any]]
"""Displacement at the recorded samples (µm), the part that follows from the input, the numbers."""


def _force(bench: Bench, rng: np.random.Generator) -> Displaced:
    """Push with band-limited noise: twenty lines that go by the clock."""
    still = bench.displacements()
    size = bench.plant.noise_um * rng.uniform(3.0, 12.0)
    fastest = 0.2 / min(d.ts_s for d in bench.taken.drives)
    hz = np.exp(rng.uniform(math.log(0.005 * fastest), math.log(fastest), 20))
    phases = rng.uniform(0.0, 2.0 * math.pi, hz.size)
    pushed = []
    for y, t in zip(still, _clocks(bench), strict=True):
        force = sum(np.sin(2.0 * math.pi * f * t + p) for f, p in zip(hz, phases, strict=True))
        pushed.append(y + size * math.sqrt(2.0 / hz.size) * force)
    return pushed, still, {"rms_um": size, "low_hz": float(hz.min()), "high_hz": float(hz.max())}


def _second_input(bench: Bench, rng: np.random.Generator) -> Displaced:
    """Move another axis, which nobody recorded, in steps that couple into this one."""
    still = bench.displacements()
    size = bench.plant.noise_um * rng.uniform(6.0, 25.0)
    moved = []
    for y, t in zip(still, _clocks(bench), strict=True):
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


def _clocks(bench: Bench) -> list[Array]:
    return [
        start + d.ts_s * np.arange(d.cut, d.command_V.size, dtype=np.float64)
        for d, start in zip(bench.taken.drives, bench.starts_s(), strict=True)
    ]


def _of_commands(bench: Bench, respond: Callable[[Array], Array]) -> list[Array]:
    """Displacement of a core that stands in the place of the plays, by record."""
    found = []
    for drive in bench.taken.drives:
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
"""What may be there that is no effect of the catalogue, by name."""
