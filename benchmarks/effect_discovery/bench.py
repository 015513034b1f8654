"""A foreign plant under way: every mechanism in its place, on the true command between samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.effect_discovery.forms import (
    CORE,
    TIMED,
    Grid,
    Mechanism,
    envelopes,
    weight_gain,
    wider_V,
    without,
)
from benchmarks.effect_discovery.physics import (
    integrated,
    plays_by_substeps,
    plays_by_turning_points,
)
from benchmarks.effect_discovery.plants import Foreign, decaying_history
from benchmarks.effect_discovery.protocols import Drive, Experiment, between, held
from rdpi_gym.support.arrays import Array

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
        return self.displacements(without(self.hidden, TIMED))

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
            history = decaying_history(float(u[0]), self.history_ratio * p.span_V, 0.4, 2)
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
    plant, references = bench.plant, bench.experiment.drives
    besides = [np.zeros(d.command_V.size) for d in references]
    found = bench
    for _ in range(_PASSES):
        drives = []
        for d, noise, other in zip(references, noise_um, besides, strict=True):
            wish = plant.centre_V + _LOOP_SHARE * (d.command_V - plant.centre_V)
            u = _loop(wish, plant, noise + other)
            drives.append(replace(d, fine_V=held(u, d.parts)))
        experiment = replace(bench.experiment, drives=tuple(drives))
        found = replace(bench, experiment=experiment)
        whole, alone = found.displacements(), _plays_alone(found)
        besides = [w - a for w, a in zip(whole, alone, strict=True)]
    return found


def _plays_alone(bench: Bench) -> list[Array]:
    p = bench.plant
    return [
        p.a0_um_V * d.command_V + plays_by_turning_points(d.command_V, p.thresholds_V, p.weights)
        for d in bench.experiment.drives
    ]


def _loop(wish_V: Array, plant: Foreign, disturbance_um: Array) -> Array:
    low, high = plant.centre_V - 1.2 * plant.span_V, plant.centre_V + 1.2 * plant.span_V
    gain = 2.0 * np.pi * _BANDWIDTH / plant.gain_um_V
    return np.asarray(
        integrated(
            plant.gain_um_V * wish_V, float(wish_V[0]), gain, low, high, plant.a0_um_V,
            plant.thresholds_V, plant.weights, disturbance_um,
        )
    )  # fmt: skip
