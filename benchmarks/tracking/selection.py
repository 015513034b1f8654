"""What a user asks the benchmark for, checked before anything runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from inspect import isfunction, signature
from pathlib import Path

from baselines import CONTROLLERS, ORACLE, inverts_effects
from benchmarks.tracking.learned import is_learned, shipped_policies, trained_at_s
from benchmarks.tracking.stages import Stage, make_stage
from benchmarks.tracking.suite import FEWEST_SAMPLES, MOST_SAMPLES, REFERENCES, SEEDS
from rdpi_gym.plant import PLANTS, PlantModel, check_ts, find_plant
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.plugins import load_attribute

DEFAULT_PLANTS = ("P5", "P10", "picma")


@dataclass(frozen=True)
class Selection:
    """What is asked for.

    Parameters
    ----------
    controllers
        Names of ``baselines.CONTROLLERS``, ``learned:`` and a policy, or ``module:attribute``.
    stages
        Plants, each with its sampling times.
    references
        Names of :data:`~benchmarks.tracking.suite.REFERENCES`.
    seeds
        Seeds; 0 is the nominal plant.
    notes
        What was left out, one sentence each.
    """

    controllers: tuple[str, ...]
    stages: tuple[Stage, ...]
    references: tuple[str, ...]
    seeds: tuple[int, ...]
    notes: tuple[str, ...] = ()


def select(
    controllers: Sequence[str] | None = None,
    plants: Sequence[str | PlantModel] | None = None,
    references: Sequence[str] | None = None,
    ts_s: Sequence[float] | None = None,
    seeds: Sequence[int] = tuple(range(SEEDS)),
    *,
    own_controllers: Sequence[str] = (),
    own_plants: Sequence[str] = (),
) -> Selection:
    """Check what is asked for; None is all of it.

    Parameters
    ----------
    controllers, plants, references
        Names; a plant may also be itself.
    ts_s
        Sampling times (s); by default those that suit each plant, and those of learned controllers.
    seeds
        Seeds; 0 is the nominal plant.
    own_controllers, own_plants
        Further ones, ``module:attribute``; a controller also as ``learned:`` and the folder or name
        of a policy, a plant also by the path of its JSON file.

    Raises
    ------
    InputError
        An unknown name, a policy that cannot be read, a sampling time that is not above zero, or no
        case that suits them.

    Examples
    --------
    >>> select(["none"], ["P5"], ["sine"], [1e-3], [0]).stages[0].plant.name
    'P5'
    """
    asked = [*(DEFAULT_PLANTS if plants is None else plants), *own_plants]
    models = [
        asked_for if isinstance(asked_for, PlantModel) else _plant(asked_for)
        for i, asked_for in enumerate(asked)
        if asked_for not in asked[:i]
    ]
    notes: tuple[str, ...] = ()
    if controllers is None:
        shipped, notes = shipped_policies()
        with_effects = any(model.effects for model in models)
        controllers = [name for name in CONTROLLERS if with_effects or not inverts_effects(name)]
        controllers += [ORACLE, *shipped]
    names = tuple(dict.fromkeys((*controllers, *own_controllers)))
    for name in names:
        if ":" not in name:
            _known(name, "controller", (*CONTROLLERS, ORACLE), "module:attribute")
    wanted = tuple(dict.fromkeys(references if references is not None else REFERENCES))
    for name in wanted:
        _known(name, "reference", REFERENCES)
    times = None if ts_s is None else [check_ts(ts) for ts in dict.fromkeys(ts_s)]
    doubled = {m.name for m in models if [other.name for other in models].count(m.name) > 1}
    if doubled:
        raise InputError(
            f"two different plants are named {doubled.pop()!r}; give one of them another name"
        )
    own_s = trained_at_s(names)
    stages = tuple(_with_times(make_stage(m, times), own_s if ts_s is None else []) for m in models)
    selection = Selection(names, stages, wanted, tuple(seeds), notes)
    if not (names and wanted and models and seeds):
        raise InputError(
            "nothing to score; give at least one controller, plant, reference and seed"
        )
    if not any(s.cases(wanted, ts) for s in selection.stages for ts in s.ts_s):
        raise InputError(
            f"no reference among {', '.join(wanted)} suits these sampling times: a period must have "
            f"{FEWEST_SAMPLES} to {MOST_SAMPLES} samples; give another --ts, for example 2e-4"
        )
    for name in names:
        if ":" in name and not is_learned(name):
            found = load_attribute(name, "controller")
            if not (callable(found) or callable(getattr(found, "predict", None))):
                raise InputError(
                    f"{name!r} is {type(found).__name__}; give a callable (belief, layout) that returns "
                    "a controller"
                )
    return selection


def _with_times(stage: Stage, ts_s: Sequence[float]) -> Stage:
    """Add the sampling times of policies between those that suit a plant: they run at no other."""
    low, high = min(stage.ts_s), max(stage.ts_s)
    added = {ts for ts in ts_s if low <= ts <= high}
    return replace(stage, ts_s=tuple(sorted({*stage.ts_s, *added}))) if added else stage


def _known(name: str, what: str, known: Iterable[str], otherwise: str = "") -> None:
    if name in known:
        return
    close = get_close_matches(name, list(known), 1)
    guess = f"did you mean {close[0]!r}? " if close else ""
    more = f", or {otherwise}" if otherwise else ""
    raise InputError(f"no {what} is named {name!r}; {guess}known are {', '.join(known)}{more}")


def _plant(name: str) -> PlantModel:
    if name in PLANTS:
        return find_plant(name)
    if Path(name).suffix == ".json" or Path(name).exists():
        return PlantModel.load(name)
    if ":" not in name:
        _known(name, "plant", PLANTS, "the path of a plant's JSON file, or module:attribute")
    built = load_attribute(name, "plant")
    if isfunction(built) and not signature(built).parameters:
        built = built()
    if not isinstance(built, PlantModel):
        raise InputError(
            f"{name!r} is {type(built).__name__}; give a rdpi_gym.plant.PlantModel, or a function without arguments that returns one"
        )
    return built
