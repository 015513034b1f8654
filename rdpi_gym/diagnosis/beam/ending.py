"""From the sets of a beam to what a search ends with: models on all samples, steps, candidates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from rdpi_gym.diagnosis.beam.constants import FOUND
from rdpi_gym.diagnosis.beam.evidence import Clock, Evidence, joined
from rdpi_gym.diagnosis.beam.grades import Name, names_of
from rdpi_gym.diagnosis.beam.models import Model, Visited, refitted
from rdpi_gym.diagnosis.beam.search import Beam, Scores
from rdpi_gym.diagnosis.checks import run_checks
from rdpi_gym.diagnosis.notices import Code, Notice, statement
from rdpi_gym.diagnosis.preprocessing import Finding
from rdpi_gym.diagnosis.results import (
    Candidate,
    CoreChoice,
    Errors,
    Kind,
    Probabilities,
    share_of_excess,
)
from rdpi_gym.diagnosis.search.conclusion import Ending, as_it_is
from rdpi_gym.diagnosis.search.plants import in_few_numbers, kind_experiment
from rdpi_gym.diagnosis.search.setting import Outcome, Setting, assess_refit, evidence_of, of_effect
from rdpi_gym.diagnosis.search.verdict import numerical_floor
from rdpi_gym.diagnosis.suitability import close_up, limits, unrelated
from rdpi_gym.diagnosis.words import template, text_of
from rdpi_gym.identification.joint import JointFit
from rdpi_gym.measurement import Record
from rdpi_gym.plant import CORES, PlantModel
from rdpi_gym.plant.effects.base import Effect
from rdpi_gym.plant.effects.unknown import Unknown
from rdpi_gym.support.parallel import ALONE, Pool
from rdpi_gym.support.progress import Progress, silent


@dataclass(frozen=True, eq=False)
class Course:
    """A beam that has ended, with the set that it ends with."""

    evidence: Evidence
    beam: Beam
    scores: Scores
    best: Visited

    @cached_property
    def whole(self) -> Evidence:
        """The records in full."""
        return self.evidence.in_full

    @cached_property
    def _outcomes(self) -> dict[tuple[str, ...], Outcome]:
        return {}

    def outcome_of(self, one: Visited) -> Outcome:
        """Return a set with its errors on all records in full."""
        if one.key not in self._outcomes:
            self._outcomes[one.key] = judged(self.whole, one)
        return self._outcomes[one.key]

    @cached_property
    def probabilities(self) -> dict[tuple[str, ...], float]:
        """Probability of each set, by its key."""
        mean = self.scores.probabilities.mean(axis=0)
        return {one.key: float(w) for one, w in zip(self.scores.sets, mean, strict=True)}

    @cached_property
    def names(self) -> dict[str, Name]:
        """Effects and clock faults that any set has."""
        return {each.name: each for each in names_of(self.scores, self.best)}

    @property
    def sound(self) -> Course:
        """The same without clock faults of its best set that are stand-ins: they are of no recorder."""
        clocks = {clock.name for clock in self.best.model.clocks}
        wrong = {n for n in clocks if self.names[n].grade in ("stand-in", "")}
        fewer = self.named(self.best.model.names - wrong) if wrong else None
        return self if fewer is None else replace(self, best=fewer).sound

    def effects_of(self, model: Model) -> tuple[Effect, ...]:
        """Effects of a model that were not given."""
        return tuple(e for e in model.effects if not self.evidence.offer.is_kept(e.name))

    @cached_property
    def way(self) -> list[Visited]:
        """Sets on the way to the best one: the base, then each that has more of its names."""
        chain = [self.best]
        while chain[0].parent is not None:
            chain.insert(0, self.beam.visited[chain[0].parent])
        bare = [one for one in chain if one.model.names == chain[0].model.names]
        found, every = [bare[-1]], self.best.model.names
        for one in chain:
            if found[-1].model.names < one.model.names < every:
                found.append(one)
        return found if found[-1] is self.best else [*found, self.best]

    def beside(self, one: Visited) -> dict[str, Visited]:
        """Sets with one effect more, by its name: of its forms the most probable."""
        found: dict[str, Visited] = {}
        for other in sorted(self.scores.sets, key=lambda each: -self.probabilities[each.key]):
            new = other.model.names - one.model.names
            if other.model.core.name != one.model.core.name or len(new) != 1:
                continue
            (name,) = new
            effects = {effect.name for effect in other.model.effects}
            if one.model.names < other.model.names and name in effects and name != Unknown.name:
                found.setdefault(name, other)
        return found

    def named(self, names: frozenset[str]) -> Visited | None:
        """Return the most probable set of some names."""
        alike = [one for one in self.scores.sets if one.model.names == names]
        return max(alike, key=lambda one: self.probabilities[one.key], default=None)

    def probability_of(self, name: str) -> float:
        """Return the probability of the sets that have a name."""
        return sum(
            self.probabilities[one.key] for one in self.scores.sets if name in one.model.names
        )


def ended(
    course: Course,
    *,
    kind: Kind,
    began: float,
    given: PlantModel[Any] | None = None,
    seed: int = 0,
    pool: Pool = ALONE,
    progress: Progress = silent,
    removed: tuple[str, ...] = (),
    notes: tuple[str, ...] = (),
    failed: Sequence[Candidate] = (),
) -> Ending:
    """Return what a beam ends with, its models judged on all samples; `failed` are ranked last."""
    course = course.sound
    evidence, best = course.evidence, course.best
    clocks = best.model.clocks
    whole, searched = course.whole, _setting(evidence.mended(clocks))
    noise_um, origin = whole.floor(best.lefts)
    law, said = in_few_numbers(
        searched, assess_refit(searched, "", best.fit), given, noise_um, pool
    )
    if evidence.reads_fewer is not None:
        variant = law.fit.variant
        full = refitted(whole, Model(variant.hysteresis, variant.effects, clocks))
        law = judged(whole, best if full is None else full)
        noise_um, origin = whole.floor((best if full is None else full).lefts)
    setting = _setting(whole.mended(clocks))
    near = setting
    if evidence.reads_fewer is not None:
        near = replace(
            setting, train=close_up(setting.train), validation=close_up(setting.validation)
        )
    base = law if course.best is course.way[0] else course.outcome_of(course.way[0])
    added = _steps(course, law, base, noise_um)
    records = list({r.name: r for r in (*whole.train, *whole.validation)}.values())
    turned = (template("turned"),) if evidence.sign < 0.0 else ()
    refused = course.beam.refused if evidence.offer.begins_with_all else {}
    without = [template("core left out", core=core, error=why) for core, why in refused.items()]
    discovered, every = kind == "discovery", joined(evidence.dataset)
    return Ending(
        began=began,
        kind=kind,
        given=given,
        dataset=every,
        catalogue=evidence.offer.effects,
        setting=setting,
        searched=searched,
        close_up=near,
        base=base,
        end=law,
        base_errors=base.errors,
        end_errors=law.errors,
        given_errors=None if given is None else as_it_is(setting, given).errors,
        noise_um=noise_um,
        noise_origin=origin,
        numerical=numerical_floor(law.fit.variant, near.validation),
        checks=run_checks(joined(evidence.read)),
        limits=limits(every),
        findings=evidence.findings,
        core=_core(course),
        added=added,
        rounds=_rounds(course, added, noise_um, failed),
        last=[c for c in added if c.errors is added[-1].errors],
        probabilities=_probabilities(course) if discovered else None,
        clocks=tuple(clock_finding(clock, records) for clock in clocks),
        undecided=unrelated(evidence.train),
        reads_fewer=evidence.reads_fewer,
        removed=removed,
        notes=(*notes, *turned, *said, *without),
        seed=seed,
        progress=progress,
    )


def judged(evidence: Evidence, one: Visited, name: str = "") -> Outcome:
    """Simulate a set on all records, their clocks as it has them."""
    return assess_refit(_setting(evidence.mended(one.model.clocks)), name, one.fit)


def _setting(evidence: Evidence) -> Setting:
    return Setting(evidence.train, evidence.validation, evidence.scale)


def _steps(course: Course, end: Outcome, base: Outcome, noise_um: float) -> list[Candidate]:
    """Return the effects of the best set, in the order of the sets on the way to it."""
    found: list[Candidate] = []
    present, before = {effect.name for effect in course.way[0].model.effects}, base.errors
    for one in course.way[1:]:
        errors = end.errors if one is course.best else course.outcome_of(one).errors
        for effect in course.effects_of(one.model):
            if effect.name not in present:
                candidate = _candidate(course, effect.name, before, errors, noise_um, end.fit)
                found.append(_beside_others(course, candidate))
        present |= {effect.name for effect in one.model.effects}
        before = errors
    return found


def _rounds(
    course: Course,
    added: Sequence[Candidate],
    noise_um: float,
    failed: Sequence[Candidate],
) -> tuple[tuple[Candidate, ...], ...]:
    """Return for each set on the way the effects that were refitted beside it, those added first."""
    found = list[tuple[Candidate, ...]]()
    for one in course.way:
        before = course.outcome_of(one).errors
        tried = []
        for name, other in course.beside(one).items():
            errors = course.outcome_of(other).errors
            each = _candidate(course, name, before, errors, noise_um, other.fit)
            if round(100.0 * each.share) > 0 and other.key not in course.beam.accepted:
                each = replace(each, remarks=(*each.remarks, template("refused")))
            tried.append(each)
        tried.sort(key=lambda c: c.errors.validation_rmse_um)
        have = {effect.name for effect in one.model.effects}
        first = next((c.errors for c in added if c.effect not in have), None)
        chosen = [c for c in added if c.errors is first]
        names = {c.effect for c in chosen}
        others = [c for c in tried if c.effect not in names]
        found.append((*chosen, *others, *(() if found else failed)))
    return tuple(each for each in found if each)


def _candidate(
    course: Course, name: str, before: Errors, after: Errors, noise_um: float, fit: JointFit
) -> Candidate:
    """Return an effect that takes one error to another, with its numbers in a refit."""
    own = course.names.get(name)
    effects = {effect.name for effect in fit.variant.effects}
    kinds = course.evidence.offer.effects
    instead = () if own is None else tuple(n for n in own.instead if n in kinds and n != name)
    remarks = [template("at bound", parameter=n) for n in fit.at_bound if n.startswith(f"{name}.")]
    if not fit.converged:
        remarks.append(template("not ended"))
    candidate = Candidate(
        effect=name,
        errors=after,
        parameters={},
        standard_errors={},
        confidence=0.0 if own is None else own.shared,
        share=share_of_excess(before, after, noise_um),
        indistinguishable=instead,
        evidence=evidence_of(before, after, kinds[name].signature),
        remarks=tuple(remarks),
        grade="" if own is None else own.grade,
    )
    return of_effect(candidate, fit, name) if name in effects else candidate


def _beside_others(course: Course, candidate: Candidate) -> Candidate:
    """Add what all others leave without an effect, and with another one in its place."""
    others = course.best.model.names - {candidate.effect}
    fewer = course.named(others)
    instead = {}
    for name in candidate.indistinguishable:
        rival = course.named(others | {name})
        if name not in others and rival is not None:
            instead[name] = course.outcome_of(rival).errors.validation_rmse_um
    without_um = None if fewer is None else course.outcome_of(fewer).errors.validation_rmse_um
    return replace(candidate, without_um=without_um, instead=instead)


def _probabilities(course: Course) -> Probabilities:
    """Return the weights of the sets by the names that they have.

    Where no name is found or likely, what the best set leaves above the floor has a cause outside the catalogue.
    """
    kinds = course.evidence.offer.effects
    named = any(each.grade in ("found", "likely") for each in course.names.values())
    beyond = 0.0 if named else course.scores.beyond(course.best)
    effects = {n: each.probability for n, each in course.names.items() if n in kinds}
    effects = dict(sorted(effects.items(), key=lambda item: -item[1]))
    added = [effect.name for effect in course.effects_of(course.best.model)]
    groups = {n: course.names[n].shared for n in added if n in course.names}
    bare = [one for one in course.scores.sets if not course.effects_of(one.model)]
    return Probabilities(
        effects,
        groups,
        sum(course.probabilities[one.key] for one in bare) * (1.0 - beyond),
        1.0 - (1.0 - course.probability_of(Unknown.name)) * (1.0 - beyond),
        tuple(n for n, p in effects.items() if p >= 1.0 - FOUND),
    )


def _core(course: Course) -> CoreChoice:
    """Return the kind of the best set, and those that take the weight that it lacks to be found."""
    probabilities: dict[str, float] = {}
    for one in course.scores.sets:
        name = one.model.core.name
        probabilities[name] = probabilities.get(name, 0.0) + course.probabilities[one.key]
    kind, clockwise = course.best.model.core.name, course.evidence.clockwise
    if len(probabilities) == 1:
        return CoreChoice(kind, clockwise=clockwise)
    alike, held = list[str](), probabilities[kind]
    for name in sorted(probabilities, key=lambda each: -probabilities[each]):
        if name != kind and held < FOUND:
            alike.append(name)
            held += probabilities[name]
    advice = kind_experiment(CORES[kind], [CORES[name] for name in alike])
    text = None if advice is None else text_of(advice)
    return CoreChoice(kind, tuple(alike), min(held, 1.0), text, clockwise, advice)


def clock_finding(clock: Clock, records: Sequence[Record]) -> Finding:
    """Say what is wrong with the clock of one of some records, or of all."""
    own = [r for r in records if clock.record in ("", r.name)]
    name, ts_s, value = clock.record, own[0].ts_s, clock.value
    if clock.kind == "step":
        right = ts_s * math.exp(value)
        text = statement(
            "clock/scale", record=name, factor=math.exp(-value), right=right, written=ts_s
        )
        advice = Notice(Code.SAMPLING_TIME, (name,))
    elif clock.kind == "delay":
        way = "clock/record lags" if value > 0.0 else "clock/record leads"
        shift_ms, samples = 1e3 * abs(value), abs(value) / ts_s
        text = statement(way, record=name, shift_ms=shift_ms, samples=samples)
        advice = Notice(Code.TRIGGER, (name,))
    else:
        of = name or "all records"
        text, advice = statement("clock/skew", of=of, late_ms=1e3 * value), Notice(Code.ONE_CLOCK)
    return Finding("clock", name, sum(r.t_s.size for r in own), text, advice)
