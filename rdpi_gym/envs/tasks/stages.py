"""The registered tasks: one effect, the whole stage and what befalls it, hysteresis of another kind than believed."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files
from pathlib import Path

from rdpi_gym.envs.draw_laws import Glide, NoiseLaw, Wear
from rdpi_gym.envs.tasks.environment import environments_of
from rdpi_gym.envs.tasks.task import FIRST, StageTask
from rdpi_gym.envs.truth import RATE_BANDWIDTH_HZ, limit_band
from rdpi_gym.plant import P10, PlantModel, Sensor, named_plant
from rdpi_gym.plant.effects.actuator_lag import ActuatorLag
from rdpi_gym.plant.effects.base import Effect
from rdpi_gym.plant.effects.creep import Creep
from rdpi_gym.plant.effects.delay import Delay
from rdpi_gym.plant.effects.resonance import Resonance
from rdpi_gym.plant.effects.thermal_drift import ThermalDrift

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


KINDS = ("preisach", "bouc_wen", "duhem")
"""Cores of the measured PICMA stack that have a task of their own."""

_MEASURED = ("rdpi", "generalised_pi", "preisach", "bouc_wen", "asymmetric_bouc_wen", "duhem")
_LAG_CREEP_MODE = (LAG, CREEP, MODE)


def structure_truth(kind: str) -> PlantModel:
    """Return the nominal stage of a kind of hysteresis: the PICMA stack's core, with a stage's effects."""
    base = named_plant(f"picma-{kind}")
    return stage(f"PICMA {kind} stage", *_LAG_CREEP_MODE, base=base)


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

PiezoMeasuredEnv, measured_vector = environments_of(MEASURED, __name__)
PiezoPreisachEnv, preisach_vector = environments_of(PREISACH, __name__)
PiezoBoucWenEnv, bouc_wen_vector = environments_of(BOUC_WEN, __name__)
PiezoDuhemEnv, duhem_vector = environments_of(DUHEM, __name__)


HISTORY = 32
"""Samples: 3.2 ms, two periods of the nominal mode."""
GLIDE_S = 0.025
"""Time (s) in which a load takes the mode to where it stays."""
LOWEST_HZ = 300.0
"""Lowest frequency (Hz) of a loaded mode."""

_DELAY, _DRIFT = Delay(delay_s=1e-4), ThermalDrift(rate_um_s=0.1, time_constant_s=50.0)
_EFFECTS = (*_LAG_CREEP_MODE, _DRIFT, _DELAY)
_HIDDEN = "the memory of the plays, the states of lag, creep, mode and delay, and the drift"
_QUANTISED = replace(
    stage("P10 stage", *_EFFECTS), sensor=Sensor(noise_um=NOISE_UM, resolution_um=0.01)
)


load = Glide(
    "resonance", "f0_hz", FIRST, 1000, low=0.5, high=0.8, lowest=LOWEST_HZ,
    samples=round(GLIDE_S / 1e-4),
)  # fmt: skip
"""A load that is set down: the mode falls to 0.5 to 0.8 of its frequency, never below 300 Hz. It begins
within the first tenth of a second that is scored."""

ageing = Wear(
    gains=-0.15, gaps=0.2,
    effects={"creep": ("gain_per_decade", 1.0), "resonance": ("f0_hz", -0.1)},
)  # fmt: skip
"""A life of a stage: at its end the gains are 15 % smaller (the ceramic has lost polarisation), the
thresholds 20 % wider, creep is twice as large, and the mode 10 % lower (the flexure has cracks). The
sizes are an estimate."""


STAGE = StageTask(
    "Stage",
    "A stage as a laboratory has it",
    "Hysteresis behind an amplifier's lag, creep, a delay of the electronics, a lightly damped mode, "
    "a drift from warming up, and a sensor that rounds. The default of the ranking.",
    (_QUANTISED,),
    hidden=_HIDDEN,
    history=HISTORY,
    rank=50,
)
LOAD = StageTask(
    "Load",
    "A stage that is loaded while it runs",
    "The stage of `PiezoStage-v0` on which something is set down: within 25 ms its mode falls to 0.5 "
    "to 0.8 of what it was, down to 300 Hz, while the reference goes on. What damps or notches the "
    "old mode may make the new one unstable.",
    (_QUANTISED,),
    hidden=f"{_HIDDEN}, and when the load comes",
    history=HISTORY,
    schedule=load,
    rank=60,
)
AGEING = StageTask(
    "Ageing",
    "A stage years after it was identified",
    "The stage of `PiezoStage-v0` some time later: each plant has lived a share of its life, up to "
    "15 % of its gain lost, its thresholds 20 % wider, twice the creep and a mode 10 % lower. The "
    "belief is of the day when it was new.",
    (_QUANTISED,),
    hidden=f"{_HIDDEN}, and the age",
    history=HISTORY,
    ageing=ageing,
    rank=70,
)
ROUGH = StageTask(
    "Rough",
    "A stage on a bad day's instruments",
    "The stage of `PiezoStage-v0` with 16-bit converters on both sides, and a sensor whose noise "
    "wanders below 5 Hz, twice as large as its white part, with hum of the mains three times as "
    "large: who trusts the reading follows its errors.",
    (replace(_QUANTISED, sensor=Sensor(noise_um=NOISE_UM, resolution_um=0.003)),),
    hidden=f"{_HIDDEN}, and the noise's own state",
    history=HISTORY,
    noise=NoiseLaw(white=1.0, wander=2.0, corner_hz=5.0, hum=3.0),
    command_bits=16,
    rank=80,
)
RASTER = StageTask(
    "Raster",
    "Scan lines of an atomic force microscope",
    "The stage of `PiezoStage-v0` on scan lines at 20 to 80 Hz with smooth turn-arounds, even and "
    "with a fast way back. The same line comes again and again.",
    (_QUANTISED,),
    hidden=_HIDDEN,
    history=HISTORY,
    references=(
        {"signal": "raster", "frequency_hz": 20.0, "turnaround_fraction": 0.1},
        {"signal": "raster", "frequency_hz": 40.0, "turnaround_fraction": 0.2},
        {"signal": "raster", "frequency_hz": 80.0, "turnaround_fraction": 0.3},
        {
            "signal": "raster",
            "frequency_hz": 20.0,
            "trace_fraction": 0.75,
            "turnaround_fraction": 0.15,
        },
    ),
    rank=90,
)
STEPS = StageTask(
    "Steps",
    "Steps, as a positioner makes them",
    "The stage of `PiezoStage-v0` on levels held for 25 ms, with ways of 1.5 to 5 ms between them: the "
    "shorter they are, the more they excite the mode, and 1.5 ms takes nearly all of the range.",
    (_QUANTISED,),
    hidden=_HIDDEN,
    history=HISTORY,
    references=(
        {"signal": "random-steps", "hold_s": 0.025, "rise_s": 0.0015},
        {"signal": "random-steps", "hold_s": 0.025, "rise_s": 0.0025},
        {"signal": "random-steps", "hold_s": 0.025, "rise_s": 0.005},
        {"signal": "steps", "hold_s": 0.025, "rise_s": 0.002},
    ),
    rank=100,
)

PiezoStageEnv, stage_vector = environments_of(STAGE, __name__)
PiezoLoadEnv, load_vector = environments_of(LOAD, __name__)
PiezoAgeingEnv, ageing_vector = environments_of(AGEING, __name__)
PiezoRoughEnv, rough_vector = environments_of(ROUGH, __name__)
PiezoRasterEnv, raster_vector = environments_of(RASTER, __name__)
PiezoStepsEnv, steps_vector = environments_of(STEPS, __name__)
