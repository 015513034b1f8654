"""The folder of a training: what lies in it, and that a run goes on only with the same options."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json, read_utf8, write_json

FORMAT, VERSION = "rdpi-training", 1
CONFIG, CURVE, POLICY, CHECKPOINT = "config.json", "training.csv", "policy", "checkpoint"
COLUMNS = (
    "timesteps", "seconds", "training_reward", "reward", "rmse_um", "rmse_percent",
    "command_variation_V_s", "compensator_rmse_um", "compensator_rmse_percent",
    "compensator_command_variation_V_s",
)  # fmt: skip
"""Of ``training.csv``: all but the second and third are of the held-out plants."""
_LARGEST_CURVE = 2**26  # bytes

Row = dict[str, float | None]


def check_folder(out: Path, document: Mapping[str, Any]) -> None:
    """See that a folder is new, or holds a training with the same options; nothing is written."""
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
