"""Discovery, diagnosis, addition and removal of effects."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rdpi_gym.diagnosis.portrait import Portrait
from rdpi_gym.diagnosis.preprocessing import Finding, inspect
from rdpi_gym.diagnosis.results import Candidate, CoreChoice, Errors, SearchResult
from rdpi_gym.diagnosis.search.candidates import assess
from rdpi_gym.diagnosis.search.conclusion import nearest_of, portrayed
from rdpi_gym.diagnosis.search.history import History, conclude
from rdpi_gym.diagnosis.search.model_search import ModelSearch
from rdpi_gym.diagnosis.search.plants import OnCandidate, Refit, refit_of
from rdpi_gym.diagnosis.search.ranking import Ranked
from rdpi_gym.diagnosis.search.refitting import State, setting_of
from rdpi_gym.diagnosis.suitability import falls, turned
from rdpi_gym.diagnosis.words import in_words, template
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import NO_FIT, JointFit
from rdpi_gym.measurement import Dataset
from rdpi_gym.plant import RDPI, PlantModel
from rdpi_gym.plant.effects import CATALOGUE, Effect
from rdpi_gym.plant.effects.unknown import Unknown
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress

# More effects than this are not a model but a collection; a round adds one or betters its form.
MOST_EFFECTS, MOST_ROUNDS = 4, 8
# Noise floors from which on another beginning is tried, and what it has to leave of the error.
_UNEXPLAINED_FLOORS, _CLEARLY_BETTER = 1.5, 0.6

Notes = tuple[str, ...]


def diagnose(
    dataset: Dataset,
    given: PlantModel[Any] | None = None,
    *,
    catalogue: Mapping[str, type[Effect]] = CATALOGUE,
    jobs: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
    checkpoint: Path | None = None,
    core: str | None = None,
    on_candidate: OnCandidate | None = None,
) -> SearchResult:
    """Refit every candidate effect with the base model and rank them on validation records."""
    began = time.perf_counter()
    search = ModelSearch(dataset, catalogue, jobs, seed, progress, checkpoint, core, on_candidate)
    base = search.base(given)
    ranked = search.ranked(base)
    base, chosen = _chosen(search, base, base, ranked)
    ranked = _chosen_first([r.candidate for r in chosen], ranked)
    end = search.after(base, chosen)
    end, notes = search.on_law(end, given)
    recommended = [replace(r.candidate, errors=end.outcome.errors) for r in chosen]
    added = [search.final(end, candidate) for candidate in recommended]
    history = History(
        began, "diagnosis", given, base, end, added=added, rounds=[ranked], last=chosen, notes=notes
    )
    return conclude(search, history)


def discover(
    dataset: Dataset,
    given: PlantModel[Any] | None = None,
    *,
    catalogue: Mapping[str, type[Effect]] = CATALOGUE,
    jobs: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
    checkpoint: Path | None = None,
    core: str | None = None,
    on_candidate: OnCandidate | None = None,
) -> SearchResult:
    """Add effects until nothing more is earned, then try to take each out again.

    Parameters are those of :func:`diagnose`.
    """
    began = time.perf_counter()
    search = ModelSearch(dataset, catalogue, jobs, seed, progress, checkpoint, core, on_candidate)
    without_base = copy(search)
    base = search.base(given)
    fresh = copy(search)
    stage, notes = _alternated(search, SearchState(base, base), given)
    other = _alternative_start(stage, search)
    if other is not None:
        begun = _starting_with(fresh, base, other, stage.rounds[0])
        second, its_notes = _alternated(fresh, begun, given)
        if second.state.outcome.mean_square < _CLEARLY_BETTER * stage.state.outcome.mean_square:
            search, stage, notes = fresh, second, its_notes
    chosen = search.other_core(stage.state)
    afresh = None if chosen is None else _starting_on(without_base, chosen, search)
    if chosen is not None and afresh is not None:
        second, its_notes = _alternated(without_base, afresh, given)
        if search.gives_way(stage.state, second.state):
            search, stage, notes = without_base, second, its_notes
        else:
            notes = (*notes, search.left_by(chosen, stage.state, second.state))
    state, rounds = stage.state, list(stage.rounds)
    sure = search.sure(state, stage.added, stage.rivals)
    state, unstable = search.less_sure(state, sure)
    state, merged = search.merge(state, [c.effect for c in sure if c.effect not in unstable])
    unstable = (*unstable, *merged)
    added = [c for c in sure if c.effect not in unstable]
    tried = [r.candidate for r in rounds[0]] if rounds else []
    state, improbable, why = search.improbable(stage.base, state, added, tried)
    added = [c for c in added if c.effect not in improbable]
    if rounds:  # what was taken out again does not lead the ranking
        rounds[0] = _chosen_first(added, rounds[0])
    if added:  # the last step ends at the model that is saved
        end = added[-1].errors
        added = [replace(c, errors=state.outcome.errors) if c.errors is end else c for c in added]
    history = History(
        began,
        "discovery",
        given,
        stage.base,
        state,
        added=[search.final(state, candidate) for candidate in added],
        rounds=rounds,
        last=stage.last,
        states=stage.states,
        removed=(*stage.removed, *unstable, *improbable),
        notes=(*notes, *why),
    )
    return conclude(search, history)


def _alternated(
    search: ModelSearch, stage: SearchState, given: PlantModel[Any] | None
) -> tuple[SearchState, Notes]:
    """Add effects until nothing more is earned and none takes the place of another; with remarks."""
    while True:
        stage = _forward_selection(search, stage)
        before = {c.effect for c in stage.added}
        stage, notes = _backward_elimination(search, stage, given)
        # with another effect in the place of one, what is missing beside it may show
        swapped = {c.effect for c in stage.added} - before
        if not swapped or len(stage.rounds) >= MOST_ROUNDS or search.at_floor(stage.state):
            return stage, notes
        stage = replace(stage, state=search.on_whole_comb(stage.state))


def _starting_on(fresh: ModelSearch, core: CoreChoice, search: ModelSearch) -> SearchState | None:
    """Return the way that begins with another core; None, with a remark, where it has no fit."""
    try:
        base = fresh.base_of(core)
    except NO_FIT as error:
        search.say(template("core left out", core=core.kind, error=error))
        return None
    return SearchState(base, base)


def _alternative_start(stage: SearchState, search: ModelSearch) -> Ranked | None:
    """Return what else could have come first, where what came leads nowhere."""
    left = stage.state.outcome.mean_square
    if not stage.rounds or left <= _UNEXPLAINED_FLOORS**2 * search.noise_um**2:
        return None
    if search.at_floor(stage.state):
        return None
    gone = {c.effect for c in stage.added} | {r.candidate.effect for r in stage.rounds[0][:1]}
    others = [r for r in stage.rounds[0] if r.earned and r.candidate.effect not in gone]
    return max(others, key=lambda r: r.worth, default=None)


def _starting_with(
    search: ModelSearch, base: State, first: Ranked, ranked: Sequence[Ranked]
) -> SearchState:
    """Return the way that begins with a candidate of the first round."""
    state = search.after(base, [first])
    step = replace(first.candidate, errors=state.outcome.errors)
    return SearchState(
        base, state, (step,), (_chosen_first([step], ranked),),
        {step.effect: search.rivals(base, first.candidate, ranked)}, [first], (state,),
    )  # fmt: skip


@dataclass(frozen=True)
class SearchState:
    """State of a discovery."""

    # The base model, and the model with all that was added
    base: State
    state: State
    added: tuple[Candidate, ...] = ()  # what was added, in order
    rounds: tuple[list[Ranked], ...] = ()  # the candidates of each round
    # By effect that was added, what came close to it
    rivals: Mapping[str, tuple[Effect, ...]] = field(default_factory=dict)
    last: Sequence[Ranked] = ()  # of the candidates, those of the last new effect
    states: tuple[State, ...] = ()  # the models that steps ended at
    removed: tuple[str, ...] = ()  # what was taken out again


def _forward_selection(search: ModelSearch, stage: SearchState) -> SearchState:
    """Add effects, or better forms of what is there, until nothing more is earned."""
    base, state, last = stage.base, stage.state, stage.last
    added, rounds, rivals = list(stage.added), list(stage.rounds), dict(stage.rivals)
    states = list(stage.states)
    while len(rounds) < MOST_ROUNDS and len(added) < MOST_EFFECTS:
        if search.at_floor(state):
            break
        ranked = search.ranked(state)
        base, chosen = _chosen(search, base, state, ranked)
        rounds.append(_chosen_first([r.candidate for r in chosen], ranked))
        if not chosen:
            break
        have = {effect.name for effect in state.effects}
        new = [r for r in chosen if r.candidate.effect not in have]
        for r in new:
            rivals[r.candidate.effect] = search.rivals(state, r.candidate, ranked)
        before, state = state, search.after(state, chosen)
        if new:
            last = chosen
        else:  # a better form belongs to the step that is last
            added = _with_new_errors(added, before, state)
        added += [replace(r.candidate, errors=state.outcome.errors) for r in new]
        spared = search.past_outliers(search.past_openings(state))
        if spared is not state:
            added = _with_new_errors(added, state, spared)
            base, state = search.again(base), spared
        states.append(state)
    return replace(
        stage,
        states=tuple(states),
        base=base,
        state=state,
        added=tuple(added),
        rounds=tuple(rounds),
        rivals=rivals,
        last=last,
    )


def _chosen(
    search: ModelSearch, base: State, state: State, ranked: Sequence[Ranked]
) -> tuple[State, list[Ranked]]:
    """Return what to add, and the base model as it is judged from here on."""
    setting = search.setting
    chosen = search.choose(state, ranked)
    if search.setting is not setting:
        base = search.again(base)
        search.seen(base.outcome)
    return base, chosen


def _backward_elimination(
    search: ModelSearch, stage: SearchState, given: PlantModel[Any] | None
) -> tuple[SearchState, Notes]:
    """Take out what is not needed, and try rivals in the place of what is left; with remarks."""
    state, recalled = search.recall(stage.state)
    added = [*stage.added, *recalled]
    state, removed = search.eliminate(state, [c.effect for c in added])
    state, merged = search.merge(state, [c.effect for c in added if c.effect not in removed])
    removed = (*removed, *merged)
    state, simpler = search.simplify(state)
    state, notes = search.on_law(state, given)
    kept = [c for c in added if c.effect not in removed]
    state, settled = search.settle(state, kept, stage.rivals)
    stage = replace(stage, state=state, added=tuple(settled), removed=(*stage.removed, *removed))
    return stage, (*simpler, *notes)


def _chosen_first(chosen: Sequence[Candidate], ranked: Sequence[Ranked]) -> list[Ranked]:
    """Return a ranking with what was chosen on top: held-out error alone does not choose."""
    place = {candidate.effect: k for k, candidate in enumerate(chosen)}
    return sorted(ranked, key=lambda r: place.get(r.candidate.effect, len(place)))


def _with_new_errors(added: list[Candidate], before: State, after: State) -> list[Candidate]:
    """Return the steps, those that ended at one model now ending at another."""
    end = before.outcome.errors
    return [replace(c, errors=after.outcome.errors) if c.errors is end else c for c in added]


def add_effect(
    dataset: Dataset,
    given: PlantModel[Any],
    kind: type[Effect],
    *,
    jobs: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
    checkpoint: Path | None = None,
    core: str | None = None,
    on_candidate: OnCandidate | None = None,
) -> SearchResult:
    """Add one effect because the user says so, earned or not, and refit everything."""
    began = time.perf_counter()
    if any(effect.name == kind.name for effect in given.effects):
        raise InputError(f"the model has {kind.name} already; choose another effect")
    search = ModelSearch(
        dataset, {kind.name: kind}, jobs, seed, progress, checkpoint, core, on_candidate
    )
    base = search.base(given)
    if not search.catalogue:
        raise InputError(
            f"{kind.name} changes what only the core {RDPI.name} has, and the model has the core "
            f"{search.core.kind}; choose another effect"
        )
    found = search.learned(base, kind) if kind.on_request else search.ranked(base)
    ranked = [r for r in found if r.candidate.effect == kind.name]
    search.need(ranked, kind)
    state = search.after(base, ranked[:1])
    state, notes = search.on_law(state, given)
    if not ranked[0].earned:
        notes = (template("on request", effect=kind.name), *notes)
    candidate = replace(ranked[0].candidate, errors=state.outcome.errors)
    history = History(
        began,
        "addition",
        given,
        base,
        state,
        added=[search.final(state, candidate)],
        rounds=[ranked],
        last=ranked[:1],
        notes=notes,
    )
    return conclude(search, history)


def portray(
    dataset: Dataset,
    given: PlantModel[Any] | None = None,
    ranked: Sequence[Candidate] = (),
    *,
    seed: int = 0,
    progress: Progress | None = None,
) -> Portrait | None:
    """Draw the portrait of what a model misses, whatever the verdict on it."""
    if given is not None and any(effect.name == Unknown.name for effect in given.effects):
        raise InputError(f"the model has {Unknown.name} already; portray the model without it")
    search = ModelSearch(dataset, CATALOGUE, 1, seed, progress, None)
    base = search.base(given)
    nearest = nearest_of(ranked, base.effects)
    drawn, _ = portrayed(
        search.searched, base.fit, search.catalogue, nearest, seed, search.progress
    )
    return in_words(drawn, dataset.quantities)


def remove_effect(dataset: Dataset, given: PlantModel[Any], name: str) -> SearchResult:
    """Take an effect out of a model because the user says so, and refit everything."""
    began = time.perf_counter()
    names = [effect.name for effect in given.effects]
    if name not in names:
        raise InputError(f"the model has no effect {name!r}; it has {', '.join(names) or 'none'}")
    kept = replace(given, effects=tuple(e for e in given.effects if e.name != name))
    search = ModelSearch(dataset, CATALOGUE, 1, 0, None, None)
    base = search.base(kept)
    state, notes = search.on_law(base, kept)
    history = History(
        began,
        "removal",
        given,
        base,
        state,
        removed=(name,),
        notes=notes,
    )
    return conclude(search, history)


@dataclass(frozen=True)
class Response:
    """Response of a model to the records, one offset free in each.

    Parameters
    ----------
    model_um
        Displacement of the model (µm) by record, ``(T,)``, its free offset included.
    errors
        Over the samples that a search counts (µm rms).
    """

    model_um: Mapping[str, Array]
    errors: Errors


class Inspection:
    """Records as a search looks through them, and models on them, one by one.

    Parameters
    ----------
    dataset
        The measurement.

    Attributes
    ----------
    findings : tuple of Finding
        What is no measurement and does not count: spikes, dropouts, clipping.

    Raises
    ------
    InputError
        No record to fit, or none to validate on.
    """

    def __init__(self, dataset: Dataset) -> None:
        if not dataset.train or not dataset.validation:
            raise InputError(
                f"{dataset.title} has {len(dataset.train)} records to fit and "
                f"{len(dataset.validation)} to validate on in which the {dataset.quantities.input.name} moves; "
                "give one of each"
            )
        self._sign = -1.0 if falls((*dataset.train, *dataset.validation)) else 1.0
        inspected = inspect(dataset if self._sign > 0 else turned(dataset))
        self.findings: tuple[Finding, ...] = inspected.findings
        self._recorded = dataset
        self._inspected = {record.name: record for record in inspected.dataset.records}
        self._setting = setting_of(inspected.dataset)

    def respond(self, model: PlantModel[Any]) -> Response:
        """Simulate a model on every record, as fast as a search does.

        Parameters
        ----------
        model
            The model; where the displacement falls as the voltage rises it describes the negative of
            it, as that of a search does, and its response is turned.
        """
        variant = Variant(model.hysteresis, model.effects)
        model_um = {}
        for record in self._recorded.records:
            looked = self._inspected.get(record.name, record)
            y = self._sign * simulate_effects([variant], looked)[:, 0]
            counted = looked.error_mask if looked.error_mask.any() else slice(None)
            model_um[record.name] = y + float(np.mean((record.y_um - y)[counted]))
        left = assess(self._setting, "", JointFit(variant, math.nan, (), {}, 0, True))
        return Response(model_um, left.errors)

    def refit(self, model: PlantModel[Any], held: Iterable[str] = ()) -> Refit:
        """Fit a model anew from where it stands: core and effects together.

        Parameters
        ----------
        model
            The model; the number of its plays stays.
        held
            Parameters that stay as they are, as ``creep.tau_s``.

        Raises
        ------
        InputError
            The model has no such parameter.
        """
        names = {f"{e.name}.{p.name}" for e in model.effects for p in e.parameters}
        names |= {p.name for p in type(model.hysteresis).shape}
        if unknown := [name for name in held if name not in names]:
            raise InputError(
                f"held: the model has no parameter {unknown[0]}; it has {', '.join(sorted(names))}"
            )
        fit = self._setting.fit(model.hysteresis, model.effects, held=frozenset(held))
        return refit_of(self._setting, assess(self._setting, "", fit), model)
