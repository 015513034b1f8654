"""From a model and a controller's name to what an export writes, and back from what it wrote."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from baselines.lookup import GUARDED, LEARNED
from baselines.registry import known_controller
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.firmware.controllers import ControllerTwin, controller_program
from rdpi_gym.firmware.fixed_point import FixedPoint, fixed_point_body
from rdpi_gym.firmware.plants import plant_program
from rdpi_gym.firmware.program import Program
from rdpi_gym.firmware.writing.package import Package
from rdpi_gym.firmware.writing.source import Source
from rdpi_gym.plant import Plant, PlantModel
from rdpi_gym.plant.packing import check_ts
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted, some

_WALK = 400
"""Commands of the slow walk that says what a range reaches."""


def program_of(
    model: PlantModel[Any], ts_s: float, controller: str | None = None, preview: int | None = None
) -> Program:
    """Return a plant, or a controller that believes in it, as a program."""
    check_ts(ts_s)
    if controller is None:
        if preview is not None:
            raise InputError("preview is of controllers; leave it out, or name one")
        return plant_program(model, ts_s)
    if not controller.startswith((LEARNED, GUARDED)):
        kind = known_controller(controller)
        if hasattr(getattr(kind, "func", kind), "plan"):
            raise InputError(
                f"{controller} plans over the whole reference before an episode, which code that runs "
                "sample by sample does not have; name another, such as pi-classical-reference-rate"
            )
    if preview is not None:
        # the layout's own words, before anything is traced
        ObservationLayout.for_plant(model, ts_s, preview)
    return controller_program(controller, model, ts_s, preview)


def package_of(
    model: PlantModel[Any], ts_s: float, controller: str | None = None, preview: int | None = None
) -> Package:
    """Return what an export of :func:`program_of` writes."""
    program = program_of(model, ts_s, controller, preview)
    recipe: dict[str, Any] = {
        "kind": program.kind,
        "model": model.to_dict(),
        "ts_s": program.ts_s,
        "exact": program.exact,
    }
    if program.kind == "plant":
        return Package(Source(program), recipe)
    recipe |= {"controller": _found_anywhere(controller or ""), "preview": program.preview}
    fixed, why = _fixed(program)
    said = program.twin.made.warning() if isinstance(program.twin, ControllerTwin) else None
    notes, warnings = (() if each is None else (each,) for each in (why, said))
    return Package(Source(program, reach_um(model, ts_s), fixed), recipe, warnings, notes)


def package_again(document: Mapping[str, Any], source: str) -> Package:
    """Return the package that a ``program.json`` describes."""
    known = {"format", "version", "kind", "model", "ts_s", "exact", "controller", "preview"}
    if others := [key for key in document if key not in known]:
        raise InputError(
            f"{source} has the unknown key {quoted(others[0])}; known are {some(known)}"
        )
    kind, controller, preview = (document.get(key) for key in ("kind", "controller", "preview"))
    is_plant = kind == "plant" and controller is None and preview is None
    if not is_plant and not (kind == "controller" and isinstance(controller, str)):
        raise InputError(f"{source} describes neither a plant nor a controller; export it anew")
    model = PlantModel.from_dict(_object(document.get("model"), source), f"{source}, model")
    return package_of(model, document.get("ts_s", math.nan), controller, preview)


def reach_um(model: PlantModel[Any], ts_s: float) -> tuple[float, float]:
    """Return the displacements (µm) that the ends of a command range reach after a slow walk.

    Effects are left out; a drift has no end.
    """
    low, high = model.command_range_V
    rest = min(max(0.0, low), high)
    ends = (rest, low, high)
    walk = np.concatenate([np.linspace(a, b, _WALK) for a, b in pairwise(ends)])
    plant = Plant(replace(model, effects=()), ts_s)
    found = plant.simulate_given(walk, np.zeros_like(walk))
    reached = float(found[_WALK - 1]), float(found[-1])
    if not all(map(math.isfinite, reached)):
        centre, scale = model.reference_um
        return centre - scale, centre + scale
    return min(reached), max(reached)


def _fixed(program: Program) -> tuple[FixedPoint | None, str | None]:
    """Return the form on whole numbers, or why there is none."""
    if not isinstance(program.twin, ControllerTwin) or not hasattr(program.twin.made, "name"):
        return None, None  # a plant, or a policy
    try:
        return fixed_point_body(program.twin.made), None
    except InputError as error:
        return None, f"No form on whole numbers: {error}"


def _found_anywhere(controller: str) -> str:
    """Return a controller's name, the folder of a policy written from the root."""
    prefix, sign, folder = controller.rpartition(":")
    return (
        f"{prefix}{sign}{Path(folder).absolute()}" if sign and Path(folder).is_dir() else controller
    )


def _object(value: Any, source: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{source} has no model; export it anew")
    return value
