"""Conclusion of a search, however it was searched: verdict on the last model, residual, next experiment."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rdpi_gym.diagnosis.checks import Check
from rdpi_gym.diagnosis.features.noise import quiet_noise
from rdpi_gym.diagnosis.notices import Code, Notice, Statement, statement
from rdpi_gym.diagnosis.portrait import Portrait
from rdpi_gym.diagnosis.portrait.drawing import draw
from rdpi_gym.diagnosis.portrait.trials import learn_forms
from rdpi_gym.diagnosis.preprocessing import Finding
from rdpi_gym.diagnosis.results import (
    Candidate,
    CoreChoice,
    Errors,
    Kind,
    Left,
    Probabilities,
    SearchResult,
    View,
    steps_of,
)
from rdpi_gym.diagnosis.search.other_inputs import other_inputs, said_of
from rdpi_gym.diagnosis.search.plants import on_comb, plant_of
from rdpi_gym.diagnosis.search.residual_share import FOUND, remainder
from rdpi_gym.diagnosis.search.separability import separability, typical_effects, what_to_measure
from rdpi_gym.diagnosis.search.setting import Outcome, Setting, assess
from rdpi_gym.diagnosis.search.verdict import Judgement, NumericalFloor, judge
from rdpi_gym.diagnosis.words import in_words, template, text_of
from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.joint import NO_FIT, JointFit, fit_joint
from rdpi_gym.identification.plausibility import plausibility_warnings
from rdpi_gym.identification.residuals import model_output, simulate_record
from rdpi_gym.measurement import Dataset
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import Effect
from rdpi_gym.plant.effects.unknown import Unknown
from rdpi_gym.support.progress import Progress, silent

Groups = tuple[tuple[str, ...], ...]

# Effects of the catalogue that a portrait is held beside.
_NEAREST = 3


@dataclass(frozen=True, eq=False)
class Ending:
    """End of a search: its records, two models, and its findings about each effect."""

    began: float  # reading of the clock at its start (s)
    kind: Kind  # what was asked
    given: PlantModel[Any] | None  # the model that it started from
    dataset: Dataset  # as inspection left it
    catalogue: Mapping[str, type[Effect]]  # effects that were offered
    # All samples that count in the end, those that the search read, and a stretch as recorded
    setting: Setting
    searched: Setting
    close_up: Setting
    # The base model refitted, and the model that is saved
    base: Outcome
    end: Outcome
    # Errors of both and of the model as given, as they are stated
    base_errors: Errors
    end_errors: Errors
    given_errors: Errors | None
    noise_um: float
    noise_origin: Statement
    numerical: NumericalFloor  # of the last model
    checks: Sequence[Check]
    limits: tuple[Notice, ...]
    findings: tuple[Finding, ...]
    core: CoreChoice
    added: Sequence[Candidate] = ()  # what was added, in order
    rounds: tuple[tuple[Candidate, ...], ...] = ()  # the candidates of each round
    last: Sequence[Candidate] = ()  # of these, what the next experiment has to settle
    probabilities: Probabilities | None = None
    clocks: tuple[Finding, ...] = ()  # records whose clock is wrong by the last model
    undecided: str | None = None
    reads_fewer: str | None = None
    # As in the result
    removed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    seed: int = 0
    progress: Progress = silent

    @property
    def fit(self) -> JointFit:
        """The last refit."""
        return self.end.fit

    @property
    def variant(self) -> Variant[Core]:
        """The last model."""
        return self.fit.variant


def conclude(ending: Ending) -> SearchResult:
    """Judge the model that a search ends with, and say what is left and what would decide."""
    dataset, added = ending.dataset, ending.added
    judgement = judge(
        ending.close_up,
        ending.variant,
        ending.end.errors.validation_rmse_um,
        ending.noise_um,
        ending.numerical,
        bool(added),
    )
    groups = _groups(ending)
    experiment = _next_experiment(ending, judgement, groups)
    advice = ending.clocks[0].advice if ending.clocks else experiment
    sentence, shares = _remainder(ending, judgement)
    portrait, troubles = _portrait(ending, shares)
    plant = plant_of(ending.setting, replace(ending.end, errors=ending.end_errors), ending.given)
    left = [simulate_record(plant, record) for record in ending.setting.train]
    label = f"with {added[0].effect}" if len(added) == 1 else "with effects"
    quantities = dataset.quantities

    def say(found: Notice | Statement) -> str:
        return text_of(found, quantities=quantities)

    warnings = plausibility_warnings(
        left, quantities=quantities, clockwise=plant.hysteresis.clockwise
    )
    keep = [record.name for record in dataset.records]
    found = SearchResult(
        kind=ending.kind,
        title=dataset.title,
        plant=plant,
        steps=steps_of(added),
        rounds=ending.rounds,
        removed=ending.removed,
        noise_floor_um=ending.noise_um,
        noise_origin=say(ending.noise_origin),
        numerical_floor_um=ending.numerical.total_um,
        base=ending.base_errors,
        final=ending.end_errors,
        given=ending.given_errors,
        verdict=judgement.verdict,
        sampling=None if judgement.sampling is None else say(judgement.sampling),
        reservation=judgement.sampling,
        undecided=ending.undecided,
        unexplained_rmse_um=math.sqrt(
            max(ending.end_errors.validation_rmse_um**2 - ending.noise_um**2, 0.0)
        ),
        remainder=sentence,
        left=shares,
        portrait=portrait,
        next_experiment=None if advice is None else say(advice),
        advice=advice,
        indistinguishable=groups,
        findings=tuple(
            replace(each, quantities=quantities) for each in (*ending.findings, *ending.clocks)
        ),
        limits=tuple(map(say, ending.limits)),
        limit_notices=ending.limits,
        probabilities=ending.probabilities,
        checks=tuple(check.sentence for check in ending.checks),
        views=_views(ending, {"base model": ending.base} | ({label: ending.end} if added else {})),
        seconds=time.perf_counter() - ending.began,
        notes=(
            *(quantities.said(warning, keep) for warning in warnings),
            *ending.notes,
            *troubles,
            *([ending.reads_fewer] if ending.reads_fewer else []),
        ),
        quantities=quantities,
        core=ending.core,
    )
    return in_words(replace(found, rounds=found.stated_rounds), quantities)


def _remainder(ending: Ending, judgement: Judgement) -> tuple[str, Left | None]:
    """Say whether what is left follows from the input, and how surely."""
    if judgement.verdict != "unexplained":
        return template("left", rest=statement(f"rest/{judgement.rest}")), None
    if ending.clocks:
        late = tuple(finding.record for finding in ending.clocks)
        return template("left/clock", records=late), None
    setting, noise_um = ending.searched, ending.noise_um
    others = other_inputs(ending.variant, setting.train, setting.validation, noise_um)
    found = remainder(
        ending.variant,
        setting.train,
        setting.validation,
        setting.scale,
        noise_um,
        ending.numerical.borne_um,
        quiet_noise(ending.dataset.quiet),
    )
    left = Left(found.share, found.low, found.high, found.repeats, found.hidden_um, found.left_um)
    return f"{said_of(others)} {found.sentence}".strip(), left


def _portrait(ending: Ending, left: Left | None) -> tuple[Portrait | None, list[str]]:
    """Draw what is left, where it follows from the command and no block stands for it already."""
    present = {effect.name for effect in ending.variant.effects}
    searched = ending.kind in ("diagnosis", "discovery") and ending.undecided is None
    if not searched or left is None or left.low < FOUND or Unknown.name in present:
        return None, []
    last = ending.rounds[-1] if ending.rounds else ()
    return portrayed(
        ending.searched, ending.fit, ending.catalogue,
        nearest_of(last, ending.variant.effects), ending.seed, ending.progress,
    )  # fmt: skip


def portrayed(
    setting: Setting,
    fit: JointFit,
    catalogue: Mapping[str, type[Effect]],
    nearest: Sequence[Candidate],
    seed: int,
    progress: Progress,
) -> tuple[Portrait | None, list[str]]:
    """Draw the portrait of what a model misses, beside the effects that came nearest; say why not."""
    core, effects = fit.variant.hysteresis, fit.variant.effects
    try:
        fitted = fit_joint(setting.train, on_comb(core, setting.train), effects).variant
        plays = fitted.hysteresis.pruned()
        typical = typical_effects(catalogue, setting.scale)
        kin = {c.effect: typical[c.effect] for c in nearest if c.effect in typical}
        forms = learn_forms(setting, plays, fitted.effects, Unknown, progress)
        return draw(setting, plays, fitted.effects, forms, kin, seed, progress), []
    except NO_FIT as error:
        return None, [template("no portrait", error=error)]


def nearest_of(ranked: Sequence[Candidate], present: Sequence[Effect]) -> list[Candidate]:
    """Return the three candidates that took most of the excess, those that are present left out."""
    have = {effect.name for effect in present}
    others = [c for c in ranked if c.effect not in have and math.isfinite(c.share)]
    return sorted(others, key=lambda c: -c.share)[:_NEAREST]


def _next_experiment(ending: Ending, judgement: Judgement, groups: Groups) -> Notice | None:
    """Name the experiment that would decide what these data cannot, `groups` among it."""
    if ending.undecided is not None:
        return Notice(Code.STANDARD)
    if ending.core.advice is not None and judgement.sampling is None:
        return ending.core.advice
    scale, chances = ending.setting.scale, ending.probabilities
    return what_to_measure(
        ending.last,
        ending.variant.effects,
        typical_effects(ending.catalogue, scale),
        groups,
        ending.variant.hysteresis,
        scale,
        None if judgement.sampling is None else judgement.again,
        ending.findings,
        ending.limits,
        judgement.verdict != "unexplained",
        () if chances is None else chances.probable,
        [record.name for record in ending.dataset.records],
    )


def _groups(ending: Ending) -> Groups:
    """Return the classes of effects that the records to fit cannot tell apart."""
    core, present = ending.variant.hysteresis, ending.variant.effects
    have = {e.name for e in present}
    kinds = {n: k for n, k in ending.catalogue.items() if n not in have}
    effects = typical_effects(kinds, ending.setting.scale)
    found = separability(ending.searched.train, core, present, effects)
    return found.groups(ending.noise_um)


def as_it_is(setting: Setting, model: PlantModel[Any]) -> Outcome:
    """Errors of a model as it was given."""
    variant = Variant(model.hysteresis, model.effects)
    return assess(setting, "", JointFit(variant, math.nan, (), {}, 0, True))


def _views(ending: Ending, models: Mapping[str, Outcome]) -> tuple[View, ...]:
    """Return the records with what each model makes of them."""
    found = []
    for record in dict.fromkeys((*ending.setting.train, *ending.setting.validation)):
        shown, counted = {}, record.error_mask
        for label, outcome in models.items():
            y = model_output(outcome.fit.variant, record)
            shown[label] = y + float(np.mean((record.y_um - y)[counted]))
        columns = (record.t_s, record.u_V, record.y_um, shown, counted.astype(np.float64))
        found.append(View(record.name, record.role, *columns))
    return tuple(found)
