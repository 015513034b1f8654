"""Measured and structure: stages whose hysteresis is of another kind than what is believed."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files
from pathlib import Path

from rdpi_gym.envs.tasks.environment import environment_of
from rdpi_gym.envs.tasks.one_effect import CREEP, LAG, MODE, NOISE_UM, stage
from rdpi_gym.envs.tasks.task import StageTask
from rdpi_gym.envs.truth import RATE_BANDWIDTH_HZ
from rdpi_gym.plant import PlantModel, Sensor, named_plant

KINDS = ("preisach", "bouc_wen", "duhem")
"""Cores of the measured PICMA stack that have a task of their own."""

_MEASURED = ("rdpi", "generalised_pi", "preisach", "bouc_wen", "asymmetric_bouc_wen", "duhem")
_EFFECTS = (LAG, CREEP, MODE)


def structure_truth(kind: str) -> PlantModel:
    """Return the nominal stage of a kind of hysteresis: the PICMA stack's core, with a stage's effects."""
    base = named_plant(f"picma-{kind}")
    return stage(f"PICMA {kind} stage", *_EFFECTS, base=base)


def structure_belief(kind: str) -> PlantModel:
    """Return the RDPI model that was fitted to records of that stage's core, with the same effects."""
    path = Path(str(files("rdpi_gym.envs.tasks") / "beliefs")) / f"{kind}.json"
    truth = structure_truth(kind)
    fitted = PlantModel.load(path)
    core = fitted.hysteresis.band_limited(RATE_BANDWIDTH_HZ)
    return replace(truth, hysteresis=core, offset_um=fitted.offset_um, name=fitted.name)


def _measured(kind: str) -> PlantModel:
    plant = named_plant(f"picma-{kind}")
    return replace(plant, sensor=Sensor(noise_um=NOISE_UM), identification={})


def _structure(kind: str, name: str, people: str, rank: int) -> StageTask:
    return StageTask(
        name,
        f"A stage whose hysteresis is {people}'s",
        f"The hysteresis is the {people} model that was fitted to the measured PICMA stack, behind "
        "an amplifier's lag, with creep and a lightly damped mode. What is believed is the RDPI model "
        "fitted to records of it: no value of its parameters makes it the truth.",
        (structure_truth(kind),),
        beliefs=(structure_belief(kind),),
        hidden="the memory of the hysteresis, and the states of lag, creep and mode",
        history=32,
        rank=rank,
    )


MEASURED = StageTask(
    "Measured",
    "A measured stack, as six kinds of hysteresis describe it",
    "A PICMA stack that was measured at 1 Hz. Each plant is one of six models that were fitted to "
    "that record, with the creep and the sensor's lag of 15 ms that went with it; what is believed is "
    "the RDPI model of the same record. Slow: it is sampled at 1 kHz and moves at 0.5 to 5 Hz, as "
    "nothing is known of it beyond.",
    tuple(_measured(kind) for kind in _MEASURED),
    beliefs=(_measured("rdpi"),) * len(_MEASURED),
    hidden="the kind and the memory of the hysteresis, and the states of creep and lag",
    references=(
        "sine",
        "sine",
        {"signal": "triangle", "frequency_hz": 1.0},
        {"signal": "multisine", "frequency_hz": 0.5, "lines": 10},
        {"signal": "raster", "frequency_hz": 1.0},
        {"signal": "nested-loops", "frequency_hz": 2.0},
    ),
    frequency_hz=(0.5, 5.0),
    amplitude_share=0.6,
    ts_s=1e-3,
    smooth_start_s=0.5,
    rank=110,
)
PREISACH = _structure("preisach", "Preisach", "Preisach", 120)
BOUC_WEN = _structure("bouc_wen", "BoucWen", "Bouc-Wen", 130)
DUHEM = _structure("duhem", "Duhem", "Duhem", 140)

PiezoMeasuredEnv = environment_of(MEASURED, __name__)
PiezoPreisachEnv = environment_of(PREISACH, __name__)
PiezoBoucWenEnv = environment_of(BOUC_WEN, __name__)
PiezoDuhemEnv = environment_of(DUHEM, __name__)
