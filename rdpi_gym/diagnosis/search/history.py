"""End of a search by rounds: its models and candidates on all samples, as they are stated."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from typing import Any

from rdpi_gym.diagnosis.probability import Probabilities, probabilities
from rdpi_gym.diagnosis.results import Candidate, Errors, Kind, SearchResult
from rdpi_gym.diagnosis.search import conclusion
from rdpi_gym.diagnosis.search.conclusion import Ending, as_it_is
from rdpi_gym.diagnosis.search.model_search import ModelSearch
from rdpi_gym.diagnosis.search.ranking import Ranked
from rdpi_gym.diagnosis.search.refitting import State
from rdpi_gym.diagnosis.search.rounds import capped
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.effects.base import kin_of


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
    """Return the result of a search by rounds."""
    history = _on_all_samples(search, history)
    base, end, checks = history.base, history.end, search.checks
    # last of all: no cap decides what is added
    added = [capped(candidate, checks, search.catalogue) for candidate in history.added]
    search.final_noise(end)
    models = (*history.states, end)
    stated = [(s.outcome.errors, search.errors_of(s.outcome)) for s in models]
    base_errors = search.errors_of(base.outcome)
    chances = _probabilities(search, history, added)
    added = [
        replace(c, errors=next((own for errors, own in stated if errors == c.errors), c.errors))
        for c in added
    ]
    given = history.given
    ending = Ending(
        began=history.began,
        kind=history.kind,
        given=given,
        dataset=search.dataset,
        catalogue=search.catalogue,
        setting=search.setting,
        searched=search.searched,
        close_up=search.close_up,
        base=base.outcome,
        end=end.outcome,
        base_errors=base_errors,
        end_errors=stated[-1][1],
        given_errors=None if given is None else search.errors_of(as_it_is(search.setting, given)),
        noise_um=search.noise_um,
        noise_origin=search.noise_origin,
        numerical=search.numerical(end),
        checks=checks,
        limits=search.limits,
        findings=search.findings,
        core=search.core,
        added=added,
        rounds=_rounds(search, history.rounds, base_errors, {c.effect for c in added}),
        last=[r.candidate for r in history.last],
        probabilities=chances,
        clocks=search.clocks(end),
        undecided=search.undecided,
        reads_fewer=search.reads_fewer,
        removed=history.removed,
        notes=(*search.remarks, *history.notes),
        within_records=search.is_within,
        seed=search.seed,
        progress=search.progress,
    )
    found = conclusion.conclude(ending)
    if history.kind == "diagnosis" and len(added) == 1:
        (chosen,) = added
        search.seen(replace(end.outcome, effect=chosen.effect, form=chosen.form))
    return found


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
