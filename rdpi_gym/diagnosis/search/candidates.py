"""Candidates: an effect refitted together with everything else, and what that does to the error."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import groupby

import numpy as np

from rdpi_gym.diagnosis.results import Candidate, Errors
from rdpi_gym.diagnosis.search.checkpoint import Checkpoint
from rdpi_gym.diagnosis.words import template
from rdpi_gym.identification.cores import FIRST_SAMPLES
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import (
    NO_FIT,
    FirstSteps,
    JointFit,
    first_steps,
    fit_joint,
    kept_samples,
)
from rdpi_gym.identification.residuals import PIECES, centred_residual, pieces_of, rms_over
from rdpi_gym.measurement import Record
from rdpi_gym.measurement.quantities import template_of
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.base import DataScale, Effect, in_chain_order
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.parallel import Pool

# Samples in the squares of a search: a thousand for each number; the errors are of all samples.
SEARCH_SAMPLES = 24_000
# Steps in which every start of a candidate shows which optimum is worth the rest.
_FIRST_STEPS = 4
# Passes of a whole refit.
_PASSES = 30
# Along a cusp: reach in the parameter's logarithm, sections, and passes for everything else.
_CUSP_REACH, _CUSP_STEPS, _CUSP_PASSES = 0.2, 16, 3
# Rounds along cusps of effects that are there already, ended by one that gains less than this.
_CUSP_ROUNDS, _CUSP_ENDS = 4, 0.9
# Passes of a refit that does not move on: the weights and the errors of where it stands.
AS_IT_IS = 2
# Starts of a form for which the weights are solved, and those that are followed further.
_LOOKED_AT, _RACED = 4, 2
# Times the number of parameters over that of samples, what a fit takes of the noise by chance.
CHANCE = 2.0
# Only where a start takes this much from the error without the effect is there a cusp to find.
_CUSP_SHOWS = 0.998


@dataclass(frozen=True)
class Trial:
    """One refit of a round."""

    kind: type[Effect]  # the candidate: an effect in one of its forms
    present: tuple[Effect, ...]  # effects that are fitted with it
    # Where its fit begins; None: from the starts of its own
    starts: tuple[Effect, ...] | None = None


@dataclass(frozen=True)
class Outcome:
    """A refit and its squared errors."""

    effect: str  # name of the candidate; empty for a refit without one
    fit: JointFit | None  # the refit; None where none converged
    errors: Errors  # of the refit
    # float64[R, PIECES]: mean squared error (µm²) of the pieces of each validation record, offset
    # free
    pieces: Array
    remark: str = ""  # why there is no refit
    form: str = ""  # of the candidate; empty for its simplest

    @property
    def mean_square(self) -> float:
        """Mean squared validation error (µm²)."""
        return self.errors.validation_rmse_um**2

    @property
    def fitted(self) -> Effect:
        """The candidate, as it was fitted."""
        assert self.fit is not None
        return next(e for e in self.fit.variant.effects if e.name == self.effect)


@dataclass(frozen=True)
class Setting:
    """Data and settings that all refits of one data set share."""

    # Records to fit and to judge by
    train: tuple[Record, ...]
    validation: tuple[Record, ...]
    scale: DataScale  # size of the data
    # Price of uneven weights, as ``fit_joint`` has it
    smoothness: float = 0.0

    def exchanged(self) -> Setting:
        """Return the same data, fitted where they were judged and judged where they were fitted."""
        return replace(self, train=self.validation, validation=self.train)

    def fit(
        self,
        hysteresis: Core,
        effects: Sequence[Effect] = (),
        passes: int = _PASSES,
        held: frozenset[str] = frozenset(),
        samples: int | None = None,
    ) -> JointFit:
        """Fit a model to the training records, as ``fit_joint`` does."""
        return fit_joint(
            self.train, hysteresis, effects, passes, held=held, samples=samples,
            smoothness=self.smoothness,
        )  # fmt: skip

    def first_steps(
        self,
        hysteresis: Core,
        effects: Sequence[Effect],
        steps: int,
        held: frozenset[str] = frozenset(),
        near: FirstSteps | None = None,
        least_um: float = math.inf,
    ) -> FirstSteps:
        """Go the first steps of that fit on few samples, as the function of that name does."""
        return first_steps(
            self.train, hysteresis, effects, steps, held, FIRST_SAMPLES, self.smoothness, near,
            least_um,
        )  # fmt: skip


@dataclass(frozen=True)
class Bare:
    """A model that candidates are added to; they share its first steps."""

    setting: Setting
    hysteresis: Core
    effects: tuple[Effect, ...]

    @cached_property
    def begun(self) -> FirstSteps:
        """The model with its best weights."""
        return self.setting.first_steps(self.hysteresis, self.effects, 0)

    @cached_property
    def stepped_rmse_um(self) -> float:
        """Training error (µm) after as many steps as a start of a candidate takes."""
        return self.setting.first_steps(self.hysteresis, self.effects, _FIRST_STEPS).train_rmse_um


def assess(setting: Setting, name: str, fit: JointFit) -> Outcome:
    """Simulate a refit over all records."""
    by_record: dict[str, float] = {}
    train, _ = _squares(fit.variant, setting.train, by_record)
    validation, pieces = _squares(fit.variant, setting.validation, by_record)
    spread = max(float(np.ptp(r.y_um[r.error_mask])) for r in setting.validation)
    relative = 100.0 * validation / spread if spread > 0.0 else math.inf
    errors = Errors(train, validation, relative, by_record)
    forms = {effect.name: effect.form for effect in fit.variant.effects}
    return Outcome(name, fit, errors, pieces, form=forms.get(name, ""))


def of_effect(candidate: Candidate, fit: JointFit | None, name: str) -> Candidate:
    """Return a candidate as that of an effect in a refit: its parameters and their errors."""
    if fit is None:
        return candidate
    effect = {e.name: e for e in fit.variant.effects}[name]
    own = f"{name}."
    found = fit.standard_errors.items()
    errors = {key.removeprefix(own): e for key, e in found if key.startswith(own)}
    return replace(
        candidate,
        effect=name,
        form=effect.form,
        parameters=effect.values,
        standard_errors=errors,
    )


def evidence_of(before: Errors, after: Errors, signature: str) -> str:
    """Name the record on which a candidate gains most, and what it leaves there, in a sentence."""
    falls = {
        name: before.by_record_um[name] - after.by_record_um[name] for name in after.by_record_um
    }
    most = max(falls, key=lambda name: falls[name])
    return template("evidence", record=most, signature=template_of(signature))


def refit(
    setting: Setting,
    hysteresis: Core,
    present: Sequence[Effect],
    kind: type[Effect] | None,
    starts: Sequence[Effect] | None = None,
    least_um: float = math.inf,
    bare: Bare | None = None,
) -> Outcome:
    """Fit the core, the effects present and a candidate together, from each of its starts.

    A candidate of which no fit comes about ends nothing: its outcome says why.
    """
    if kind is None:
        return attempt(lambda: assess(setting, "", setting.fit(hysteresis, present)))
    others = tuple(effect for effect in present if effect.name != kind.name)
    if bare is None or bare.effects != others:
        bare = Bare(setting, hysteresis, others)
    make = partial(_refit, bare, kind, starts, least_um)
    # a user's effect may raise anything; what else ours raises is a fault of the program
    caught = NO_FIT if kind.name in CATALOGUE else (Exception,)
    return attempt(make, kind.name, kind.form, caught)


def attempt(
    make: Callable[[], Outcome],
    effect: str = "",
    form: str = "",
    caught: tuple[type[Exception], ...] = NO_FIT,
) -> Outcome:
    """Refit a candidate, or say why there is no refit: none of several ends a search."""
    try:
        return make()
    except caught as error:
        return _without_fit(effect, form, _reason(error))


def _without_fit(effect: str, form: str, reason: str) -> Outcome:
    nowhere = Errors(math.inf, math.inf, math.inf, {})
    return Outcome(
        effect, None, nowhere, np.zeros((0, PIECES)), template("not converged", reason=reason), form
    )


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".splitlines()[0]


def _refit(
    bare: Bare, kind: type[Effect], starts: Sequence[Effect] | None, least_um: float
) -> Outcome:
    setting, hysteresis, present = bare.setting, bare.hysteresis, bare.effects
    troubles: list[str] = []
    held = frozenset() if kind.kinked is None else frozenset({f"{kind.name}.{kind.kinked}"})

    def begun(places: Sequence[Effect], steps: int) -> list[FirstSteps]:
        fits: list[FirstSteps] = []
        for place in places:
            effects = in_chain_order([*present, place])
            near = fits[0] if fits and not held else None
            try:
                fit = setting.first_steps(hysteresis, effects, steps, held, near, least_um)
            except NO_FIT as error:  # another start may lead somewhere
                troubles.append(_reason(error))
                continue
            if math.isfinite(fit.train_rmse_um):
                fits.append(fit)
        return sorted(fits, key=lambda fit: fit.train_rmse_um)

    places = kind.starts(setting.scale) if starts is None else starts
    least_um *= _by_chance(setting, kind)
    if (held or kind.form) and len(places) > _LOOKED_AT:
        # a form has starts for each optimum: most are seen to be worse at once
        places = nearest(setting.train, bare.begun, places, FIRST_SAMPLES, _LOOKED_AT)
    if kind.form and len(places) > _RACED:
        places = [_own(fit.variant, kind.name) for fit in begun(places, 0)[:_RACED]]
    first = begun(places, 0 if held else _FIRST_STEPS)
    if not first:
        return _without_fit(kind.name, kind.form, (*troubles, template("not finite"))[0])
    variant, hopeful = first[0].variant, first[0].train_rmse_um < least_um
    if held:
        best = setting.fit(variant.hysteresis, variant.effects, AS_IT_IS, held, SEARCH_SAMPLES)
        if first[0].train_rmse_um < _CUSP_SHOWS * bare.stepped_rmse_um:
            hopeful, best = True, _along_cusp(setting, best, kind.name, str(kind.kinked))
        variant = best.variant
    passes = _PASSES if hopeful else AS_IT_IS
    best = setting.fit(variant.hysteresis, variant.effects, passes, samples=SEARCH_SAMPLES)
    return assess(setting, kind.name, best)


def _by_chance(setting: Setting, kind: type[Effect]) -> float:
    """Return the factor on an error that as many numbers as a candidate has take by chance."""
    numbers = sum(not p.fixed for p in kind.parameters)
    counted = sum(int(record.error_mask.sum()) for record in setting.train)
    return math.sqrt(max(1.0 - CHANCE * numbers / min(counted, FIRST_SAMPLES), 0.0))


def _own(variant: Variant[Core], name: str) -> Effect:
    return next(effect for effect in variant.effects if effect.name == name)


def past_cusps(setting: Setting, outcome: Outcome, present: Sequence[Effect]) -> Outcome:
    """Move the effects that are there already along their cusps too, where no refit leads them."""
    moved = attempt(lambda: _past_cusps(setting, outcome, present))
    return outcome if moved.fit is None else moved


def _past_cusps(setting: Setting, outcome: Outcome, present: Sequence[Effect]) -> Outcome:
    if outcome.fit is None:
        return outcome
    fit = outcome.fit
    # the refit may have one of them in another form
    names = {e.name for e in present} - {outcome.effect}
    kinked = [(e.name, e.kinked) for e in fit.variant.effects if e.name in names and e.kinked]
    if not kinked:
        return outcome
    for _ in range(_CUSP_ROUNDS):
        before = fit.train_rmse_um
        for name, parameter in kinked:
            fit = _along_cusp(setting, fit, name, parameter)
        fit = setting.fit(fit.variant.hysteresis, fit.variant.effects, samples=SEARCH_SAMPLES)
        if fit.train_rmse_um > _CUSP_ENDS * before:
            break
    return assess(setting, outcome.effect, fit)


def _along_cusp(setting: Setting, fit: JointFit, effect: str, parameter: str) -> JointFit:
    """Search along one parameter, everything else refitted: no gradient leads into a cusp."""
    held = frozenset({f"{effect}.{parameter}"})
    best = fit

    def attempt(log_value: float) -> float:
        nonlocal best
        effects = [
            e.with_values({parameter: math.exp(log_value)}) if e.name == effect else e
            for e in best.variant.effects
        ]
        trial = setting.fit(best.variant.hysteresis, effects, _CUSP_PASSES, held=held,
            samples=SEARCH_SAMPLES,
        )  # fmt: skip
        if trial.train_rmse_um < best.train_rmse_um:
            best = trial
        return trial.train_rmse_um

    here = {e.name: e for e in fit.variant.effects}[effect].values[parameter]
    low, high = math.log(here) - _CUSP_REACH, math.log(here) + _CUSP_REACH
    ratio = (math.sqrt(5.0) - 1.0) / 2.0
    left, right = high - ratio * (high - low), low + ratio * (high - low)
    at_left, at_right = attempt(left), attempt(right)
    for _ in range(_CUSP_STEPS):
        if at_left < at_right:
            high, right, at_right = right, left, at_left
            left = high - ratio * (high - low)
            at_left = attempt(left)
        else:
            low, left, at_left = left, right, at_right
            right = low + ratio * (high - low)
            at_right = attempt(right)
    return best


def _squares(
    variant: Variant[Core], records: Sequence[Record], by_record: dict[str, float]
) -> tuple[float, Array]:
    lefts = [centred_residual(variant, record) for record in records]
    for record, left in zip(records, lefts, strict=True):
        label = record.name
        while label in by_record:  # the held-out part of a record that is also fitted
            label += " (held out)"
        by_record[label] = math.sqrt(float((left**2).mean()))
    errors = list(by_record.values())[-len(lefts) :]
    return rms_over(errors, [left.size for left in lefts]), pieces_of(lefts)


def refit_all(
    bare: Bare,
    trials: Sequence[Trial],
    checkpoint: Checkpoint,
    pool: Pool,
    report: Callable[[int, int], None],
    least_um: float = math.inf,
    seen: Callable[[Outcome], None] = lambda outcome: None,
) -> list[Outcome]:
    """Refit every candidate, in parallel; best validation error first."""
    setting, hysteresis = bare.setting, bare.hysteresis
    outcomes: list[Outcome] = []
    unfinished: list[Trial] = []
    for trial in trials:
        fit = checkpoint.get(
            hysteresis, trial.present, trial.kind, trial.starts, setting.smoothness
        )
        if fit is None:
            unfinished.append(trial)
        else:
            outcomes.append(assess(setting, trial.kind.name, fit))
            seen(outcomes[-1])
    report(len(outcomes), len(trials))
    by_name = {(trial.kind.name, trial.kind.form): trial for trial in unfinished}
    done = len(outcomes)

    def heard(outcome: Outcome) -> None:
        nonlocal done
        if outcome.fit is not None:
            trial = by_name[outcome.effect, outcome.form]
            checkpoint.put(hysteresis, trial.present, trial.kind, trial.starts, outcome.fit)
        seen(outcome)
        done += 1
        report(done, len(trials))

    outcomes += pool.map(partial(_refit_trial, bare, least_um), unfinished, heard)
    return sorted(outcomes, key=lambda o: o.mean_square)


def refit_kinds(
    pool: Pool,
    setting: Setting,
    hysteresis: Core,
    present: Sequence[Effect],
    kinds: Sequence[type[Effect]],
) -> list[Outcome]:
    """Refit a model with each of several candidates, from their own starts."""
    return pool.map(partial(refit, setting, hysteresis, tuple(present)), kinds)


def _refit_trial(bare: Bare, least_um: float, trial: Trial) -> Outcome:
    return refit(
        bare.setting, bare.hysteresis, trial.present, trial.kind, trial.starts, least_um, bare
    )


# Of the largest singular value, what is no direction of its own.
_DEPENDENT = 1e-10


def taken_by(
    records: Sequence[Record], begun: FirstSteps, traces: Sequence[Effect], samples: int
) -> float:
    """Return the share of what a model leaves that a sum of small effects takes beside its weights."""
    products = _products(records, begun, traces, samples)
    beside = len(products) - len(traces) - 1
    whole = float(products[-1, -1])
    every = list(range(len(products) - 1))
    return (_least(products, every[:beside]) - _least(products, every)) / max(whole, 1e-300)


def nearest(
    records: Sequence[Record],
    begun: FirstSteps,
    places: Sequence[Effect],
    samples: int,
    count: int,
) -> list[Effect]:
    """Return the starts of an effect that leave least beside the weights.

    Half of them as they are; the others with their response by any factor, as the right place may
    still have a wrong size.
    """
    products = _products(records, begun, places, samples)
    beside = list(range(len(products) - len(places) - 1))
    own, scaled = [], []
    for k in range(len(places)):
        mine = len(beside) + k
        scaled.append(_least(products, [*beside, mine]))
        # the response taken off what is left, in place of what is left
        taken = products.copy()
        taken[:, -1] -= products[:, mine]
        taken[-1, -1] = products[-1, -1] - 2.0 * products[-1, mine] + products[mine, mine]
        own.append(_least(taken, beside))
    first = np.argsort(own, kind="stable")[: count - count // 2].tolist()
    others = [k for k in np.argsort(scaled, kind="stable").tolist() if k not in first]
    return [places[k] for k in (*first, *others[: count // 2])]


def _products(
    records: Sequence[Record], begun: FirstSteps, traces: Sequence[Effect], samples: int
) -> Array:
    """Return the products of the weights' columns, of the responses and of what is left."""
    moving = np.array(begun.variant.hysteresis.gains) != 0.0
    products = np.zeros((int(moving.sum()) + len(traces) + 1,) * 2)
    kept = kept_samples(records, samples)
    for record, index, columns, left in zip(
        records, kept, begun.columns, begun.left_um, strict=True
    ):
        answers = _answers(begun.variant, traces, record)[index]
        rows = np.hstack([columns[:, moving], answers - answers.mean(axis=0), left[:, None]])
        products += rows.T @ rows
    return products


def _answers(variant: Variant[Core], traces: Sequence[Effect], record: Record) -> Array:
    """Return by how much each of the effects moves the displacement (µm), ``[T, K]``."""
    without = simulate_effects([variant], record)
    columns = []
    for _, alike in groupby(traces, type):
        lanes = [
            replace(variant, effects=in_chain_order([*variant.effects, trace])) for trace in alike
        ]
        columns.append(simulate_effects(lanes, record) - without)
    return np.hstack(columns)


def _least(products: Array, columns: Sequence[int]) -> float:
    """Return the least squares that some columns leave of the last one."""
    spread = np.sqrt(np.maximum(np.diag(products)[columns], 1e-300))
    gram = products[np.ix_(columns, columns)] / np.outer(spread, spread)
    rhs = products[columns, -1] / spread
    values, vectors = np.linalg.eigh(gram)
    own = values > _DEPENDENT * values[-1]
    part = vectors[:, own].T @ rhs
    return float(products[-1, -1] - np.sum(part**2 / values[own]))
