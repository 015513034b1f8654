"""Fingerprints: whether a stored row still says what the code, the plant and the controller do."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import baselines
from baselines import CONTROLLERS, FULL_PREVIEW, HORIZON_BOUND, LEARNED
from baselines.tuning import TUNED
from benchmarks.tracking.controllers import is_learned, policy_bytes
from benchmarks.tracking.stages import SUITE_VERSION
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.fingerprint import code_parts, fingerprint, room_files, used_files

# What a score depends on; the tables and pages made of scores are not among it.
_ROOMS = ("plant", "signals", "envs")
_SCORING = ("case.py", "references/*.py", "stages.py", "scoring.py", "episode.py", "run.py")
_BASELINES = Path(baselines.__file__).parent
_BOUNDS = {FULL_PREVIEW: baselines.FullPreviewInversion, HORIZON_BOUND: baselines.TrueHorizon}


@cache
def code_fingerprint(controller: str, folder: Path = _BASELINES) -> str:
    """Return a hash of the suite's version and of the source that a controller's scores depend on.

    Of the controllers, whose package is in a folder, that is what the files of this one import at
    any remove, with its committed settings; all, where its name does not say which these are.
    """
    kinds = _kinds(controller)
    modules = _modules(controller, kinds)
    own = [*folder.glob("**/*.py")] if modules is None else used_files(modules, folder)
    names = None if modules is None else {getattr(kind, "name", "") for kind in kinds}
    tuned = [path for path in sorted(TUNED.glob("*.json")) if names is None or path.stem in names]
    parts = [path.read_bytes() for path in tuned]
    return fingerprint([str(SUITE_VERSION).encode(), *_scoring(), *code_parts(own), *parts])


@cache
def _scoring() -> list[bytes]:
    """Code that every score depends on."""
    files = room_files(*_ROOMS)
    files += [file for name in _SCORING for file in Path(__file__).parent.glob(name)]
    return code_parts(files)


def _kinds(controller: str) -> list[Any]:
    """Classes of this package that a name stands for, or that the description of a policy names."""
    if controller in _BOUNDS:
        return [_BOUNDS[controller]]
    names = [controller]
    if is_learned(controller):
        names = [*_texts(json.loads(policy_bytes(controller) or b"null"))]
    found = [CONTROLLERS[name] for name in names if name in CONTROLLERS]
    return [
        kind
        for made in found
        for kind in ((made.func, *made.keywords.values()) if isinstance(made, partial) else (made,))
    ]


def _modules(controller: str, kinds: list[Any]) -> list[str] | None:
    """Modules in which a controller is defined; None where its name does not say."""
    own = [kind.__module__ for kind in kinds]
    if is_learned(controller):  # a monitor hands over to whatever its own file says
        return [*own, "baselines.learned.controller"] if controller.startswith(LEARNED) else None
    return own or None


def _texts(document: object) -> Iterator[str]:
    """All texts in a JSON document."""
    if isinstance(document, str):
        yield document
    elif isinstance(document, dict | list):
        for each in document.values() if isinstance(document, dict) else document:
            yield from _texts(each)


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
