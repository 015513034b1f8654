"""One effect on one plant: the protocol with it and without it, and what a refit leaves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rdpi_gym.identification import fit
from rdpi_gym.measurement import Record
from rdpi_gym.plant import Plant, named_plant
from rdpi_gym.plant.effects import CATALOGUE, Effect, Look, Picture
from rdpi_gym.signals.experiments import Experiment
from rdpi_gym.support.arrays import Array
from rdpi_gym.virtual_lab import HIDEABLE, Truth, simulate_dataset
from rdpi_gym.virtual_lab.dataset import plant_displacement

PLANT = "P10"
_ANY = Picture(
    {},
    Look("loops", "A large sine of 10 Hz", "sine-10hz"),
    Look("left_over_command", "What a refit leaves of it", "sine-10hz"),
)
PICTURES: Mapping[str, Picture] = {
    name: kind.picture or _ANY
    for name, kind in CATALOGUE.items()
    if kind.__module__.startswith("rdpi_gym.") and name in HIDEABLE
}
"""The effects of the package that the virtual laboratory can simulate, by name, as their files
declare their pictures."""
# Half as many samples as in the protocol show the same.
_TS_FACTOR = 2.0


@dataclass(frozen=True, eq=False)
class Study:
    """A plant with one effect, without noise.

    Parameters
    ----------
    effect
        The effect.
    truth
        Plant and protocol.
    without, having
        Records of the protocol by name: of the bare plant, and of the plant with the effect.
    left_um
        What the RDPI model leaves of `having` once it has been refitted to all training records,
        by record, each with its own offset taken out.
    """

    effect: Effect
    truth: Truth
    without: Mapping[str, Record]
    having: Mapping[str, Record]
    left_um: Mapping[str, Array]

    def respond(self, experiment: Experiment) -> tuple[Array, Array]:
        """Displacement (µm) in another experiment: of the bare plant, and with the effect."""
        t, u = experiment.times_s(), experiment.command_V()
        plant = self.truth.plant
        return plant_displacement(plant, [], t, u), plant_displacement(plant, [self.effect], t, u)


def bare_records() -> dict[str, Record]:
    """Take the protocol on the plant without any effect."""
    return {r.name: r for r in simulate_dataset(_truth()).records}


def study_effect(name: str, values: Mapping[str, float], without: Mapping[str, Record]) -> Study:
    """Take the protocol on the plant with an effect, and refit the RDPI model to it."""
    effect = CATALOGUE[name]().with_values(values)
    truth = _truth().with_hidden([effect])
    data = simulate_dataset(truth)
    model = fit(data, n=truth.plant.hysteresis.n).plant
    left = {}
    for record in data.records:
        error = record.y_um - Plant(model, record.ts_s).simulate(record.u_V)
        left[record.name] = error - np.mean(error)
    return Study(effect, truth, without, {r.name: r for r in data.records}, left)


def _truth() -> Truth:
    return Truth(named_plant(PLANT), (), noise_um=0.0, seed=0, ts_factor=_TS_FACTOR)
