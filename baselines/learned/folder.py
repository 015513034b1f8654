"""Training folder: options, learning curve, and continuation with the same options alone."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from baselines.learned.options import TrainingOptions
from baselines.learned.settings import Settings, read_settings
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json, read_utf8, write_json

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

    options: TrainingOptions
    # What was asked for.
    settings: Settings
    # Its hyper-parameters.
    algorithm: str
    # Name, as on the command line.
    timesteps: int
    every: int
    # Steps in all, and of a stretch.
    libraries: tuple[str, ...]
    # Distributions whose versions the result depends on.

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
