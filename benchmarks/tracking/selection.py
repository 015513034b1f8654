"""Selection of controllers, plants and references, checked before anything runs."""

from __future__ import annotations

import math
import traceback
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from inspect import isfunction, signature
from pathlib import Path

import numpy as np

from baselines import (
    CONTROLLERS,
    FULL_PREVIEW,
    ControllerFactory,
    find_factory,
    inverts_any_core,
    inverts_effects,
    make_controller,
    needed_core,
)
from benchmarks.tracking.case import FEWEST_SAMPLES, MOST_SAMPLES
from benchmarks.tracking.controllers import (
    Made,
    is_learned,
    read_policy,
    shipped_policies,
)
from benchmarks.tracking.episode import one_line
from benchmarks.tracking.stages import REFERENCES, SEEDS, Stage, make_stage
from rdpi_gym.envs import ObservationLayout, TrackingTask
from rdpi_gym.plant import PLANTS, PlantModel, check_ts, find_plant
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.plugins import load_attribute
from rdpi_gym.support.words import guess

_SAMPLES, _LANES = 5, 2


def try_controller(name: str, stage: Stage, factory: ControllerFactory | None = None) -> None:
    """Run a controller for a few samples of two episodes, and see that it controls."""
    ts_s, belief = min(stage.every_ts_s), stage.belief
    try:
        usual = ObservationLayout.for_plant(stage.plant, ts_s)
        layout = stage.layout(ts_s, make_controller(factory or name, belief, usual))
        layout = factory.layout if isinstance(factory, Made) else layout
        controller = make_controller(factory or name, belief, layout)
        reference = np.full((_SAMPLES, _LANES), stage.rest_um)
        if hasattr(controller, "plan"):
            controller.plan(reference)
        task = TrackingTask([stage.plant] * _LANES, layout)
        observation = task.reset(reference, [np.random.default_rng(0)] * _LANES)
        state, starts = None, np.ones(_LANES, dtype=bool)
        for _ in range(_SAMPLES - 1):
            answer = controller.predict(observation, state, starts, deterministic=True)
            if not (isinstance(answer, tuple) and len(answer) == 2):
                raise InputError(f"its predict returns {_named(answer)}; give (action, state)")
            action, state = answer
            observation = task.step(layout.place_to_V(np.clip(_checked(action), -1.0, 1.0)))
            starts = np.zeros(_LANES, dtype=bool)
    except InputError as error:
        text = str(error)
        raise InputError(text if repr(name) in text else f"{name!r}: {text}") from error
    except Exception as error:  # a user's controller may raise anything
        where = traceback.extract_tb(error.__traceback__)[-1]
        raise InputError(
            f"{name!r} raises {one_line(f'{type(error).__name__}: {error}')} "
            f"({Path(where.filename).name}, line {where.lineno})"
        ) from error


def _checked(action: object) -> np.ndarray:
    try:
        numbers = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"its action is {_named(action)}; give an array of numbers") from None
    if numbers.shape not in ((_LANES, 1), (_LANES,)):
        raise InputError(
            f"it answers {_LANES} observations with an action of shape {numbers.shape}; give ({_LANES}, 1)"
        )
    if not np.isfinite(numbers).all():
        raise InputError("its action is not finite; give numbers from -1 to 1")
    return numbers.reshape(_LANES)


def _named(value: object) -> str:
    return "None" if value is None else f"a {type(value).__name__}"


DEFAULT_PLANTS = ("P5", "P10", "picma")


