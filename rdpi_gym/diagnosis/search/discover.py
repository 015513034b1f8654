"""Discovery, diagnosis, addition and removal of effects."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rdpi_gym.diagnosis.beam.checkpoint import Checkpoint
from rdpi_gym.diagnosis.beam.constants import FOUND, LEVEL
from rdpi_gym.diagnosis.beam.decision import chances
from rdpi_gym.diagnosis.beam.ending import Course, ended, judged
from rdpi_gym.diagnosis.beam.evidence import Evidence, Offer
from rdpi_gym.diagnosis.beam.expansion import offered, with_free_blocks
from rdpi_gym.diagnosis.beam.models import Linear, Model, Visited, refitted
from rdpi_gym.diagnosis.beam.moves import Place
from rdpi_gym.diagnosis.beam.search import (
    Beam,
    OnVisited,
    Scores,
    begun,
    searched,
    visited_now,
)
from rdpi_gym.diagnosis.beam.signatures import Signature
from rdpi_gym.diagnosis.portrait import Portrait
from rdpi_gym.diagnosis.portrait.trials import learn_forms
from rdpi_gym.diagnosis.preprocessing import Finding, inspect
from rdpi_gym.diagnosis.results import Candidate, Errors, Kind, SearchResult
from rdpi_gym.diagnosis.search.conclusion import Ending, conclude, nearest_of, portrayed
from rdpi_gym.diagnosis.search.plants import AUTO, OnCandidate, Refit, refit_of
from rdpi_gym.diagnosis.search.setting import Setting, assess, assess_refit
from rdpi_gym.diagnosis.suitability import falls, turned
from rdpi_gym.diagnosis.words import in_words, template
from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.joint import JointFit, caught_with, fit_joint, or_none
from rdpi_gym.identification.residuals import model_output
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Dataset
from rdpi_gym.plant import CORES, RDPI, PlantModel
from rdpi_gym.plant.effects import CATALOGUE, Effect
from rdpi_gym.plant.effects.base import forms_of, in_chain_order
from rdpi_gym.plant.effects.unknown import Unknown
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.options import with_options
from rdpi_gym.support.parallel import Pool, in_one_thread
from rdpi_gym.support.progress import Progress, silent
from rdpi_gym.support.words import joined


@dataclass(frozen=True)
class Request:
    """Request to a search: what all kinds of it have in common.

    Parameters
    ----------
    given
        The model to begin with; its core and effects are kept and refitted.
    catalogue
        Effects that moves may bring.
    jobs
        Processes.
    seed
        Of the bootstrap.
    progress
        Called with a task, how much of it is done, and of how much.
    checkpoint
        File that keeps visited sets, so that an interrupted search goes on.
    core
        Kind of hysteresis, or `AUTO` for the best of all.
    on_candidate
        Called with each refit.
    """

    given: PlantModel[Any] | None = None
    _: KW_ONLY
    catalogue: Mapping[str, type[Effect]] = field(default_factory=lambda: CATALOGUE)
    jobs: int = 1
    seed: int = 0
    progress: Progress | None = None
    checkpoint: Path | None = None
    core: str | None = None
    on_candidate: OnCandidate | None = None


class _Search:
    """A search of a data set that has begun."""

    def __init__(self, dataset: Dataset, request: Request) -> None:
        self.began, self.request = time.perf_counter(), request
        self.report, self.pool = request.progress or silent, Pool(request.jobs)
        offer = offer_of(request.catalogue, request.given, request.core)
        self.evidence = Evidence.of(dataset, offer)
        self.seen = _told(self.evidence, request.given, request.on_candidate)
        self.kept = Checkpoint(request.checkpoint, self.evidence, request.seed)

    def base(self) -> tuple[Beam, Visited]:
        """Return a beam that has begun, and what it begins with."""
        beam = Beam(self.evidence, self.request.seed, self.seen)
        return beam, beam.begin(self.kept.stage, self.pool)

    def ended(
        self,
        kind: Kind,
        course: Course,
        notes: Sequence[str] = (),
        failed: Sequence[Candidate] = (),
    ) -> Ending:
        """Return what the search ends with."""
        return ended(
            course, kind=kind, began=self.began, given=self.request.given, seed=self.request.seed,
            pool=self.pool, progress=self.report, notes=(*self.kept.remarks, *notes), failed=failed,
        )  # fmt: skip


@with_options(Request)
@in_one_thread
def discover(dataset: Dataset, request: Request) -> SearchResult:
    """Run the beam to its end."""
    search = _Search(dataset, request)
    beam, scores, best = searched(
        search.evidence,
        request.jobs,
        request.seed,
        request.progress,
        search.seen,
        search.kept.stage,
    )
    return conclude(search.ended("discovery", Course(beam.evidence, beam, scores, best)))


@with_options(Request)
@in_one_thread
def diagnose(dataset: Dataset, request: Request) -> SearchResult:
    """Refit the base model with each effect alone, and rank them."""
    search = _Search(dataset, request)
    evidence, tell = search.evidence, request.on_candidate or (lambda refit: None)
    beam, base = search.base()
    names = [n for n in evidence.offer.effects if n not in base.model.names]
    make = partial(with_each, evidence, base, names, search.pool, search.report, search.seen)
    found = search.kept.stage("effects alone", beam.visited, make)
    known = frozenset[str]().union(*(one.model.names for one in found))
    kinds = (kind for name, kind in evidence.offer.effects.items() if name in names)
    failed = [_failed(evidence, base, kind) for kind in kinds if kind.name not in known]
    for each in failed:
        tell(Refit(each.effect, "", None, each.errors, {}, {}, remark=each.remarks[0]))
    beam.judge(found)
    scores = beam.scored()
    best = _simplest([one for one in scores.sets if one.key in beam.accepted], scores)
    if not scores.is_at_floor(best):
        blocks = partial(with_free_blocks, evidence, best, search.pool)
        beam.add(search.kept.stage("free blocks", beam.visited, blocks))
        scores = beam.scored()
    ending = search.ended("diagnosis", Course(evidence, beam, scores, best), failed=failed)
    if len(ending.added) == 1:
        (added,) = ending.added
        end = replace(ending.end, effect=added.effect, form=added.form)
        tell(refit_of(ending.setting, end, request.given))
    return conclude(ending)


@with_options(Request, None)
@in_one_thread
def add_effect(dataset: Dataset, kind: type[Effect], request: Request) -> SearchResult:
    """Add one effect because the user says so, better or not, and refit everything."""
    if request.given is not None and any(e.name == kind.name for e in request.given.effects):
        raise InputError(f"the model has {kind.name} already; choose another effect")
    search = _Search(dataset, replace(request, catalogue={kind.name: kind}))
    evidence = search.evidence
    beam, base = search.base()
    if not any(form.fits_in(type(base.model.core)) for form in forms_of(kind)):
        raise InputError(
            f"{kind.name} changes what only the core {RDPI.name} has, and the model has the core "
            f"{base.model.core.name}; choose another effect"
        )
    make = partial(with_each, evidence, base, [kind.name], search.pool, search.report)
    if kind.on_request:
        make = partial(_learned, evidence, base, kind, search.report)
    found = search.kept.stage("effect", beam.visited, make)
    if not found:
        raise InputError(f"{kind.name}: {_failed(evidence, base, kind).remarks[0]}")
    beam.judge(found)
    scores = beam.scored()
    course = Course(evidence, beam, scores, _simplest(found, scores))
    earned = course.probability_of(kind.name) >= FOUND
    asked = () if earned else (template("on request", effect=kind.name),)
    return conclude(search.ended("addition", course, asked))


@in_one_thread
def remove_effect(dataset: Dataset, given: PlantModel[Any], name: str) -> SearchResult:
    """Take an effect out of a model because the user says so, and refit everything."""
    began = time.perf_counter()
    names = [effect.name for effect in given.effects]
    if name not in names:
        raise InputError(f"the model has no effect {name!r}; it has {', '.join(names) or 'none'}")
    kept = replace(given, effects=tuple(e for e in given.effects if e.name != name))
    evidence = Evidence.of(dataset, offer_of(CATALOGUE, kept, None))
    beam = Beam(evidence)
    base = beam.begin(visited_now)
    course = Course(evidence, beam, beam.scored(), base)
    return conclude(ended(course, kind="removal", began=began, given=given, removed=(name,)))


@in_one_thread
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
    evidence = Evidence.of(dataset, offer_of(CATALOGUE, given, None))
    base = begun(evidence)
    setting = Setting(evidence.train, evidence.validation, evidence.scale)
    nearest = nearest_of(ranked, base.model.effects)
    drawn, _ = portrayed(setting, base.fit, CATALOGUE, nearest, seed, progress or silent)
    return in_words(drawn, dataset.quantities)


def offer_of(
    catalogue: Mapping[str, type[Effect]], given: PlantModel[Any] | None, core: str | None
) -> Offer:
    """Return the moves that are offered beside a given model, with a kind of core where one is asked for."""
    kept = () if given is None else given.effects
    if core == AUTO:
        return Offer(catalogue, begins_with_all=True, kept=kept)
    if core is None and given is None:
        return Offer(catalogue)
    kind = CORES[given.hysteresis.name if core is None and given is not None else str(core)]
    wrong = [e.name for e in kept if not type(e).fits_in(kind)]
    if wrong:
        raise InputError(
            f"the model has {joined(wrong)}, which only the core {RDPI.name} has; take it out, "
            f"or leave out --core {kind.name}"
        )
    fitting = {n: k for n, k in catalogue.items() if any(f.fits_in(kind) for f in forms_of(k))}
    return Offer(fitting or catalogue, (kind,), kind, kept=kept)


def with_each(
    evidence: Evidence,
    base: Visited,
    names: Sequence[str],
    pool: Pool,
    report: Progress = silent,
    seen: OnVisited | None = None,
) -> list[Visited]:
    """Return the set with each of some effects, in the form and from the start that gains most."""
    signatures = offered(evidence, base)
    done = 0

    def heard(one: Visited | None) -> None:
        nonlocal done
        done += 1
        report("candidates", done, len(names))
        if one is not None and seen is not None:
            seen(one)

    report("candidates", 0, len(names))
    found = pool.map(partial(_with_one, evidence, base, signatures), names, heard)
    return [one for one in found if one is not None]


def _with_one(
    evidence: Evidence, base: Visited, signatures: Sequence[Signature], name: str
) -> Visited | None:
    make = partial(_refitted_with, evidence, base, signatures, name)
    return or_none(make, [evidence.offer.effects[name]])


def _refitted_with(
    evidence: Evidence, base: Visited, signatures: Sequence[Signature], name: str
) -> Visited | None:
    kind = evidence.offer.effects[name]
    only = replace(evidence, offer=replace(evidence.offer, effects={name: kind}))
    place = Place(only, base.model, [each for each in signatures if each.start.name == name])
    starts = place.additions() or [(start,) for start in kind.starts(evidence.scale)[:1]]
    looks = [look for each in starts if (look := place.look_at(each)) is not None]
    if not looks:
        return None
    best = min(looks, key=lambda look: sum(float(left @ left) for left in look.lefts))
    one = refitted(evidence, best.model, base.key)
    if one is None:
        return None
    linear = Linear(evidence, Variant(base.model.core, base.model.effects))
    return replace(one, ghosts=linear.with_phantoms(one.model, [name]), new=(name,))


def _failed(evidence: Evidence, base: Visited, kind: type[Effect]) -> Candidate:
    """Return an effect of which no refit came about, with the reason."""
    effects = in_chain_order([*base.model.effects, kind.starts(evidence.scale)[0]])
    reason = "no start leads to a fit"
    try:
        fit_joint(evidence.train, base.model.core, effects, 1)
    except caught_with(effects) as error:
        reason = f"{type(error).__name__}: {error}".splitlines()[0]
    remark, nowhere = (
        template("not converged", reason=reason),
        Errors(math.inf, math.inf, math.inf, {}),
    )
    return Candidate(kind.name, nowhere, {}, {}, 0.0, -math.inf, (), remark, (remark,))


def _learned(
    evidence: Evidence, base: Visited, kind: type[Effect], report: Progress
) -> list[Visited]:
    """Refit every form of a block that records teach."""
    model = base.model
    setting = Setting(evidence.train, evidence.validation, evidence.scale)
    outcomes = learn_forms(setting, model.core, model.effects, kind, report)
    models = [Model(o.fit.variant.hysteresis, o.fit.variant.effects) for o in outcomes]
    found = [refitted(evidence, each, base.key) for each in models]
    return [one for one in found if one is not None]


def _simplest(found: Sequence[Visited], scores: Scores) -> Visited:
    """Return the one of fewest numbers of those that are not worse than the best by the one decision."""
    table = np.array([scores.of(one) for one in found])
    lost = chances(
        table - table[int(np.argmin(table.mean(axis=1)))], np.zeros(len(found)), scores.draws
    )
    equal = [one for one, chance in zip(found, lost, strict=True) if chance >= LEVEL]
    return min(equal, key=lambda one: one.model.numbers)


def _told(
    evidence: Evidence, given: PlantModel[Any] | None, on_candidate: OnCandidate | None
) -> Callable[[Visited], None] | None:
    """Return what tells whoever watches of a set: of the base, and of each effect beside another."""
    if on_candidate is None:
        return None
    whole = evidence.in_full
    before: dict[tuple[str, ...], frozenset[str]] = {}

    def told(one: Visited) -> None:
        if one.key in before:
            return
        before[one.key] = one.model.names
        known = frozenset() if one.parent is None else before.get(one.parent, frozenset())
        effects = [e.name for e in one.model.effects if not evidence.offer.is_kept(e.name)]
        new = [name for name in effects if name not in known]
        if one.parent is None or new:
            setting = Setting(whole.train, whole.validation, whole.scale)
            on_candidate(refit_of(setting, judged(whole, one, *new[:1]), given))

    return told


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
        rising = dataset if self._sign > 0 else turned(dataset)
        inspected = inspect(rising)
        self.findings: tuple[Finding, ...] = inspected.findings
        self._recorded = dataset
        looked = (*rising.records, *inspected.dataset.records)
        self._looked = {record.name: record for record in looked}  # inspected before recorded ones
        train, validation = inspected.dataset.train, inspected.dataset.validation
        self._setting = Setting(train, validation, data_scale((*train, *validation)))

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
            looked = self._looked[record.name]
            y = self._sign * model_output(variant, looked)
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
        kept = frozenset(held)
        fit = fit_joint(self._setting.train, model.hysteresis, model.effects, held=kept)
        return refit_of(self._setting, assess_refit(self._setting, "", fit, kept), model)
