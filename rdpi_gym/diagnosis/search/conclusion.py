"""Conclusion of a search: verdict on the last model, residual, next experiment."""

from __future__ import annotations

import math
import time
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import takewhile
from typing import Any

import numpy as np

from rdpi_gym.diagnosis.notices import Code, Notice, statement
from rdpi_gym.diagnosis.portrait import Portrait
from rdpi_gym.diagnosis.probability import Probabilities, probabilities
from rdpi_gym.diagnosis.results import Candidate, Errors, Kind, Left, SearchResult, View, steps_of
from rdpi_gym.diagnosis.search.candidates import assess
from rdpi_gym.diagnosis.search.model_search import ModelSearch
from rdpi_gym.diagnosis.search.other_inputs import other_inputs, said_of
from rdpi_gym.diagnosis.search.plants import plant_of
from rdpi_gym.diagnosis.search.ranking import Ranked
from rdpi_gym.diagnosis.search.refitting import State
from rdpi_gym.diagnosis.search.residual_share import FOUND, remainder
from rdpi_gym.diagnosis.search.rounds import capped
from rdpi_gym.diagnosis.search.separability import separability, typical_effects, what_to_measure
from rdpi_gym.diagnosis.search.verdict import Judgement, judge
from rdpi_gym.diagnosis.words import in_words, template, text_of
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import JointFit
from rdpi_gym.identification.plausibility import plausibility_warnings
from rdpi_gym.identification.residuals import simulate_record
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.effects import Effect
from rdpi_gym.plant.effects.base import kin_of
from rdpi_gym.plant.effects.unknown import Unknown

Groups = tuple[tuple[str, ...], ...]

# Effects of the catalogue that a portrait is held beside.
_NEAREST = 3


@dataclass(frozen=True)
class History:
    """History of a search."""

    began: float  # reading of the clock at its start (s)
    kind: Kind  # what was asked
    given: PlantModel[Any] | None  # the model that it started from
    # The base model refitted, and the model that is saved
    base: State
    end: State
    added: Sequence[Candidate] = ()  # what was added, in order
    rounds: Sequence[Sequence[Ranked]] = ()  # the candidates of each round
    last: Sequence[Ranked] = ()  # of these, what the next experiment has to settle
    states: Sequence[State] = ()  # the models on the way, at which the steps ended
    # As in the result
    removed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def conclude(search: ModelSearch, history: History) -> SearchResult:
    """Judge the model that a search ends with, and say what is left and what would decide."""
    history = _on_all_samples(search, history)
    end, checks = history.end, search.checks
    # last of all: no cap decides what is added
    added = [capped(candidate, checks, search.catalogue) for candidate in history.added]
    search.final_noise(end)
    numerical = search.numerical(end)
    judgement = judge(
        search.close_up,
        end.fit.variant,
        end.outcome.errors.validation_rmse_um,
        search.noise_um,
        numerical,
        bool(added),
    )
    groups = _groups(search, end)
    clocks = search.clocks(end)
    chances = _probabilities(search, history, added)
    probable = () if chances is None else chances.probable
    experiment = _next_experiment(search, end, history.last, judgement, groups, probable)
    advice = clocks[0].advice if clocks else experiment
    sentence, shares = _remainder(search, end, judgement, numerical.borne_um)
    stated = {id(s.outcome.errors): search.errors_of(s.outcome) for s in (*history.states, end)}
    base_errors = search.errors_of(history.base.outcome)
    end_errors = stated[id(end.outcome.errors)]
    added = [replace(c, errors=stated.get(id(c.errors), c.errors)) for c in added]
    plant = plant_of(search.setting, replace(end.outcome, errors=end_errors), history.given)
    left = [simulate_record(plant, record) for record in search.setting.train]
    label = f"with {added[0].effect}" if len(added) == 1 else "with effects"
    dataset = search.dataset
    say = partial(text_of, quantities=dataset.quantities)
    warnings = plausibility_warnings(
        left, quantities=dataset.quantities, clockwise=plant.hysteresis.clockwise
    )
    keep = [record.name for record in dataset.records]
    found = SearchResult(
        kind=history.kind,
        title=search.dataset.title,
        plant=plant,
        steps=steps_of(added),
        rounds=_rounds(search, history.rounds, base_errors, {c.effect for c in added}),
        removed=history.removed,
        noise_floor_um=search.noise_um,
        noise_origin=say(search.noise_origin),
        numerical_floor_um=numerical.total_um,
        base=base_errors,
        final=end_errors,
        given=_given_errors(search, history.given),
        verdict=judgement.verdict,
        sampling=None if judgement.sampling is None else say(judgement.sampling),
        reservation=judgement.sampling,
        undecided=search.undecided,
        unexplained_rmse_um=math.sqrt(
            max(end_errors.validation_rmse_um**2 - search.noise_um**2, 0.0)
        ),
        remainder=sentence,
        left=shares,
        portrait=_portrait(search, history, shares),
        next_experiment=None if advice is None else say(advice),
        advice=advice,
        indistinguishable=groups,
        findings=tuple(
            replace(each, quantities=dataset.quantities) for each in (*search.findings, *clocks)
        ),
        limits=tuple(map(say, search.limits)),
        limit_notices=search.limits,
        probabilities=chances,
        checks=tuple(check.sentence for check in checks),
        views=_views(search, {"base model": history.base} | ({label: end} if added else {})),
        seconds=time.perf_counter() - history.began,
        notes=(
            *(dataset.quantities.said(warning, keep) for warning in warnings),
            *search.remarks,
            *history.notes,
            *([search.reads_fewer] if search.reads_fewer else []),
        ),
        quantities=dataset.quantities,
        core=search.core,
        within_records=search.is_within,
    )
    if history.kind == "diagnosis" and len(added) == 1:
        (chosen,) = added
        search.seen(replace(end.outcome, effect=chosen.effect, form=chosen.form))
    found = replace(found, rounds=found.stated_rounds)
    return in_words(found, dataset.quantities)