@dataclass(frozen=True)
class Selection:
    """Controllers, plants, references and seeds to score."""

    # names of ``baselines.CONTROLLERS``, ``learned:`` and a policy, or ``module:attribute``
    controllers: tuple[str, ...]
    stages: tuple[Stage, ...]  # plants, each with its sampling times
    references: tuple[str, ...]  # names of :data:`~benchmarks.tracking.stages.REFERENCES`
    seeds: tuple[int, ...]  # seeds; 0 is the nominal plant
    notes: tuple[str, ...] = ()  # what was left out, one sentence each
    # the sampling time (s) of each trained policy among the controllers, and of each that was
    # made already: it runs at no other
    trained_s: Mapping[str, float] = field(default_factory=dict)
    # what makes a controller whose name does not say
    factories: Mapping[str, ControllerFactory] = field(default_factory=dict)

    def runs_at(self, controller: str, stage: Stage, ts_s: float) -> bool:
        """Whether a controller runs on a plant at one of its sampling times (s)."""
        own = self.trained_s.get(controller, ts_s)
        return (
            ts_s in stage.every_ts_s and math.isclose(own, ts_s) and self.suits(controller, stage)
        )

    def suits(self, controller: str, stage: Stage) -> bool:
        """Whether a controller can be made with what is believed of a plant."""
        return controller in self.factories or stage.has_core(self.needed_core(controller))

    def needed_core(self, controller: str) -> type[Core] | None:
        """Return the kind of hysteresis core that a controller needs in its belief; None: any."""
        if controller in self.trained_s and is_learned(controller):
            return needed_core(read_policy(controller).baseline or "")
        return needed_core(controller)

    def is_ranked(self, controller: str) -> bool:
        """Whether a controller runs in all cases of the ranking."""
        return all(
            self.runs_at(controller, stage, ts) for stage in self.stages for ts in stage.ts_s
        )


def select(
    controllers: Sequence[str] | None = None,
    plants: Sequence[str | PlantModel] | None = None,
    references: Sequence[str] | None = None,
    ts_s: Sequence[float] | None = None,
    seeds: Sequence[int] = tuple(range(SEEDS)),
    *,
    own_controllers: Sequence[str] = (),
    own_plants: Sequence[str | PlantModel] = (),
    belief: str | PlantModel | None = None,
    factories: Mapping[str, ControllerFactory] | None = None,
) -> Selection:
    """Check what is asked for; None is all of it."""
    usual = DEFAULT_PLANTS if belief is None else ()
    asked = [*(usual if plants is None else plants), *own_plants]
    models = [
        each if isinstance(each, PlantModel) else _plant(each)
        for i, each in enumerate(asked)
        if each not in asked[:i]
    ]
    if belief is not None and len(models) != 1:
        raise InputError(
            f"{len(models)} plants and a belief; give the one plant that it is believed of"
        )
    believed = _plant(belief) if isinstance(belief, str) else belief
    beliefs = models if believed is None else [believed]
    notes: tuple[str, ...] = ()
    factories = dict(factories or {})
    requested = {*own_controllers, *factories, *(controllers or ())}
    if controllers is None:
        shipped, notes = shipped_policies()
        with_effects = any(model.effects for model in beliefs)
        inverted = tuple(kind for kind in map(needed_core, CONTROLLERS) if kind is not None)
        with_cores = any(not isinstance(model.hysteresis, inverted) for model in beliefs)
        suited = (
            name
            for name in CONTROLLERS
            if (with_effects or not inverts_effects(name))
            and (with_cores or not inverts_any_core(name))
        )
        controllers = [*suited, FULL_PREVIEW, *shipped]
    names = tuple(dict.fromkeys((*controllers, *own_controllers, *factories)))
    own = [name for name in names if name not in CONTROLLERS and name != FULL_PREVIEW]
    for name in own:
        if not is_learned(name) and name not in factories:
            find_factory(name)
    wanted = tuple(dict.fromkeys(references if references is not None else REFERENCES))
    for name in wanted:
        _known(name, "reference", REFERENCES)
    times = None if ts_s is None else [check_ts(ts) for ts in dict.fromkeys(ts_s)]
    doubled = {m.name for m in models if [other.name for other in models].count(m.name) > 1}
    if doubled:
        raise InputError(
            f"two different plants are named {doubled.pop()!r}; give one of them another name"
        )
    if not (names and wanted and models and seeds):
        raise InputError(
            "nothing to score; give at least one controller, plant, reference and seed"
        )
    # a policy runs at the sampling time of its training alone
    trained = {name: read_policy(name).layout.ts_s for name in own if is_learned(name)}
    trained |= {name: f.layout.ts_s for name, f in factories.items() if isinstance(f, Made)}
    stages = tuple(make_stage(model, times, believed) for model in models)
    if times is None:
        alone = set(names) <= {*trained, FULL_PREVIEW}
        stages = _with_trained(stages, sorted(set(trained.values())), alone)
    selection = Selection(names, stages, wanted, tuple(seeds), notes, trained, factories)
    selection = _without_idle(_without_unsuited(selection, requested), requested)
    if not any(s.cases(wanted, ts) for s in selection.stages for ts in s.ts_s):
        raise InputError(
            f"no reference among {', '.join(wanted)} suits these sampling times: a period must have "
            f"{FEWEST_SAMPLES} to {MOST_SAMPLES} samples; give another --ts, for example 2e-4"
        )
    for name in own:
        if not is_learned(name):
            try_controller(name, selection.stages[0], factories.get(name))
    return selection


