"""The moves: sets that differ from one by an effect, a form, a core, a pair, a free block or a clock.

A first look takes a few steps of a refit on few samples, the derivatives by the weights shared, and
the race drops what is worse than the best of the looks by the one decision.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.diagnosis.beam.constants import (
    FOLLOWED,
    LEVEL,
    LOOKED,
    PAIRS,
    PASSES,
    RACE_SAMPLES,
    RACE_STEPS,
    REFITTED,
    ROUNDS,
)
from rdpi_gym.diagnosis.beam.decision import chances, draw_blocks
from rdpi_gym.diagnosis.beam.evidence import Clock, ClockKind, Evidence, Offer
from rdpi_gym.diagnosis.beam.models import Model, clock_column, of_experiment
from rdpi_gym.diagnosis.beam.score import (
    Blocks,
    cross_fitted,
    further_step,
    gone_on,
    squares,
    whole_step,
)
from rdpi_gym.diagnosis.beam.signatures import Foresight, Promise, Signature, signatures
from rdpi_gym.identification.cores import first_fit
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.joint import (
    FirstSteps,
    JointFit,
    Tangents,
    caught_with,
    first_steps,
    fit_joint,
    kept_samples,
    or_none,
    tangents,
    tangents_near,
)
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import forms_of
from rdpi_gym.plant.effects.base import DataScale, Effect, in_chain_order
from rdpi_gym.plant.effects.unknown import Unknown, WithTwoMemories
from rdpi_gym.support.arrays import Array

CLOCK_STARTS: Mapping[ClockKind, tuple[float, ...]] = {
    "delay": (0.0,), "step": (0.0, math.log(2.0), -math.log(2.0)), "skew": (0.0,)
}  # fmt: skip
"""Kinds of clock faults, and the sizes from which each is looked at: dividers of clocks halve."""
FREE_BLOCKS: tuple[type[Effect], ...] = tuple(
    form for form in forms_of(Unknown) if not issubclass(form, WithTwoMemories)
)
"""Free blocks: a curve, terms of the rate and a memory, at each place of the chain."""


@dataclass(frozen=True, eq=False)
class Look:
    """A first look at a set."""

    model: Model
    lefts: tuple[Array, ...]  # What it leaves where it was not fitted (µm), as of a visited set
    new: tuple[str, ...]  # Names of the effects that the move brings


Starts = tuple[Effect, ...]
"""Effects that a move brings, each at its start."""


@dataclass(frozen=True, eq=False)
class Place:
    """A set from which looks are taken."""

    evidence: Evidence  # With its clocks mended
    model: Model
    offered: Sequence[Signature] = ()  # Of all effects that fit the core, from all their starts
    near: Place | None = None  # A set near by, whose derivatives by the weights it takes

    @cached_property
    def begun(self) -> FirstSteps:
        """The set with its best weights, whose derivatives the looks share."""
        return first_steps(
            self.evidence.train, self.model.core, self.model.effects, 0, samples=RACE_SAMPLES,
            near=None if self.near is None else self.near.begun,
        )  # fmt: skip

    def _steps(self, effects: Sequence[Effect], steps: int) -> FirstSteps:
        return first_steps(
            self.evidence.train, self.model.core, effects, steps, samples=RACE_SAMPLES,
            near=self.begun,
        )  # fmt: skip

    def _refit(self, begun: Variant[Core], held: frozenset[str] = frozenset()) -> JointFit:
        """Refit with derivatives by the weights of its own, but for numbers that are held."""
        core, effects, train = begun.hysteresis, begun.effects, self.evidence.train
        return fit_joint(train, core, effects, PASSES, held=held, samples=RACE_SAMPLES)

    @cached_property
    def foresight(self) -> Foresight:
        """The set linearised on all records."""
        return Foresight(*self._linear, of_experiment(self.begun.variant))

    @cached_property
    def _blocks(self) -> tuple[Blocks, list[Array], float]:
        """Blocks of what the set leaves, the floor of each sample (µm), and the mean score."""
        lefts = self.foresight.lefts
        blocks, floors_um = Blocks.of(lefts), self.evidence.floors_um(lefts, RACE_SAMPLES)
        return blocks, floors_um, float(blocks.scores(lefts, floors_um).mean())

    def _gain(self, lefts: Sequence[Array]) -> float:
        """Gain of these residuals over those of the set (nats a block)."""
        blocks, floors_um, here = self._blocks
        return here - float(blocks.scores(lefts, floors_um).mean())

    def signed(self, starts: Iterable[Effect]) -> list[Signature]:
        """Simulate signatures of starts beside the set."""
        parts, lefts = (self.evidence.train, self.evidence.validation), self._linear
        joined = [np.concatenate([rows[:, -1] for rows in at.rows]) for at in lefts]
        pairs = list(zip(parts, joined, strict=True))
        variant = self.begun.variant
        return signatures(pairs, variant.hysteresis, variant.effects, starts)

    def look_at(self, starts: Starts) -> Look | None:
        """Go some steps from starts; None where these lead nowhere."""
        return or_none(partial(self._look_at, starts), (*self.model.effects, *starts))

    def _look_at(self, starts: Starts) -> Look | None:
        names = tuple(start.name for start in starts)
        begun = Variant(self.model.core, in_chain_order([*self.model.effects, *starts]))
        if len(starts) == 1 and starts[0].kinked:
            begun = self._across_cusps(begun, starts[0])
        if any(start.kinked or start.stands_still for start in starts):
            end = self._refit(begun).variant
            train, core, effects = self.evidence.train, end.hysteresis, end.effects
            fit = first_steps(train, core, effects, 0, samples=RACE_SAMPLES)
        else:
            fit = self._steps(begun.effects, RACE_STEPS)
        return self._seen(fit, names) if math.isfinite(fit.train_rmse_um) else None

    def _across_cusps(self, begun: Variant[Core], start: Effect) -> Variant[Core]:
        """Refit all other numbers at places about a start, then closer about the best, and return that.

        No gradient leads across a cusp, and the others follow the number that is wrong. Where the best
        place is the last one, it goes on from there.
        """
        every, parts = type(start).starts(self.evidence.scale), 2**ROUNDS
        places = sorted(math.log(each.values[str(start.kinked)]) for each in every)
        step = min(np.diff(places), default=0.0) / parts**2
        fits = dict[int, JointFit | None]()

        def left_um(place: int) -> float:
            if place not in fits:
                fits[place] = self._held_at(begun, start, math.exp(place * step))
            fit = fits[place]
            return math.inf if fit is None else fit.train_rmse_um

        nearest_first = sorted(range(-parts, parts + 1), key=abs)
        best = 0
        for stride in (parts, 1):
            middle = best + parts * stride
            while abs(best - middle) == parts * stride:
                middle = best
                best = min((middle + k * stride for k in nearest_first), key=left_um)
        fit = fits[best]
        return begun if fit is None else fit.variant

    def _held_at(self, begun: Variant[Core], start: Effect, factor: float) -> JointFit | None:
        """Refit all numbers but that of a start with a cusp, which is held at so many times its value."""
        name = str(start.kinked)
        near = type(start).within_bounds(**start.values | {name: factor * start.values[name]})
        effects = tuple(near if effect is start else effect for effect in begun.effects)
        place = Variant(begun.hysteresis, effects)
        return or_none(partial(self._refit, place, frozenset({f"{start.name}.{name}"})), effects)

    @cached_property
    def _to_judge(self) -> list[Array]:
        """Derivatives by the weights on the records to judge by."""
        at = tangents(self.evidence.validation, self.begun.variant, RACE_SAMPLES)
        return [rows[:, : len(self.model.core.gains)] for rows in at.rows]

    def _linearised(self, fit: FirstSteps) -> tuple[Tangents, Tangents]:
        """Linearise a model near the set on the records to fit and to judge by."""
        validation = self.evidence.validation
        return fit.linearise(), tangents_near(validation, fit.variant, self._to_judge, RACE_SAMPLES)

    @cached_property
    def _linear(self) -> tuple[Tangents, Tangents]:
        return self._linearised(self.begun)

    def _seen(self, fit: FirstSteps, new: tuple[str, ...]) -> Look | None:
        at, judged = self._linearised(fit)
        core, effects = fit.variant.hysteresis, fit.variant.effects
        model = replace(self.model, core=core, effects=effects)
        lefts = cross_fitted(at.rows, at.moves, judged.rows, of_experiment(fit.variant))
        here = [rows[:, -1] for rows in (*at.rows, *judged.rows)]
        count = len(at.rows)
        if squares(lefts[:count]) < squares(here[:count]):  # a step that was not taken
            own = at.moves & of_experiment(fit.variant)
            lefts = [*here[:count], *gone_on(at.rows, own, judged.rows)]
        return Look(model, tuple(lefts), new) if math.isfinite(squares(lefts)) else None

    def stepped(self) -> Look | None:
        """The set itself after as many steps as a look takes; None where these lead nowhere."""
        return self.look_at(())

    def best_starts(self, starts: Iterable[Effect]) -> list[Effect]:
        """Return of each form the start that promises most."""
        return [each.start for each in self.foresight.promises(self.signed(starts))]

    def without(self, name: str) -> Place:
        """The place without an effect."""
        kept = tuple(e for e in self.model.effects if e.name != name)
        return replace(self, model=replace(self.model, effects=kept), near=self)

    def _promised(self, offered: Iterable[Signature]) -> dict[str, list[tuple[float, Promise]]]:
        """Forms by what they promise to gain (nats a block), by effect, those that promise most first."""
        promised = self.foresight.promises(list(offered))
        gains = [(self._gain(self.foresight.after(each)), each) for each in promised]
        found: dict[str, list[tuple[float, Promise]]] = {}
        for gain, each in sorted(gains, key=lambda own: -own[0]):
            found.setdefault(each.start.name, []).append((gain, each))
        return {name: forms for name, forms in found.items() if forms[0][0] > 0.0}

    @cached_property
    def _left(self) -> list[tuple[Array, Array]]:
        """Times (s) of each record that is fitted, and what the set leaves there (µm)."""
        records = self.evidence.train
        kept = kept_samples(records, RACE_SAMPLES)
        parts = zip(records, kept, self.begun.left_um, strict=True)
        return [(record.t_s[index], left) for record, index, left in parts]

    @cached_property
    def _offered_forms(self) -> list[type[Effect]]:
        """Forms of the effects that the set lacks and its core takes."""
        names, core = self.model.names, type(self.model.core)
        kinds = [kind for name, kind in self.evidence.offer.effects.items() if name not in names]
        return [form for kind in kinds for form in forms_of(kind) if form.fits_in(core)]

    @cached_property
    def _new(self) -> dict[str, list[tuple[float, Promise]]]:
        names, forms = self.model.names, self._offered_forms
        shown = [
            start for form in forms for t_s, left in self._left for start in form.seen_in(t_s, left)
        ]
        # what a law of the rate changes is in proportion to the set's own δ2
        rated = [form for form in forms if form.slot == "rate"]
        shown += [start for form in rated for start in form.starts(self.evidence.scale)]
        signed = self.signed(shown)
        # of a wave over the clock a step from another angle promises as much, and leads nowhere
        stand = [each.start for each in signed if each.start.clocked or each.start.slot == "rate"]
        names |= {start.name for start in stand}
        own = [each for each in self.offered if each.start.name not in names]
        return self._promised([*signed, *own])

    def additions(self) -> list[Starts]:
        """Starts of the effects that promise most, of every form, and of those that no step tells.

        A step says little of a curved form, and nothing of an effect that stands still.
        """
        promised = [own.start for forms in self._first for _, own in forms]
        names = {start.name for start in promised}
        still = [starts for starts in self.still() if starts[0].name not in names]
        return [*((start,) for start in promised), *still]

    def names(self) -> list[Starts]:
        """Start of each of these effects that promises most."""
        return [(forms[0][1].start,) for forms in self._first]

    def still(self) -> list[Starts]:
        """Starts of the effects that stand still in their simplest form."""
        return [
            (start,)
            for form in self._offered_forms
            if form.stands_still and not form.form
            for start in form.starts(self.evidence.scale)
        ]

    @property
    def _first(self) -> list[list[tuple[float, Promise]]]:
        return list(self._new.values())[:LOOKED]

    def pairs(self) -> list[Starts]:
        """Starts of the pairs of effects that promise most beyond the better one of them."""
        best = [forms[0] for forms in self._new.values()][: 2 * LOOKED]
        gains = [
            (self._gain(self.foresight.after_both(a, b)) - max(one, other), a, b)
            for (one, a), (other, b) in combinations(best, 2)
        ]
        gains.sort(key=lambda each: -each[0])
        return [(a.start, b.start) for _, a, b in gains[:PAIRS]]

    def forms(self, of: Effect) -> list[Starts]:
        """Starts of the other forms of an effect that the set without it has: those that promise most."""
        kinds, core = forms_of(self.evidence.offer.effects[of.name]), type(self.model.core)
        richer = kinds[kinds.index(type(of)) + 1 :]
        begun = [
            start
            for kind in richer
            if kind.fits_in(core)
            for start in kind.from_simpler(of, self.evidence.scale)
        ]
        own = [each for each in self.offered if each.start.name == of.name]
        own = [each for each in (*self.signed(begun), *own) if type(each.start) is not type(of)]
        promised = self._promised(own).get(of.name, [])
        return [(each.start,) for _, each in promised[:REFITTED]]

    def blocks(self) -> list[Starts]:
        """Starts of the free blocks that promise most, one at each place of the chain."""
        core, scale = type(self.model.core), self.evidence.scale
        starts = [s for kind in FREE_BLOCKS if kind.fits_in(core) for s in kind.starts(scale)]
        promised = self._promised(self.signed(starts)).get(Unknown.name, [])
        return [(each.start,) for _, each in promised[:FOLLOWED]]

    def clocks(self) -> list[Look]:
        """Looks at faults of the clock of each record, and of all records alike."""
        present = {clock.name for clock in self.model.clocks}
        wanted = [clock for clock in clock_starts(self.evidence) if clock.name not in present]
        looks = [self._clocked(clock) for clock in wanted]
        return [look for look in looks if look is not None]

    def _clocked(self, start: Clock) -> Look | None:
        """Estimate the size of a fault beside all other numbers of the set, from a start."""
        evidence, variant = self.evidence, self.begun.variant
        both = []
        for records, at in zip((evidence.train, evidence.validation), self._linear, strict=True):
            kept = kept_samples(records, RACE_SAMPLES)
            rows = [
                self._rows_with(start, *each) for each in zip(records, kept, at.rows, strict=True)
            ]
            both.append(rows)
        if start.value and self._leaves(both) >= self._leaves([at.rows for at in self._linear]):
            return None
        moves, judges = np.append(self._linear[0].moves, True), evidence.only_judges(start)
        own = np.append(of_experiment(variant), judges)
        alone = [(each[:, -2:-1], each[:, -1]) for each in both[1]]
        step = further_step(alone) if judges else whole_step(both[0], moves)
        if step[-1] == 0.0:
            return None
        clock = replace(start, value=start.value + float(step[-1]))
        model = replace(self.model, clocks=(*self.model.clocks, clock))
        return Look(model, tuple(cross_fitted(both[0], moves, both[1], own)), (clock.name,))

    @staticmethod
    def _leaves(both: Sequence[Sequence[Array]]) -> float:
        """Sum of squares of what is left of all records (µm²)."""
        return squares(rows[:, -1] for part in both for rows in part)

    def _rows_with(
        self, clock: Clock, record: Record, kept: NDArray[np.intp], rows: Array
    ) -> Array:
        """Put the derivative by a clock fault before what is left of a record, where it starts."""
        variant, moved = self.begun.variant, clock.mended(record)
        column, left = clock_column(moved, clock, variant)[kept], rows[:, -1]
        if moved is not record:
            models = (simulate_effects([variant], each)[kept, 0] for each in (record, moved))
            change = np.subtract(*models)
            left = left + change - change.mean()
        return np.column_stack([rows[:, :-1], column - column.mean(), left])


def clock_starts(evidence: Evidence) -> list[Clock]:
    """Faults that the clocks of the records may have, each with the sizes that it is looked at from."""
    names = dict.fromkeys(r.name for r in (*evidence.train, *evidence.validation))
    of_one = [
        Clock(kind, name, start)
        for name in names
        for kind, starts in CLOCK_STARTS.items()
        for start in starts
    ]
    return [Clock("skew", ""), *(of_one if len(names) > 1 else [])]


def exchanged(model: Model, scale: DataScale, offer: Offer) -> list[Model]:
    """Return the models with the stage of one effect at the place that another name stands for.

    No first look leads to it: what acts before the plays changes the derivatives by their weights,
    which looks take from the set as it is.
    """
    found = []
    for effect in (e for e in model.effects if not offer.is_kept(e.name)):
        others = [e for e in model.effects if e is not effect]
        for kind in (kind for name, kind in offer.effects.items() if name not in model.names):
            twins = _twins(effect, kind, scale)
            found += [replace(model, effects=in_chain_order([*others, each])) for each in twins]
    return found


def _twins(effect: Effect, kind: type[Effect], scale: DataScale) -> list[Effect]:
    """Return the forms of another name that are the same stage elsewhere in the chain.

    The form with the same numbers, or with one number, the lag that slow signals have, and the further
    ones.
    """
    forms, lag_s = forms_of(kind), effect.slow_lag_s
    numbers = [[p.name for p in form.parameters] for form in forms]
    if [*effect.values] in numbers:
        k = numbers.index([*effect.values])
        twin = forms[k].within_bounds(**effect.values)
    elif lag_s is not None and len(numbers[0]) == 1:
        k, twin = 0, forms[0].within_bounds(**{numbers[0][0]: lag_s})
        if twin.slow_lag_s is None:
            return []
    else:
        return []
    further = [form.from_simpler(twin, scale)[:1] for form in forms[k + 1 :]]
    return [twin, *(each for starts in further for each in starts)]


def kinds(
    evidence: Evidence, model: Model, least_um: float, loose: bool
) -> tuple[list[Model], dict[str, str]]:
    """First fits of every other kind of hysteresis beside the effects of a set, those that leave less.

    Beside them, why others have no fit, by their name.
    """
    found, refused = list[Model](), dict[str, str]()
    for kind in evidence.offer.cores:
        beside = [e for e in model.effects if type(e).fits_in(kind)]
        if isinstance(model.core, kind) or (kind.loose and (beside or not loose)):
            continue  # many gains beside effects are slow, and make up for any
        try:
            fit = first_fit(evidence.train, kind, beside, evidence.scale)
        except caught_with(beside) as error:
            refused[kind.name] = str(error)
            continue
        if fit.train_rmse_um < least_um:
            found.append(Model(fit.variant.hysteresis, fit.variant.effects, model.clocks))
    return found, refused


def raced(base: Look, looks: Sequence[Look], evidence: Evidence, most: int) -> list[Look]:
    """Return the looks that gain most, one for each name.

    Of a name's forms it is the first, in their order, that is not worse than its best one by the one
    decision.
    """
    if not looks:
        return []
    here, scores = _scores(base, looks, evidence)
    gains = (here - scores).mean(axis=1)
    draws, chosen, named = draw_blocks(scores.shape[1]), list[int](), set[tuple[str, ...]]()
    for k in map(int, np.argsort(-gains)):
        if gains[k] > 0.0 and looks[k].new not in named and len(chosen) < most:
            named.add(looks[k].new)
            own = [m for m, look in enumerate(looks) if look.new == looks[k].new]
            worse = chances(scores[own] - scores[k], np.zeros(len(own)), draws) < LEVEL
            chosen.append(own[int(np.argmin(worse))])
    return [looks[k] for k in chosen]


def bearable(base: Look, looks: Sequence[Look], evidence: Evidence) -> list[Look]:
    """Return the looks at less that are not worse by the one decision."""
    here, scores = _scores(base, looks, evidence)
    lost = chances(scores - here, np.zeros(len(looks)), draw_blocks(scores.shape[1]))
    return [look for look, chance in zip(looks, lost, strict=True) if chance >= LEVEL]


def _scores(base: Look, looks: Sequence[Look], evidence: Evidence) -> tuple[Array, Array]:
    """Score of each block where looks begin, ``(B,)``, and of each look, ``(M, B)``."""
    blocks, floors_um = Blocks.of(base.lefts), evidence.floors_um(base.lefts, RACE_SAMPLES)
    scores = np.array([blocks.scores(look.lefts, floors_um) for look in looks])
    return blocks.scores(base.lefts, floors_um), scores