def _rounds(
    search: ModelSearch, rounds: Sequence[Sequence[Ranked]], base: Errors, added: Container[str]
) -> tuple[tuple[Candidate, ...], ...]:
    """Return the candidates of each round as they are stated: what was added, then best first."""
    found = []
    for number, ranked in enumerate(rounds):
        candidates = [
            capped(c, search.checks, search.catalogue)
            for c in search.stated(ranked, None if number else base)
        ]
        if any(c.errors is not r.candidate.errors for c, r in zip(candidates, ranked, strict=True)):
            taken = tuple(takewhile(lambda c: c.effect in added, candidates))
            rest = sorted(candidates[len(taken) :], key=lambda c: c.errors.validation_rmse_um)
            candidates = [*taken, *rest]
        found.append(tuple(candidates))
    return tuple(found)


def _probabilities(
    search: ModelSearch, history: History, added: Sequence[Candidate]
) -> Probabilities | None:
    """Return how probable each effect is; they are known of whole discoveries alone."""
    if history.kind != "discovery":
        return None
    tried = [r.candidate for r in history.rounds[0]] if history.rounds else []
    course = search.course(history.base, history.end, added, tried)
    return probabilities(course, kin_of(search.catalogue))


def _on_all_samples(search: ModelSearch, history: History) -> History:
    """Return a search whose models are those of all samples, where it read fewer."""
    if search.reads_fewer is None:
        return history
    last = history.end.outcome.errors
    base, end = search.read_all(history.base, history.end)
    added = [
        search.final(end, replace(c, errors=end.outcome.errors) if c.errors is last else c)
        for c in history.added
    ]
    return replace(history, base=base, end=end, added=added)


