"""The held-out plants: what they have that no belief holds, and how they are drawn."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace

import numpy as np

from baselines.learned.options import PLANTS, TrainingOptions
from benchmarks.tracking.stages import NOISE_UM, Stage, make_stage
from rdpi_gym.envs.truth import randomise_effects, randomise_plant
from rdpi_gym.plant import P10, PlantModel, Sensor, find_plant
from rdpi_gym.plant.effects import Effect

TS_S = TrainingOptions.ts_s
"""Sampling time (s) of trainings and scores."""
LITERAL = ", literal"
"""What the name of a world with a literal rate ends in."""
HELD_OUT = 2**34
"""Begins the entropy of every plant that is drawn here. Trainings draw from single numbers below
2^32, their evaluations from 2^33."""

_LAG, _CREEP, _MODE = PLANTS[0].effects


@dataclass(frozen=True)
class World:
    """Plants that are drawn about a nominal one.

    Parameters
    ----------
    name
        What tables call it.
    nominal
        The plant with its effects.
    literal
        Whether its rate is left as the paper writes it, in place of low-passed; beliefs and agents
        are the same.
    base_hz
        Lowest frequency (Hz) of its references; the highest is five times as high.

    Examples
    --------
    >>> world = GROUPS[0]
    >>> world.truth(3) == world.truth(3), world.truth(3) == world.truth(4)
    (True, False)
    >>> world.belief.effects
    ()
    """

    name: str
    nominal: PlantModel
    literal: bool = False
    base_hz: float = 20.0

    @property
    def stage(self) -> Stage:
        """The nominal plant as the benchmark scores it, its rate low-passed and its sensor noisy."""
        return make_stage(self.nominal, [TS_S])

    @property
    def belief(self) -> PlantModel:
        """What all controllers hold: the nominal hysteresis without effects."""
        return replace(self.stage.plant, effects=(), name=f"{self.nominal.name} without effects")

    def truth(self, seed: int) -> PlantModel:
        """Draw a plant about the nominal one, as widely as trainings do.

        A literal plant is the low-passed one of the same seed, its rate's low-pass aside.
        """
        rng = np.random.default_rng([HELD_OUT, zlib.crc32(self.nominal.name.encode()), seed])
        drawn = randomise_plant(self.stage.plant, TrainingOptions.randomise, rng)
        drawn = randomise_effects(drawn, TrainingOptions.randomise_effects, rng)
        if not self.literal:
            return drawn
        return drawn.with_hysteresis(replace(drawn.hysteresis, rate_bandwidth_hz=None))


def _group(name: str, *effects: Effect) -> World:
    sensor = Sensor(noise_um=NOISE_UM)
    return World(name, replace(P10, name=f"P10, {name}", effects=effects, sensor=sensor))


GROUPS = (
    _group("all", _LAG, _CREEP, _MODE),
    _group("lag", _LAG),
    _group("resonance", _MODE),
    _group("creep", _CREEP),
    _group("bare"),
)
"""Which effects the plants of a group have: a lag, creep and a mode, one of them alone, or none;
all have a noisy sensor."""

GAP = {
    "bare": World("bare", GROUPS[4].nominal),
    "with effects": World("with effects", GROUPS[0].nominal),
    "picma": World("picma", find_plant("picma")),
    "picma at 1 Hz": World("picma at 1 Hz", find_plant("picma"), base_hz=1.0),
}
"""The domains of the gap. The record behind ``picma`` has 1 Hz: it is extrapolated at 20 to 100 Hz."""


def with_literal(world: World) -> tuple[World, World]:
    """Return a domain and its twin with a literal rate."""
    return world, replace(world, name=f"{world.name}{LITERAL}", literal=True)