def _with_trained(stages: Sequence[Stage], ts_s: Sequence[float], alone: bool) -> tuple[Stage, ...]:
    """Add the sampling times (s) of policies, beside the ranking's or, for policies alone, as its."""
    suiting = [(stage, tuple(ts for ts in ts_s if stage.suits(ts))) for stage in stages]
    if alone and any(times for _, times in suiting):
        return tuple(replace(stage, ts_s=times) for stage, times in suiting if times)
    return tuple(replace(stage, trained_ts_s=times) for stage, times in suiting)


def _without_unsuited(selection: Selection, requested: set[str]) -> Selection:
    """Leave out controllers of another hysteresis core than any belief's; one asked for is an error."""
    cores = ", ".join(dict.fromkeys(s.belief.hysteresis.name for s in selection.stages))
    unsuited: dict[str, list[str]] = {}
    for name in selection.controllers:
        needed = selection.needed_core(name)
        if needed is None or any(selection.suits(name, stage) for stage in selection.stages):
            continue
        if name in requested:
            raise InputError(
                f"{name} inverts the core {needed.name}, and the core that is believed of the plant is "
                f"{cores}; core-inverse inverts any"
            )
        unsuited.setdefault(needed.name, []).append(name)
    return _without(
        selection,
        {
            f"Left out, since they invert the core {core} and the belief has {cores}": names
            for core, names in unsuited.items()
        },
    )


def _without_idle(selection: Selection, requested: set[str]) -> Selection:
    """Leave out policies that run nowhere; one that was asked for is an error."""
    settings = [(stage, ts) for stage in selection.stages for ts in stage.every_ts_s]
    idle = {
        name: ts
        for name, ts in selection.trained_s.items()
        if not any(selection.runs_at(name, *setting) for setting in settings)
    }
    for name in (name for name in idle if name in requested):
        raise InputError(
            f"{name} was trained at Ts = {idle[name]:g} s, at which none of these plants is scored; "
            f"give --ts {idle[name]:g}, or another plant"
        )
    why = "Left out, since they were trained at another sampling time"
    return _without(selection, {why: list(idle)} if idle else {})


def _without(selection: Selection, names: Mapping[str, Sequence[str]]) -> Selection:
    """Leave controllers out, with a note for each reason."""
    out = {name for each in names.values() for name in each}
    notes = (f"{reason}: {', '.join(each)}." for reason, each in names.items())
    return replace(
        selection,
        controllers=tuple(name for name in selection.controllers if name not in out),
        notes=(*selection.notes, *notes),
        trained_s={name: ts for name, ts in selection.trained_s.items() if name not in out},
    )


def _known(name: str, what: str, known: Iterable[str], otherwise: str = "") -> None:
    if name in known:
        return
    meant = guess(name, known)
    hint = f"{meant} " if meant else ""
    more = f", or {otherwise}" if otherwise else ""
    raise InputError(f"no {what} is named {name!r}; {hint}known are {', '.join(known)}{more}")


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
