"""The loop: fit, find the missing effect, add it, look again; one round of it; one effect added."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from rdpi_gym.diagnosis.results import Diagnosis, Discovery, Finding
from rdpi_gym.diagnosis.search.candidates import Progress
from rdpi_gym.diagnosis.search.laboratory import Laboratory, State
from rdpi_gym.diagnosis.search.ranking import Ranked
from rdpi_gym.measurement import Dataset
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.effects import CATALOGUE, Effect

# More effects than this are not a model but a collection.
MOST_STEPS = 6


def diagnose(
    dataset: Dataset,
    given: PlantModel | None = None,
    *,
    catalogue: Mapping[str, type[Effect]] = CATALOGUE,
    jobs: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
    checkpoint: Path | None = None,
) -> Diagnosis:
    """Refit every candidate effect with the base model and rank them on validation records.

    Parameters
    ----------
    dataset
        Records to fit and to validate on.
    given
        The model to start from: its effects are kept and refitted. None: the bare RDPI model.
    catalogue
        Candidates by name.
    jobs
        Processes.
    seed
        Of the bootstrap behind the confidence.
    progress
        Called as ``progress(stage, done, total)``.
    checkpoint
        File that keeps finished candidates, so that an interrupted run goes on.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        No record to fit, or none to validate on.
    """
    began = time.perf_counter()
    laboratory = Laboratory(dataset, catalogue, jobs, seed, progress, checkpoint)
    state = laboratory.base(given)
    ranked = laboratory.ranked(state)
    best = laboratory.choose(state, ranked) if laboratory.decidable else []
    end = laboratory.after(state, best) if best else state
    verdict = laboratory.verdict(end, bool(best))
    groups = laboratory.groups(end)
    return Diagnosis(
        noise_floor_um=laboratory.noise_um,
        noise_origin=laboratory.noise_origin,
        base=state.outcome.errors,
        given=laboratory.given_errors(given),
        candidates=tuple(r.finding for r in ranked),
        chosen=tuple(replace(r.finding, errors=end.outcome.errors) for r in best),
        verdict=verdict,
        unexplained_rmse_um=laboratory.unexplained_um(end),
        remainder=laboratory.remainder(end),
        next_experiment=laboratory.next_experiment(end, best, verdict, groups),
        indistinguishable=groups,
        checks=laboratory.checks(),
        views=laboratory.views(
            {"base model": state, **({best[0].finding.effect: end} if best else {})}
        ),
        seconds=time.perf_counter() - began,
    )


def discover(
    dataset: Dataset,
    given: PlantModel | None = None,
    *,
    catalogue: Mapping[str, type[Effect]] = CATALOGUE,
    jobs: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
    checkpoint: Path | None = None,
) -> Discovery:
    """Add effects until nothing more is earned, then try to take each out again.

    Parameters are those of :func:`diagnose`.

    Returns
    -------
    Discovery

    Raises
    ------
    InputError
        As :func:`diagnose`.
    """
    began = time.perf_counter()
    laboratory = Laboratory(dataset, catalogue, jobs, seed, progress, checkpoint)
    base = state = laboratory.base(given)
    steps: list[Finding] = []
    rounds: list[tuple[Finding, ...]] = []
    rivals: dict[str, tuple[str, ...]] = {}
    last: list[Ranked] = []
    while len(steps) < MOST_STEPS and laboratory.decidable and not laboratory.at_floor(state):
        ranked = laboratory.ranked(state)
        rounds.append(tuple(r.finding for r in ranked))
        chosen = laboratory.choose(state, ranked)
        if not chosen:
            break
        last = chosen
        for r in chosen:
            rivals[r.finding.effect] = laboratory.rivals(state, r.finding, rounds[-1])
        state = laboratory.after(state, chosen)
        steps += [replace(r.finding, errors=state.outcome.errors) for r in chosen]
    state, removed = laboratory.eliminate(state, [s.effect for s in steps])
    state, notes = laboratory.on_law(state, given)
    kept = [s for s in steps if s.effect not in removed]
    state, steps = laboratory.settle(state, kept, rivals)
    if steps:  # the staircase ends at the model that is saved
        end = steps[-1].errors
        steps = [replace(s, errors=state.outcome.errors) if s.errors is end else s for s in steps]
    verdict = laboratory.verdict(state, bool(steps))
    groups = laboratory.groups(state)
    return Discovery(
        model=laboratory.model(state, given),
        steps=tuple(laboratory.final(state, step) for step in steps),
        rounds=tuple(rounds),
        removed=removed,
        noise_floor_um=laboratory.noise_um,
        noise_origin=laboratory.noise_origin,
        base=base.outcome.errors,
        given=laboratory.given_errors(given),
        verdict=verdict,
        unexplained_rmse_um=laboratory.unexplained_um(state),
        remainder=laboratory.remainder(state),
        next_experiment=laboratory.next_experiment(state, last, verdict, groups),
        indistinguishable=groups,
        checks=laboratory.checks(),
        views=laboratory.views(
            {"base model": base, "with effects": state} if steps else {"base model": base}
        ),
        seconds=time.perf_counter() - began,
        notes=notes,
    )


def add_effect(
    dataset: Dataset,
    given: PlantModel,
    kind: type[Effect],
    *,
    jobs: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
    checkpoint: Path | None = None,
) -> Discovery:
    """Add one effect because the user says so, earned or not, and refit everything.

    Parameters
    ----------
    dataset, jobs, seed, progress, checkpoint
        As :func:`diagnose`.
    given
        The model; its effects are kept.
    kind
        The effect.

    Returns
    -------
    Discovery
        With one step; its remarks say where it was not earned.

    Raises
    ------
    InputError
        As :func:`diagnose`; the model has the effect already, or no refit with it converges.
    """
    began = time.perf_counter()
    laboratory = Laboratory(dataset, {kind.name: kind}, jobs, seed, progress, checkpoint)
    base = laboratory.base(given)
    ranked = laboratory.ranked(base)
    laboratory.need(ranked, kind)
    state: State = laboratory.after(base, ranked[:1])
    state, notes = laboratory.on_law(state, given)
    verdict = laboratory.verdict(state, True)
    groups = laboratory.groups(state)
    if not ranked[0].earned:
        notes = (f"{kind.name} was added on request; these records do not earn it", *notes)
    return Discovery(
        model=laboratory.model(state, given),
        steps=(laboratory.final(state, replace(ranked[0].finding, errors=state.outcome.errors)),),
        rounds=(tuple(r.finding for r in ranked),),
        removed=(),
        noise_floor_um=laboratory.noise_um,
        noise_origin=laboratory.noise_origin,
        base=base.outcome.errors,
        given=laboratory.given_errors(given),
        verdict=verdict,
        unexplained_rmse_um=laboratory.unexplained_um(state),
        remainder=laboratory.remainder(state),
        next_experiment=laboratory.next_experiment(state, ranked[:1], verdict, groups),
        indistinguishable=groups,
        checks=laboratory.checks(),
        views=laboratory.views({"base model": base, f"with {kind.name}": state}),
        seconds=time.perf_counter() - began,
        notes=notes,
    )
