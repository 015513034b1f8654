"""Bare, Creep, Lag, Resonance: the paper's plant, and one thing more that a stage has."""

from __future__ import annotations

from dataclasses import replace

from rdpi_gym.envs.tasks.environment import environments_of
from rdpi_gym.envs.tasks.task import StageTask
from rdpi_gym.envs.truth import limit_band
from rdpi_gym.plant import P10, PlantModel, Sensor
from rdpi_gym.plant.effects.actuator_lag import ActuatorLag
from rdpi_gym.plant.effects.base import Effect
from rdpi_gym.plant.effects.creep import Creep
from rdpi_gym.plant.effects.resonance import Resonance

LAG, CREEP = ActuatorLag(time_constant_s=2e-4), Creep(gain_per_decade=0.015)
MODE = Resonance(f0_hz=739.0, damping=0.03)
"""The mode of the stage that the effect's file cites."""
NOISE_UM = 0.01
"""Standard deviation (µm) of the sensor's white noise."""


def stage(name: str, *effects: Effect, base: PlantModel = P10) -> PlantModel:
    """Return a plant of the tasks: its rate low-passed at 800 Hz, its sensor noisy."""
    sensor = Sensor(noise_um=NOISE_UM)
    return replace(limit_band(base), name=name, effects=effects, sensor=sensor)


BARE = StageTask(
    "Bare",
    "A stage with nothing but rate-dependent hysteresis",
    "What the paper controls: eleven gains and ten plays whose thresholds grow with the rate, and a "
    "sensor with noise. A good inverse of the hysteresis is all that is needed, and a ranking here "
    "says nothing about a stage that rings.",
    (stage("P10"),),
    hidden="the memory of the plays",
    rank=10,
)
CREEP_TASK = StageTask(
    "Creep",
    "Hysteresis and creep",
    "A displacement that goes on after the command has stopped, 1.5 % a decade of time: slow "
    "feedback removes it, an inverse of the hysteresis alone does not.",
    (stage("P10 with creep", CREEP),),
    hidden="the memory of the plays and of the creep",
    rank=20,
)
LAG_TASK = StageTask(
    "Lag",
    "Hysteresis behind an amplifier that lags",
    "A first-order lag of 0.2 ms: two samples, so that who uses the preview to lead by it wins, and "
    "who raises a gain instead becomes unstable.",
    (stage("P10 with lag", LAG),),
    hidden="the memory of the plays and the lag's state",
    history=32,
    rank=30,
)
RESONANCE_TASK = StageTask(
    "Resonance",
    "Hysteresis under a lightly damped mode",
    "A mode about 739 Hz, anywhere from 443 to 1035 Hz, damped by 3 %: integral feedback tuned "
    "without it diverges, and corners of a reference make it ring for 7 ms.",
    (stage("P10 with resonance", MODE),),
    hidden="the memory of the plays, and the mode's frequency and velocity",
    history=32,
    rank=40,
)

PiezoBareEnv, bare_vector = environments_of(BARE, __name__)
PiezoCreepEnv, creep_vector = environments_of(CREEP_TASK, __name__)
PiezoLagEnv, lag_vector = environments_of(LAG_TASK, __name__)
PiezoResonanceEnv, resonance_vector = environments_of(RESONANCE_TASK, __name__)
