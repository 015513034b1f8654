"""Options that trainings share, and the folder of a training: options, learning curve, continuation."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from baselines.learned.settings import SHIPPED, Settings, read_settings
from rdpi_gym.envs.layout import ActionMode
from rdpi_gym.envs.truth import ReferenceChoice, choose_plant
from rdpi_gym.plant import P10, PlantModel, Sensor, check_ts
from rdpi_gym.plant.effects.actuator_lag import ActuatorLag
from rdpi_gym.plant.effects.creep import Creep
from rdpi_gym.plant.effects.resonance import Resonance
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json, read_utf8, write_json

_LAG, _CREEP = ActuatorLag(time_constant_s=2e-4), Creep(gain_per_decade=0.015)
# The mode of the stage that the effect's file cites.
_MODE = Resonance(f0_hz=739.0, damping=0.03)
_NOISY = replace(P10, sensor=Sensor(noise_um=0.01))

PLANTS = (
    replace(_NOISY, name="P10 with lag, creep and resonance", effects=(_LAG, _CREEP, _MODE)),
    replace(_NOISY, name="P10 with lag and creep", effects=(_LAG, _CREEP)),
    replace(_NOISY, name="P10 with creep and resonance", effects=(_CREEP, _MODE)),
    replace(_NOISY, name="P10 with noise"),
)
"""Plants of a training: the paper's plant with a noisy sensor, behind an amplifier, with
creep and a mode. An agent that has only met all of them dithers where one is missing."""

PHASES = 10
"""Groups of lanes whose episodes begin at other times, so that a rollout sees all of an episode."""

_FEWEST, _MOST = 4.0, 1e6  # samples of a period

REFERENCES: tuple[ReferenceChoice, ...] = (
    "sine",
    "triangle",
    {"signal": "multisine", "frequency_hz": 20.0, "lines": 5},
)


class DivergedError(InputError):
    """A training whose weights have become useless; another learning rate may do."""


@dataclass(frozen=True)
class TrainingOptions:
    """Options of a training; the comment under each says what it does.

    Raises
    ------
    InputError
        A value that nothing can be trained with.
    """

    out: Path = Path("results/train")
    # Folder of the run. The same options with the same folder continue an interrupted run.
    seed: int = 0
    # Of weights, exploration, plants, references and noise: the same seed, the same run.
    timesteps: int | None = None
    # Steps of all lanes together; None: `n_timesteps` of the hyper-parameters.
    lanes: int | None = None
    # Plants side by side; None: `n_envs` of the hyper-parameters.
    hyperparameters: Path | None = None
    # YAML as rl-baselines3-zoo reads it; None: the file of this release for the algorithm.
    every: int | None = None
    # Steps between evaluations, each with a checkpoint; None: a twentieth of all.
    tensorboard: bool = False
    # Whether TensorBoard's logs are written, in the folder `tensorboard`.
    threads: int = 1
    # Threads of torch. Networks this small gain nothing from more, and their number may show in
    # the last digits.

    plants: tuple[str | PlantModel, ...] = PLANTS
    # Nominal truths, each with a part of the lanes: names, paths of JSON files, or plants.
    belief: str | PlantModel | None = None
    # What the baseline believes; None: the plant without its effects.
    randomise: float = 0.05
    # Relative half-width of weights, thresholds and δ2, drawn for each episode.
    randomise_effects: float = 0.4
    # The same of the parameters of the plant's effects.
    reference: tuple[ReferenceChoice, ...] = REFERENCES
    # One is drawn for each episode.
    frequency_hz: tuple[float, float] = (20.0, 100.0)
    # Lowest and highest, for references that are given without one.
    ts_s: float = 1e-4
    # Sampling time (s).
    episode: int = 500
    # Samples of an episode.
    preview: int = 8
    # Samples of the reference that are shown ahead.
    action: ActionMode = "correction"
    # How actions are read: "command", "increment" or "correction".
    baseline: str = "classical-reference-rate"
    # What is corrected; with another reading of actions, what the agent is compared with.
    action_scale_V: float | None = None
    # Command (V) of an action of 1; None: 5 % of the range.
    command_cost: float = 0.5
    # Price of a command change over the whole range, beside errors in amplitudes.

    def __post_init__(self) -> None:
        for name in ("timesteps", "lanes", "every", "threads", "episode"):
            value = getattr(self, name)
            if value is not None and (type(value) is not int or value < 1):
                raise InputError(f"{name} is {value!r}; give a whole number of 1 or more")
        if not self.plants:
            raise InputError("no plant; give at least one")
        if type(self.seed) is not int or not 0 <= self.seed < 2**32:
            raise InputError(f"seed is {self.seed!r}; give a whole number of 0 to 2^32 - 1")
        ts, (low, high) = check_ts(self.ts_s), self.frequency_hz
        ordered = 0.0 < low <= high  # or refused, with its reason, by the environment
        if ordered and not (1.0 / (high * ts) >= _FEWEST and 1.0 / (low * ts) <= _MOST):
            raise InputError(
                f"ts_s is {ts:g} s: periods of {low:g} to {high:g} Hz have {1.0 / (low * ts):.3g} to "
                f"{1.0 / (high * ts):.3g} samples; give a ts_s with which they have {_FEWEST:g} to {_MOST:g}"
            )

    def file(self, algorithm: str) -> Path:
        """Hyper-parameters of an algorithm: those that are asked for, or of this release."""
        return self.hyperparameters or SHIPPED / f"{algorithm}.yml"

    @property
    def models(self) -> tuple[PlantModel, ...]:
        """The nominal truths."""
        return tuple(choose_plant(plant) for plant in self.plants)

    def environment(self) -> dict[str, Any]:
        """Keyword arguments of the environment in which is trained, the plant aside."""
        correcting = self.action == "correction"
        return self.world() | {
            "action": self.action,
            "action_scale_V": self.action_scale_V,
            "baseline": self.baseline if correcting else None,
        }

    def world(self) -> dict[str, Any]:
        """Those of an environment whose actions are commands."""
        return {
            "belief": None if self.belief is None else choose_plant(self.belief),
            "randomise": self.randomise,
            "randomise_effects": self.randomise_effects,
            "reference": list(self.reference),
            "frequency_hz": self.frequency_hz,
            "ts_s": self.ts_s,
            "preview": self.preview,
            "command_cost": self.command_cost,
        }

    def document(self) -> dict[str, Any]:
        """All that the result depends on, as JSON holds it: the folder and logs are left out."""
        left_out = ("out", "tensorboard", "hyperparameters")
        kept = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in left_out}
        belief = None if self.belief is None else choose_plant(self.belief).to_dict()
        return kept | {
            "plants": [model.to_dict() for model in self.models],
            "belief": belief,
            "reference": [_written(choice) for choice in self.reference],
            "frequency_hz": list(self.frequency_hz),
        }


def _written(choice: ReferenceChoice) -> Any:
    if isinstance(choice, str):
        return choice
    return dict(choice) if isinstance(choice, dict) else repr(choice)


FORMAT, VERSION = "rdpi-training", 1
CONFIG, CURVE, POLICY, CHECKPOINT = "config.json", "training.csv", "policy", "checkpoint"
COLUMNS = (
    "timesteps", "seconds", "training_reward", "reward", "rmse_um", "rmse_percent",
    "command_variation_V_s", "compensator_rmse_um", "compensator_rmse_percent",
    "compensator_command_variation_V_s",
)  # fmt: skip
"""Columns of ``training.csv``: all but the second and third are of the held-out plants."""
_LARGEST_CURVE = 2**26  # bytes

Row = dict[str, float | None]


def check_folder(out: Path, document: Mapping[str, Any]) -> None:
    """Check that a folder is new, or holds a training with the same options; nothing is written."""
    config = out / CONFIG
    if config.exists():
        check_same(read_json(config, FORMAT, VERSION), document, out)
    elif any((out / name).exists() for name in (CURVE, POLICY, CHECKPOINT)):
        raise InputError(f"{out} holds results without {CONFIG}; give another folder for --out")
    elif out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; give a folder for --out")


def begin_folder(out: Path, document: dict[str, Any]) -> None:
    """Write ``config.json`` where there is none."""
    if not (out / CONFIG).exists():
        write_json(out / CONFIG, document)


def curve_text(rows: Sequence[Row]) -> str:
    """Return ``training.csv``."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def read_curve(out: Path) -> list[dict[str, float]]:
    """Read ``training.csv`` of a folder, one row an evaluation; NaN where there is no number."""
    text = read_utf8(out / CURVE, _LARGEST_CURVE)
    rows = list(csv.DictReader(io.StringIO(text)))
    try:
        found = [{name: float(row[name] or "nan") for name in COLUMNS} for row in rows]
    except (KeyError, ValueError, TypeError):
        found = []
    if not found:
        raise InputError(f"{out / CURVE} is no curve of a training; train again in another folder")
    return found


