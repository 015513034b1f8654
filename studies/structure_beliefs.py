"""The RDPI models that are believed of stages of another hysteresis, fitted to records of them.

The stages of the tasks Preisach, BoucWen and Duhem have the cores of the measured PICMA stack. Each
runs reversal curves at 20 Hz, a decaying sine and noise up to 100 Hz without its other effects, as
fast as the tasks are; ten plays are fitted to what a sensor with 10 nm of noise reads. The files ship
with the tasks.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import rdpi_gym.envs.tasks
from rdpi_gym.envs.tasks.stages import KINDS, structure_truth
from rdpi_gym.identification import fit
from rdpi_gym.measurement import Record
from rdpi_gym.plant import Plant, PlantModel
from rdpi_gym.signals import BandLimitedNoise, NestedLoops, Signal
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.command import Options

BELIEFS = Path(rdpi_gym.envs.tasks.__file__).parent / "beliefs"
PLAYS = 10
_TS_S, _DURATION_S = 1e-4, 0.4


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit the beliefs and write them."""
    return Options("structure_beliefs", __doc__, out=BELIEFS).run(arguments, _run)


def _run(options: Namespace) -> None:
    for kind in KINDS:
        truth = structure_truth(kind)
        found = fit(records_of(truth), n=PLAYS, name=f"RDPI fitted to PICMA {kind}")
        left = max(found.rmse_um.values()) / truth.reference_um[1]
        note = f"{PLAYS} plays fitted to records of the core {kind}; {50 * left:.2g} % of the stroke is left"
        core = replace(
            found.plant,
            command_range_V=truth.command_range_V,
            reference_um=truth.reference_um,
            note=note,
            identification={},
        )
        print(f"{core.save(options.out / f'{kind}.json')}: {note}")


def records_of(truth: PlantModel) -> list[Record]:
    """Return what the core of a stage shows in three experiments, with noise."""
    bare = replace(truth, effects=())
    low, high = truth.command_range_V
    rng = np.random.default_rng(1)
    t = np.arange(0.0, _DURATION_S, _TS_S)
    records = []
    for name, shape in _shapes(t).items():
        u = np.clip(0.5 * (low + high) * _rise(t) + 0.5 * (high - low) * shape, low, high)
        plant = Plant(bare, _TS_S)
        plant.reset(u0_V=0.0)
        y = plant.simulate(u) + truth.sensor.noise_um * rng.standard_normal(len(t))
        records.append(Record(name, t, u, y, ts_s=_TS_S))
    return records


def _shapes(t: Array) -> dict[str, Array]:
    loops: Signal = NestedLoops(frequency_hz=20.0)
    walk: Signal = BandLimitedNoise(high_hz=100.0, repeat_s=_DURATION_S, seed=1)
    decaying = np.sin(2.0 * np.pi * 40.0 * t) * (1.0 - t / _DURATION_S)
    shapes = {"loops": loops(t), "decaying": decaying, "walk": 0.5 * walk(t)}
    return {name: np.asarray(_rise(t) * shape) for name, shape in shapes.items()}


def _rise(t: Array) -> Array:
    """From rest to the middle of the range within an eighth of the experiment."""
    return np.asarray(np.clip(t / (0.125 * _DURATION_S), 0.0, 1.0))


if __name__ == "__main__":
    sys.exit(main())
