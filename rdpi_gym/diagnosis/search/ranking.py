"""From refits to a ranking, and from splits of the records to a confidence."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rdpi_gym.diagnosis.results import Candidate
from rdpi_gym.diagnosis.search.candidates import (
    AS_IT_IS,
    Outcome,
    Setting,
    Trial,
    assess,
    attempt,
    evidence_of,
    of_effect,
    refit,
)
from rdpi_gym.diagnosis.words import template
from rdpi_gym.identification.joint import fit_joint
from rdpi_gym.identification.residuals import beats
from rdpi_gym.measurement import Record, hold_out_blocks
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, forms_of, in_chain_order
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.parallel import ALONE, Pool

# An effect is earned by this much of the noise's variance, and this share of what exceeds it.
LEAST_GAIN = 0.05
# Closer to the noise floor than this share of its variance, no further effect is looked for.
AT_FLOOR = 0.10
LEAST_SHARE = 0.10
# Of the training error's excess, less is no sign of an effect, whatever it does elsewhere.
LEAST_TRAIN_SHARE = 0.05
LEAST_CONFIDENCE = 0.8
# Rivals whose error lies this close (share of the winner's gain, or of the noise) are one class.
SAME_GAIN = 0.02
# The same of what the best of them leaves: a large gain makes no large remainders alike.
_SAME_LEFT = 0.25
# The same in the end, where the thresholds are found too: only what the noise leaves open.
SETTLED_GAIN = 0.005
# A held-out record may lose this share of the gain before the candidate counts as harmful.
_HARM = 0.5
# What a candidate with a parameter at its bound is worth of what it gains.
_AT_BOUND = 0.5


@dataclass(frozen=True)
class Ranked:
    """A candidate and what its refit decides."""

    outcome: Outcome  # the refit
    candidate: Candidate  # what is reported
    earned: bool  # whether it may be added
    # Share of the excess that it takes away from training and from validation records: the smaller
    # of the two
    worth: float = 0.0
    train_share: float = 0.0  # share of the excess that it takes away from the records to fit alone
    worse: bool = False  # whether a held-out record becomes clearly worse
    # The largest `train_share` of all the forms that were tried, where a round knows them
    most_train_share: float = 0.0
    without: Outcome | None = None  # the model that it was added to
    within: bool = False  # whether it was judged by blocks held out of every record


def rank(
    current: Outcome,
    outcomes: Sequence[Outcome],
    kinds: Sequence[type[Effect]],
    noise_um: float,
    seed: int,
    same_gain: float | None = None,
) -> list[Ranked]:
    """Judge candidates by validation records, best first."""
    variance = noise_um**2
    excess = max(current.mean_square - variance, 0.0)
    signatures = {kind.name: kind.signature for kind in kinds}
    usable = sorted((o for o in outcomes if o.fit is not None), key=lambda o: o.mean_square)
    rng = np.random.default_rng(seed)
    ranked = []
    for outcome in usable:
        gain = current.mean_square - outcome.mean_square
        rivals = [o for o in usable if o is not outcome]
        close = (
            max(
                min(SAME_GAIN * max(gain, 0.0), _SAME_LEFT * usable[0].mean_square),
                SAME_GAIN * variance,
            )
            if same_gain is None
            else same_gain * min(o.mean_square for o in usable)
        )
        same = [o.effect for o in rivals if abs(o.mean_square - outcome.mean_square) <= close]
        others = [o for o in rivals if o.effect not in same]
        confidence = _confidence(current, outcome, others, rng)
        remarks = (
            [template("at bound", parameter=n) for n in outcome.fit.at_bound] if outcome.fit else []
        )
        worse = _worse_records(current, outcome, gain, variance)
        remarks += [template("worse", record=name) for name in worse]
        if outcome.fit and not outcome.fit.converged:
            ended = outcome.fit.passes > AS_IT_IS
            remarks.append(template("not ended" if ended else "no first steps"))
        share = gain / excess if excess > 0 else 0.0
        enough = gain > max(LEAST_GAIN * variance, LEAST_SHARE * excess)
        helps = beats(current.pieces, outcome.pieces, rng) >= LEAST_CONFIDENCE
        train_share = share_of_train(current, outcome, variance)
        helps = helps and train_share >= LEAST_TRAIN_SHARE
        candidate = Candidate(
            effect=outcome.effect,
            errors=outcome.errors,
            parameters={},
            standard_errors={},
            confidence=confidence,
            share=share,
            indistinguishable=tuple(same),
            evidence=evidence_of(
                current.errors, outcome.errors, signatures.get(outcome.effect, "")
            ),
            remarks=tuple(remarks),
        )
        candidate = of_effect(candidate, outcome.fit, outcome.effect)
        ranked.append(
            Ranked(
                outcome,
                candidate,
                enough and helps and not worse,
                min(share, train_share) * (_AT_BOUND if own_bounds(outcome) else 1.0),
                train_share,
                bool(worse),
                without=current,
            )
        )
    failed = [o for o in outcomes if o.fit is None]
    return ranked + [Ranked(o, _failed(o), False, without=current) for o in failed]


def not_missed(noise_um: float) -> float:
    """Return by how much the error (µm², mean square) may grow without what was added, and not count."""
    return 0.5 * LEAST_GAIN * noise_um**2


def own_bounds(outcome: Outcome) -> tuple[str, ...]:
    """Return the parameters of a candidate that ended at a bound: it is of a class, not measured."""
    if outcome.fit is None:
        return ()
    return tuple(n for n in outcome.fit.at_bound if n.startswith(f"{outcome.effect}."))


def share_of_train(current: Outcome, outcome: Outcome, variance: float) -> float:
    """Return what a candidate takes of the excess over the noise on the records to fit."""
    before, after = current.errors.train_rmse_um**2, outcome.errors.train_rmse_um**2
    return (before - after) / max(before - variance, 1e-300)


def _confidence(
    current: Outcome, outcome: Outcome, others: Sequence[Outcome], rng: np.random.Generator
) -> float:
    """Probability of beating the model without it and every rival outside its class."""
    return min([beats(o.pieces, outcome.pieces, rng) for o in (current, *others)])


def _worse_records(current: Outcome, outcome: Outcome, gain: float, variance: float) -> list[str]:
    before: Array = current.pieces.mean(axis=1)
    after: Array = outcome.pieces.mean(axis=1)
    names = list(outcome.errors.by_record_um)[-len(after) :]
    allowed = _HARM * max(gain, 0.0) + 0.25 * variance
    return [name for name, b, a in zip(names, before, after, strict=True) if a - b > allowed]


def _failed(outcome: Outcome) -> Candidate:
    return Candidate(
        outcome.effect,
        outcome.errors,
        {},
        {},
        0.0,
        -math.inf,
        (),
        outcome.remark,
        (outcome.remark,),
    )


# Samples and passes of a refit that begins where the final model stands.
_SAMPLES, _PASSES = 8_000, 6
# Of a record, the part at its beginning that one split leaves out of the fit.
_OPENING = 8
LEAST_STABLE = 0.5
"""Share of the splits below which an effect is not kept."""


@dataclass(frozen=True)
class Standing:
    """Confidence in an effect of a model."""

    confidence: float  # how sure it is: the mean over the splits of how often it wins there, 0 to 1
    # Validation error (µm rms) of all the others without it, as the records are given
    without_um: float


@dataclass(frozen=True)
class Split:
    """Records to fit and to judge by, of one cross-validation split."""

    name: str  # in words
    # Records with the samples that count
    train: tuple[Record, ...]
    validation: tuple[Record, ...]


def splits(setting: Setting, quarters: bool) -> tuple[Split, ...]:
    """Return the cross-validation splits of a data set beside the given one.

    Notes
    -----
    The given split; the beginning of each record left out; the roles exchanged; half of the
    validation record added to those to fit. Where quarters of the same records are held out, the
    others take their turns.
    """
    given = Split("as given", setting.train, setting.validation)
    opening = Split(
        "without the beginning of each record",
        tuple(_without_opening(r) for r in setting.train),
        setting.validation,
    )
    if quarters:
        turns = [_turn(setting, k) for k in (0, 1, 2)]
        return (given, *turns)
    halves = [_halves(r) for r in setting.validation]
    more = (*setting.train, *(first for first, _ in halves))
    return (
        given,
        opening,
        Split("roles exchanged", setting.validation, setting.train),
        Split("half of the validation records to fit", more, tuple(b for _, b in halves)),
    )


def in_blocks(setting: Setting) -> Setting:
    """Return a data set in which blocks of every record are held out in turn."""
    parts = [hold_out_blocks(r) for r in dict.fromkeys((*setting.train, *setting.validation))]
    return replace(
        setting, train=tuple(fit for fit, _ in parts), validation=tuple(held for _, held in parts)
    )


def exchanged(setting: Setting, quarters: bool) -> Setting | None:
    """Return a data set with the roles of its records exchanged; None where they are the same ones."""
    if quarters:
        return None
    return setting.exchanged()


def _without_opening(record: Record) -> Record:
    counted = np.flatnonzero(record.error_mask)
    mask = record.error_mask.copy()
    mask[counted[: len(counted) // _OPENING]] = False
    return replace(record, error_mask=mask)


def _halves(record: Record) -> tuple[Record, Record]:
    counted = np.flatnonzero(record.error_mask)
    middle = counted[len(counted) // 2]
    before = np.arange(len(record.error_mask)) < middle
    return (
        replace(record, error_mask=record.error_mask & before),
        replace(record, error_mask=record.error_mask & ~before),
    )


def _turn(setting: Setting, quarter: int) -> Split:
    """Hold out another quarter of each record; the two of a setting hold all samples together."""
    train, validation = [], []
    for fitted, held in zip(setting.train, setting.validation, strict=True):
        counted = np.flatnonzero(fitted.error_mask | held.error_mask)
        mask = np.zeros_like(fitted.error_mask)
        mask[np.array_split(counted, 4)[quarter]] = True
        whole = fitted.error_mask | held.error_mask
        train.append(replace(fitted, error_mask=whole & ~mask))
        validation.append(replace(held, error_mask=mask))
    return Split(f"quarter {quarter + 1} held out", tuple(train), tuple(validation))


def stability(
    setting: Setting,
    outcome: Outcome,
    rivals: Mapping[str, Sequence[Effect]],
    quarters: bool,
    seed: int,
    report: Callable[[int, int], None],
    pool: Pool = ALONE,
) -> dict[str, Standing]:
    """Return how each effect stands: how often it wins in splits, and what is missed without it."""
    assert outcome.fit is not None
    variant, smoothness = outcome.fit.variant, outcome.fit.smoothness
    ways = splits(setting, quarters)
    won: dict[str, list[float]] = {name: [] for name in rivals}
    without_um: dict[str, float] = {}
    rng = np.random.default_rng(seed)
    fields = {}
    for name, others in rivals.items():
        kept = tuple(e for e in variant.effects if e.name != name)
        fields[name] = [kept, *(in_chain_order([*kept, rival]) for rival in others)]
    every = [variant.effects, *(f for own in fields.values() for f in own)]
    cases = [
        (replace(setting, train=way.train, validation=way.validation), effects)
        for way in ways
        for effects in every
    ]
    done = 0

    def seen(outcome: Outcome) -> None:
        nonlocal done
        done += 1
        if done % len(every) == 0 and done < len(cases):
            report(done // len(every), len(ways))

    report(0, len(ways))
    found = iter(pool.map(partial(_quick, variant.hysteresis, smoothness), cases, seen))
    for split in ways:
        full = next(found)
        for name, own in fields.items():
            outcomes = [next(found) for _ in own]
            shares = (beats(o.pieces, full.pieces, rng) for o in outcomes if o.fit is not None)
            won[name].append(0.0 if full.fit is None else min(shares, default=1.0))
            if split is ways[0]:
                without_um[name] = outcomes[0].errors.validation_rmse_um
    return {name: Standing(float(np.mean(won[name])), without_um[name]) for name in rivals}


def _quick(hysteresis: Core, smoothness: float, case: tuple[Setting, Sequence[Effect]]) -> Outcome:
    setting, effects = case

    def refitted() -> Outcome:
        fit = fit_joint(
            setting.train, hysteresis, effects, _PASSES, samples=_SAMPLES, smoothness=smoothness
        )
        return assess(setting, "", fit)

    return attempt(refitted)


# A form of more freedom takes at least this share of what the simpler one leaves over the noise,
# and so much again for each parameter more.
_PRICE, _PRICE_EACH = 0.10, 0.03
# The same for a form of no more freedom.
_AS_FREE = 0.02
# Of that price, what it has to be worth on the records to fit too.
_TRAINS = 0.3
# Candidates of a round that are tried in their further forms.
_LEADERS = 4
# Of the error without it, what the simplest form leaves at most to be worth another.
_SHOWS = 0.995


def further_forms(
    current: Outcome,
    simple: Sequence[Outcome],
    kinds: Mapping[str, type[Effect]],
    present: tuple[Effect, ...],
    scale: DataScale,
    suspects: Collection[str] = (),
) -> list[Trial]:
    """Return the further forms of the leading candidates as trials."""
    shown = [o.effect for o in simple if o.fit and o.mean_square < _SHOWS**2 * current.mean_square]
    # what the best of them is mistaken for may be better in another form
    kin = [name for first in shown[:1] for name in kinds[first].mistaken_for]
    others = (n for n in (*kin, *suspects) if n in kinds)
    names = dict.fromkeys((*shown[:_LEADERS], *others))
    fitted = {o.effect: o for o in simple}
    return [
        Trial(form, present, _starts(form, fitted.get(name), scale))
        for name in names
        for form in forms_of(kinds[name])[1:]
    ]


def _starts(
    form: type[Effect], simple: Outcome | None, scale: DataScale
) -> tuple[Effect, ...] | None:
    if simple is None or simple.fit is None:
        return None
    own = next(e for e in simple.fit.variant.effects if e.name == simple.effect)
    return _distinct((*form.from_simpler(own, scale), *form.starts(scale)))


def _distinct(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    return tuple(dict.fromkeys(effects))


def better_forms(present: tuple[Effect, ...], scale: DataScale) -> list[Trial]:
    """Return every further form of the effects that are there, each begun from the present one."""
    trials = []
    for effect in present:
        others = tuple(e for e in present if e is not effect)
        forms = forms_of(type(effect))
        further = forms[[f.form for f in forms].index(effect.form) + 1 :]
        trials += [
            Trial(form, others, _distinct((*form.from_simpler(effect, scale), *form.starts(scale))))
            for form in further
        ]
    return trials


def in_best_form(outcomes: Sequence[Outcome], noise_um: float) -> list[Outcome]:
    """Return one refit for each name: the form whose held-out error pays for its freedom."""
    by_name: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        by_name.setdefault(outcome.effect, []).append(outcome)
    best = [_worth_its_freedom(forms, noise_um) for forms in by_name.values()]
    return sorted(best, key=lambda o: o.mean_square)


def _worth_its_freedom(forms: Sequence[Outcome], noise_um: float) -> Outcome:
    variance = noise_um**2
    ordered = sorted(forms, key=_freedom)
    best = ordered[0]
    for outcome in ordered[1:]:
        if outcome.fit is None:
            continue
        more = _freedom(outcome) - _freedom(best)
        left = max(best.mean_square - variance, 0.0)
        share = _PRICE + _PRICE_EACH * more if more > 0 else _AS_FREE
        price = max(LEAST_GAIN * variance, share * left)
        before, after = (o.errors.train_rmse_um**2 for o in (best, outcome))
        least = _TRAINS if more > 0 else -_TRAINS
        trains = before - after > least * price * max(before - variance, 0.0) / max(left, 1e-300)
        if best.fit is None or (trains and best.mean_square - outcome.mean_square > price):
            best = outcome
    return best


def _freedom(outcome: Outcome) -> int:
    if outcome.fit is None:
        return 0
    effects = (e for e in outcome.fit.variant.effects if e.name == outcome.effect)
    return sum(not p.fixed for effect in effects for p in effect.parameters)


def simplified(
    setting: Setting,
    outcome: Outcome,
    hysteresis: Core,
    noise_um: float,
    report: Callable[[int, int], None],
) -> tuple[Outcome, dict[str, str]]:
    """Try simpler forms back, now that all other effects are there."""
    assert outcome.fit is not None
    given_up: dict[str, str] = {}
    rich = [effect for effect in outcome.fit.variant.effects if effect.form]
    for done, effect in enumerate(rich):
        report(done, len(rich))
        forms = forms_of(type(effect))
        for form in forms[: [f.form for f in forms].index(effect.form)]:
            assert outcome.fit is not None
            others = in_chain_order(e for e in outcome.fit.variant.effects if e.name != effect.name)
            simpler = refit(setting, hysteresis, others, form)
            loss = simpler.mean_square - outcome.mean_square
            if simpler.fit is not None and loss < not_missed(noise_um):
                outcome, given_up[effect.name] = simpler, effect.form
                break
    return outcome, given_up