def check_same(
    found: Mapping[str, Any], asked: Mapping[str, Any], out: Path, what: str = "training"
) -> None:
    """Refuse to go on in a folder of other options, and name the first that differs."""
    before, now = _flat(found), _flat(json.loads(json.dumps(asked)))
    for name in [*now, *before]:
        if before.get(name) != now.get(name):
            raise InputError(
                f"{out} holds a {what} with {name} {before.get(name)!r}, asked for is "
                f"{now.get(name)!r}; give another folder for --out, or the options of that one"
            )


def _flat(document: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in document.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            flat[prefix + name] = value
    return flat


@dataclass(frozen=True)
class Run:
    """A training in its folder."""

    options: TrainingOptions  # what was asked for
    settings: Settings  # its hyper-parameters
    algorithm: str  # Name, as on the command line
    timesteps: int
    every: int  # steps in all, and of a stretch
    libraries: tuple[str, ...]  # distributions whose versions the result depends on

    @classmethod
    def open(
        cls,
        options: TrainingOptions,
        name: str,
        algorithm: Callable[..., Any],
        samples: int = 0,
    ) -> Run:
        """Read the hyper-parameters, and see that the folder is new or was of the same options."""
        settings = read_settings(options.file(name), algorithm)
        timesteps = options.timesteps or settings.timesteps
        package = algorithm.__module__.partition(".")[0]
        libraries = ("torch", "numpy") if package == "baselines" else (package, "torch", "numpy")
        least = samples * (options.lanes or settings.lanes)
        every = options.every or max(-(-timesteps // 20), least)
        run = cls(options, settings, name, timesteps, every, libraries)
        check_folder(options.out, run.document())
        return run

    def document(self) -> dict[str, Any]:
        """All that the result depends on: what ``config.json`` says."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "algorithm": self.algorithm,
            "timesteps": self.timesteps,
            "every": self.every,
            "lanes": self.options.lanes or self.settings.lanes,
            "options": self.options.document(),
            "hyperparameters": asdict(self.settings),
            "versions": {name: version(name) for name in self.libraries},
        }
