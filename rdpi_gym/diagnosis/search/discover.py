"""The loop: fit, find the missing effect, add it, look again; one round of it; one effect added."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rdpi_gym.diagnosis.portrait.portrait import Portrait
from rdpi_gym.diagnosis.results import Candidate, CoreChoice, SearchResult
from rdpi_gym.diagnosis.search.bench import State
from rdpi_gym.diagnosis.search.conclusion import Search, conclude, nearest_of
from rdpi_gym.diagnosis.search.laboratory import Laboratory
from rdpi_gym.diagnosis.search.ranking import Ranked
from rdpi_gym.diagnosis.search.refits import OnCandidate
from rdpi_gym.diagnosis.telling import told
from rdpi_gym.identification.joint import NO_FIT
from rdpi_gym.measurement import Dataset
from rdpi_gym.plant import RDPI, PlantModel
from rdpi_gym.plant.effects import CATALOGUE, Effect
from rdpi_gym.plant.effects.unknown import Unknown
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress

# More effects than this are not a model but a collection; a round adds one or betters its form.
MOST_EFFECTS, MOST_ROUNDS = 4, 8
# Noise floors from which on another beginning is tried, and what it has to leave of the error.
_NOWHERE, _CLEARLY = 1.5, 0.6

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
    laboratory = Laboratory(
        dataset, catalogue, jobs, seed, progress, checkpoint, core, on_candidate
    )
    base = laboratory.base(given)
    ranked = laboratory.ranked(base)
    base, chosen = _chosen(laboratory, base, base, ranked)
    ranked = _chosen_first([r.candidate for r in chosen], ranked)
    end = laboratory.after(base, chosen)
    end, notes = laboratory.on_law(end, given)
    recommended = [replace(r.candidate, errors=end.outcome.errors) for r in chosen]
    added = [laboratory.final(end, candidate) for candidate in recommended]
    search = Search(
        began, "diagnosis", given, base, end, added=added, rounds=[ranked], last=chosen, notes=notes
    )
    return conclude(laboratory, search)


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
    laboratory = Laboratory(
        dataset, catalogue, jobs, seed, progress, checkpoint, core, on_candidate
    )
    without_base = copy(laboratory)
    base = laboratory.base(given)
    untouched = copy(laboratory)
    way, notes = _ended(laboratory, _Way(base, base), given)
    other = _second_first(way, laboratory)
    if other is not None:
        begun = _begun_with(untouched, base, other, way.rounds[0])
        second, its_notes = _ended(untouched, begun, given)
        if second.state.outcome.mean_square < _CLEARLY * way.state.outcome.mean_square:
            laboratory, way, notes = untouched, second, its_notes
    chosen = laboratory.other_core(way.state)
    afresh = None if chosen is None else _begun_on(without_base, chosen, laboratory)
    if chosen is not None and afresh is not None:
        second, its_notes = _ended(without_base, afresh, given)
        if laboratory.gives_way(way.state, second.state):
            laboratory, way, notes = without_base, second, its_notes
        else:
            notes = (*notes, laboratory.left_by(chosen, way.state, second.state))
    state, rounds = way.state, list(way.rounds)
    sure = laboratory.sure(state, way.added, way.rivals)
    state, unstable = laboratory.less_sure(state, sure)
    state, merged = laboratory.merge(state, [c.effect for c in sure if c.effect not in unstable])
    unstable = (*unstable, *merged)
    added = [c for c in sure if c.effect not in unstable]
    tried = [r.candidate for r in rounds[0]] if rounds else []
    state, improbable, why = laboratory.improbable(way.base, state, added, tried)
    added = [c for c in added if c.effect not in improbable]
    if rounds:  # what was taken out again does not lead the ranking
        rounds[0] = _chosen_first(added, rounds[0])
    if added:  # the last step ends at the model that is saved
        end = added[-1].errors
        added = [replace(c, errors=state.outcome.errors) if c.errors is end else c for c in added]
    search = Search(
        began,
        "discovery",
        given,
        way.base,
        state,
        added=[laboratory.final(state, candidate) for candidate in added],
        rounds=rounds,
        last=way.last,
        removed=(*way.removed, *unstable, *improbable),
        notes=(*notes, *why),
    )
    return conclude(laboratory, search)


def _ended(laboratory: Laboratory, way: _Way, given: PlantModel[Any] | None) -> tuple[_Way, Notes]:
    """Add effects until nothing more is earned and none takes the place of another; with remarks."""
    while True:
        way = _grown(laboratory, way)
        before = {c.effect for c in way.added}
        way, notes = _settled(laboratory, way, given)
        # with another effect in the place of one, what is missing beside it may show
        swapped = {c.effect for c in way.added} - before
        if not swapped or len(way.rounds) >= MOST_ROUNDS or laboratory.at_floor(way.state):
            return way, notes
        way = replace(way, state=laboratory.on_whole_comb(way.state))


def _begun_on(untouched: Laboratory, core: CoreChoice, laboratory: Laboratory) -> _Way | None:
    """Return the way that begins with another core; None, with a remark, where it has no fit."""
    try:
        base = untouched.base_of(core)
    except NO_FIT as error:
        laboratory.say(f"the core {core.kind} was left out: {error}")
        return None
    return _Way(base, base)


def _second_first(way: _Way, laboratory: Laboratory) -> Ranked | None:
    """Return what else could have come first, where what came leads nowhere."""
    left = way.state.outcome.mean_square
    if not way.rounds or left <= _NOWHERE**2 * laboratory.noise_um**2:
        return None
    if laboratory.at_floor(way.state):
        return None
    gone = {c.effect for c in way.added} | {r.candidate.effect for r in way.rounds[0][:1]}
    others = [r for r in way.rounds[0] if r.earned and r.candidate.effect not in gone]
    return max(others, key=lambda r: r.worth, default=None)


def _begun_with(
    laboratory: Laboratory, base: State, first: Ranked, ranked: Sequence[Ranked]
) -> _Way:
    """Return the way that begins with a candidate of the first round."""
    state = laboratory.after(base, [first])
    step = replace(first.candidate, errors=state.outcome.errors)
    return _Way(
        base, state, (step,), (_chosen_first([step], ranked),),
        {step.effect: laboratory.rivals(base, first.candidate, ranked)}, [first],
    )  # fmt: skip


@dataclass(frozen=True)
class _Way:
    """How far a discovery has come.

    Parameters
    ----------
    base, state
        The base model, and the model with all that was added.
    added
        What was added, in order.
    rounds
        The candidates of each round.
    rivals
        By effect that was added, what came close to it.
    last
        Of the candidates, those of the last new effect.
    removed
        What was taken out again.
    """

    base: State
    state: State
    added: tuple[Candidate, ...] = ()
    rounds: tuple[list[Ranked], ...] = ()
    rivals: Mapping[str, tuple[Effect, ...]] = field(default_factory=dict)
    last: Sequence[Ranked] = ()
    removed: tuple[str, ...] = ()


def _grown(laboratory: Laboratory, way: _Way) -> _Way:
    """Add effects, or better forms of what is there, until nothing more is earned."""
    base, state, last = way.base, way.state, way.last
    added, rounds, rivals = list(way.added), list(way.rounds), dict(way.rivals)
    while len(rounds) < MOST_ROUNDS and len(added) < MOST_EFFECTS:
        if laboratory.at_floor(state):
            break
        ranked = laboratory.ranked(state)
        base, chosen = _chosen(laboratory, base, state, ranked)
        rounds.append(_chosen_first([r.candidate for r in chosen], ranked))
        if not chosen:
            break
        have = {effect.name for effect in state.effects}
        new = [r for r in chosen if r.candidate.effect not in have]
        for r in new:
            rivals[r.candidate.effect] = laboratory.rivals(state, r.candidate, ranked)
        before, state = state, laboratory.after(state, chosen)
        if new:
            last = chosen
        else:  # a better form belongs to the step that is last
            added = _moved_on(added, before, state)
        added += [replace(r.candidate, errors=state.outcome.errors) for r in new]
        spared = laboratory.past_outliers(laboratory.past_openings(state))
        if spared is not state:
            added = _moved_on(added, state, spared)
            base, state = laboratory.again(base), spared
    return replace(
        way,
        base=base,
        state=state,
        added=tuple(added),
        rounds=tuple(rounds),
        rivals=rivals,
        last=last,
    )


def _chosen(
    laboratory: Laboratory, base: State, state: State, ranked: Sequence[Ranked]
) -> tuple[State, list[Ranked]]:
    """Return what to add, and the base model as it is judged from here on."""
    setting = laboratory.setting
    chosen = laboratory.choose(state, ranked)
    return (base if laboratory.setting is setting else laboratory.again(base)), chosen


def _settled(
    laboratory: Laboratory, way: _Way, given: PlantModel[Any] | None
) -> tuple[_Way, Notes]:
    """Take out what is not needed, and try rivals in the place of what is left; with remarks."""
    state, recalled = laboratory.recall(way.state)
    added = [*way.added, *recalled]
    state, removed = laboratory.eliminate(state, [c.effect for c in added])
    state, merged = laboratory.merge(state, [c.effect for c in added if c.effect not in removed])
    removed = (*removed, *merged)
    state, simpler = laboratory.simplify(state)
    state, notes = laboratory.on_law(state, given)
    kept = [c for c in added if c.effect not in removed]
    state, settled = laboratory.settle(state, kept, way.rivals)
    way = replace(way, state=state, added=tuple(settled), removed=(*way.removed, *removed))
    return way, (*simpler, *notes)


def _chosen_first(chosen: Sequence[Candidate], ranked: Sequence[Ranked]) -> list[Ranked]:
    """Return a ranking with what was chosen on top: held-out error alone does not choose."""
    place = {candidate.effect: k for k, candidate in enumerate(chosen)}
    return sorted(ranked, key=lambda r: place.get(r.candidate.effect, len(place)))


def _moved_on(added: list[Candidate], before: State, after: State) -> list[Candidate]:
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
    laboratory = Laboratory(
        dataset, {kind.name: kind}, jobs, seed, progress, checkpoint, core, on_candidate
    )
    base = laboratory.base(given)
    if not laboratory.catalogue:
        raise InputError(
            f"{kind.name} changes what only the core {RDPI.name} has, and the model has the core "
            f"{laboratory.core.kind}; choose another effect"
        )
    found = laboratory.learned(base, kind) if kind.on_request else laboratory.ranked(base)
    ranked = [r for r in found if r.candidate.effect == kind.name]
    laboratory.need(ranked, kind)
    state = laboratory.after(base, ranked[:1])
    state, notes = laboratory.on_law(state, given)
    if not ranked[0].earned:
        notes = (f"{kind.name} was added on request; these records do not earn it", *notes)
    candidate = replace(ranked[0].candidate, errors=state.outcome.errors)
    search = Search(
        began,
        "addition",
        given,
        base,
        state,
        added=[laboratory.final(state, candidate)],
        rounds=[ranked],
        last=ranked[:1],
        notes=notes,
    )
    return conclude(laboratory, search)


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
    laboratory = Laboratory(dataset, CATALOGUE, 1, seed, progress, None)
    base = laboratory.base(given)
    drawn = laboratory.portrait(base, nearest_of(ranked, base.effects))
    return told(drawn, dataset.quantities)


def remove_effect(dataset: Dataset, given: PlantModel[Any], name: str) -> SearchResult:
    """Take an effect out of a model because the user says so, and refit everything."""
    began = time.perf_counter()
    names = [effect.name for effect in given.effects]
    if name not in names:
        raise InputError(f"the model has no effect {name!r}; it has {', '.join(names) or 'none'}")
    kept = replace(given, effects=tuple(e for e in given.effects if e.name != name))
    laboratory = Laboratory(dataset, CATALOGUE, 1, 0, None, None)
    base = laboratory.base(kept)
    state, notes = laboratory.on_law(base, kept)
    search = Search(
        began,
        "removal",
        given,
        base,
        state,
        removed=(name,),
        notes=notes,
    )
    return conclude(laboratory, search)
