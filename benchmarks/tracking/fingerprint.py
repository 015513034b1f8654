"""Fingerprints: whether a stored row still says what the code, the plant and the controller do."""

from __future__ import annotations

import json
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import baselines
from benchmarks.tracking.learned import is_learned, policy_bytes
from benchmarks.tracking.suite import SUITE_VERSION
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.fingerprint import code_parts, fingerprint, room_files

# What a score depends on; the tables and pages made of scores are not among it.
_ROOMS = ("plant", "signals", "envs")
_SCORING = ("case.py", "references/*.py", "stages.py", "scoring.py", "episode.py", "tasks.py")


@cache
def code_fingerprint() -> str:
    """Return a hash of the suite's version and of every source file that a score depends on."""
    files = room_files(*_ROOMS)
    files += Path(baselines.__file__).parent.glob("**/*.py")
    files += [file for name in _SCORING for file in Path(__file__).parent.glob(name)]
    return fingerprint([str(SUITE_VERSION).encode(), *code_parts(files)])


def task_fingerprint(controller: str, plant: PlantModel, believed: PlantModel | None = None) -> str:
    """Return a hash of a plant's content and of a policy's, or of the source of ``module:attribute``.

    `believed` is what the controller is told of the plant where that is another one.

    What else a module of your own reads is not seen: give another folder for results after a change
    of that.
    """
    models = [plant] if believed is None else [plant, believed]
    parts = [json.dumps(model.to_dict(), sort_keys=True).encode() for model in models]
    parts.append(controller.encode())
    if is_learned(controller):
        parts.append(policy_bytes(controller))
    elif ":" in controller:
        spec = find_spec(controller.partition(":")[0])
        if spec is not None and spec.origin and Path(spec.origin).is_file():
            parts.append(Path(spec.origin).read_bytes())
    return fingerprint(parts)