def _remainder(
    search: ModelSearch, state: State, judgement: Judgement, numerical_um: float
) -> tuple[str, Left | None]:
    """Say whether what is left follows from the input, and how surely."""
    if judgement.verdict != "unexplained":
        return template("left", rest=statement(f"rest/{judgement.rest}")), None
    clocks = search.clocks(state)
    if clocks:
        late = tuple(finding.record for finding in clocks)
        return template("left/clock", records=late), None
    setting = search.searched
    variant, noise_um = state.fit.variant, search.noise_um
    others = other_inputs(variant, setting.train, setting.validation, noise_um)
    found = remainder(
        variant,
        setting.train,
        setting.validation,
        setting.scale,
        noise_um,
        numerical_um,
        search.still,
    )
    left = Left(found.share, found.low, found.high, found.repeats, found.hidden_um, found.left_um)
    return f"{said_of(others)} {found.sentence}".strip(), left


def _portrait(search: ModelSearch, history: History, left: Left | None) -> Portrait | None:
    """Draw what is left, where it follows from the command and no block stands for it already."""
    present = {effect.name for effect in history.end.effects}
    searched = history.kind in ("diagnosis", "discovery") and search.undecided is None
    if not searched or left is None or left.low < FOUND or Unknown.name in present:
        return None
    last = [r.candidate for r in history.rounds[-1]] if history.rounds else []
    return search.portrait(history.end, nearest_of(last, history.end.effects))


def nearest_of(ranked: Sequence[Candidate], present: Sequence[Effect]) -> list[Candidate]:
    """Return the three candidates that took most of the excess, those that are present left out."""
    have = {effect.name for effect in present}
    others = [c for c in ranked if c.effect not in have and math.isfinite(c.share)]
    return sorted(others, key=lambda c: -c.share)[:_NEAREST]


def _next_experiment(
    search: ModelSearch,
    state: State,
    chosen: Sequence[Ranked],
    judgement: Judgement,
    groups: Groups,
    probable: Sequence[str],
) -> Notice | None:
    """Name the experiment that would decide what these data cannot, `groups` among it."""
    if search.undecided is not None:
        return Notice(Code.STANDARD)
    if search.core.advice is not None and judgement.sampling is None:
        return search.core.advice
    scale = search.setting.scale
    return what_to_measure(
        [r.candidate for r in chosen],
        state.effects,
        typical_effects(search.catalogue, scale),
        groups,
        state.hysteresis,
        scale,
        None if judgement.sampling is None else judgement.again,
        search.findings,
        search.limits,
        judgement.verdict != "unexplained",
        probable,
        [record.name for record in search.dataset.records],
    )


def _groups(search: ModelSearch, state: State) -> Groups:
    """Return the classes of effects that the records to fit cannot tell apart."""
    present = {e.name for e in state.effects}
    kinds = {n: k for n, k in search.catalogue.items() if n not in present}
    effects = typical_effects(kinds, search.setting.scale)
    train = search.searched.train
    found = separability(train, state.hysteresis, state.effects, effects)
    return found.groups(search.noise_um)


def _given_errors(search: ModelSearch, given: PlantModel[Any] | None) -> Errors | None:
    """Return the errors of the model as it was given."""
    if given is None:
        return None
    variant = Variant(given.hysteresis, given.effects)
    fit = JointFit(variant, math.nan, (), {}, 0, True)
    return search.errors_of(assess(search.setting, "", fit))


def _views(search: ModelSearch, states: Mapping[str, State]) -> tuple[View, ...]:
    """Return the records with what each model makes of them."""
    found = []
    setting = search.setting
    for record in dict.fromkeys((*setting.train, *setting.validation)):
        models = {}
        for label, state in states.items():
            y = simulate_effects([state.fit.variant], record)[:, 0]
            counted = record.error_mask
            models[label] = y + float(np.mean((record.y_um - y)[counted]))
        shown = (record.t_s, record.u_V, record.y_um, models, counted.astype(np.float64))
        found.append(View(record.name, record.role, *shown))
    return tuple(found)
