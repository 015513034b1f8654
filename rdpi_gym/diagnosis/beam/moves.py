"""The moves: sets that differ from one by an effect, a form, a core, a pair, a free block or a clock.

A first look takes a few steps of a refit on few samples, the derivatives by the weights shared, and
the race drops what is worse than the best of the looks by the one decision.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations

import numpy as np

from rdpi_gym.diagnosis.beam.constants import (
    FOLLOWED,
    LEVEL,
    PAIRS,
    RACE_SAMPLES,
    RACE_STEPS,
)
from rdpi_gym.diagnosis.beam.decision import chances, draw_blocks
from rdpi_gym.diagnosis.beam.evidence import Clock, ClockKind, Evidence
from rdpi_gym.diagnosis.beam.models import Model, clock_column
from rdpi_gym.diagnosis.beam.score import Blocks, cross_fitted, whole_step
from rdpi_gym.identification.cores import first_fit, fit_or_none
from rdpi_gym.identification.joint import (
    NO_FIT,
    FirstSteps,
    Tangents,
    first_steps,
    foreseen_um,
    kept_samples,
    tangents,
    tangents_near,
)
from rdpi_gym.plant import CORES
from rdpi_gym.plant.effects import CATALOGUE, forms_of
from rdpi_gym.plant.effects.base import Effect, in_chain_order
from rdpi_gym.plant.effects.unknown import Unknown, WithTwoMemories
from rdpi_gym.support.arrays import Array

CLOCK_KINDS: tuple[ClockKind, ...] = ("delay", "step", "skew")
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


@dataclass(frozen=True, eq=False)
class Place:
    """A set from which looks are taken."""

    evidence: Evidence  # With its clocks mended
    model: Model

    @cached_property
    def begun(self) -> FirstSteps:
        """The set with its best weights, whose derivatives the looks share."""
        return self._steps(self.model.effects, 0, None)

    def _steps(self, effects: Sequence[Effect], steps: int, near: FirstSteps | None) -> FirstSteps:
        """Take some steps, or as many as may lead to less than the set itself leaves."""
        least_um = math.inf if near is None else near.train_rmse_um
        return first_steps(
            self.evidence.train, self.model.core, effects, steps, samples=RACE_SAMPLES, near=near,
            least_um=least_um,
        )  # fmt: skip

    def look(self, starts: Iterable[Effect]) -> Look | None:
        """Look at an effect more, from the best of its starts; None where none leads anywhere."""
        return self._followed(self._foreseen(starts))

    def _foreseen(self, starts: Iterable[Effect]) -> list[tuple[float, Effect]]:
        """Foresee the error (µm rms) after one step from each start; the best first."""
        begun = []
        for start in starts:
            effects = in_chain_order([*self.model.effects, start])
            try:
                error_um = foreseen_um(
                    self.evidence.train, self.model.core, effects, RACE_SAMPLES, self.begun
                )
            except NO_FIT:
                continue
            begun += [(error_um, start)] if math.isfinite(error_um) else []
        begun.sort(key=lambda each: each[0])
        return self._along_cusp(begun) if begun and begun[0][1].kinked else begun

    def _followed(self, begun: Sequence[tuple[float, Effect]]) -> Look | None:
        """Go on from the best of the starts."""
        found = list(self._tried([start for _, start in begun[:FOLLOWED]], RACE_STEPS))
        if not found:
            return None
        start, best = min(found, key=lambda each: each[1].train_rmse_um)
        return self._seen(best, (start.name,))

    def _tried(self, starts: Iterable[Effect], steps: int) -> Iterator[tuple[Effect, FirstSteps]]:
        for start in starts:
            effects = in_chain_order([*self.model.effects, start])
            try:
                fit = self._steps(effects, steps, self.begun)
            except NO_FIT:
                continue
            if math.isfinite(fit.train_rmse_um):
                yield start, fit

    def _along_cusp(self, begun: list[tuple[float, Effect]]) -> list[tuple[float, Effect]]:
        """Halve the interval between starts around the best one: no gradient leads into a cusp."""
        name = str(begun[0][1].kinked)
        places = sorted(math.log(start.values[name]) for _, start in begun)
        apart = min(np.diff(places), default=0.0)
        for _ in range(RACE_STEPS):
            apart *= 0.5
            best = begun[0][1]
            near = [
                type(best).within_bounds(**best.values | {name: value * best.values[name]})
                for value in (math.exp(-apart), math.exp(apart))
            ]
            fits = ((fit.train_rmse_um, start) for start, fit in self._tried(near, 0))
            begun = sorted([*begun, *fits], key=lambda each: each[0])
        return begun

    @cached_property
    def _to_judge(self) -> list[Array]:
        """Derivatives by the weights on the records to judge by."""
        at = tangents(self.evidence.validation, self.begun.variant, RACE_SAMPLES)
        return [rows[:, : len(self.model.core.gains)] for rows in at.rows]

    def _linearised(self, fit: FirstSteps) -> tuple[Tangents, Tangents]:
        """Linearise a model near the set on the records to fit and to judge by."""
        train, validation = self.evidence.train, self.evidence.validation
        at = tangents_near(train, fit.variant, fit.columns, RACE_SAMPLES)
        return at, tangents_near(validation, fit.variant, self._to_judge, RACE_SAMPLES)

    @cached_property
    def _linear(self) -> tuple[Tangents, Tangents]:
        return self._linearised(self.begun)

    def _seen(self, fit: FirstSteps, new: tuple[str, ...]) -> Look:
        at, judged = self._linearised(fit)
        core, effects = fit.variant.hysteresis, fit.variant.effects
        model = replace(self.model, core=core, effects=effects)
        return Look(model, tuple(cross_fitted(at.rows, at.moves, judged.rows)), new)

    def stepped(self) -> Look:
        """The set itself after as many steps as a look takes."""
        return self._seen(self._steps(self.model.effects, RACE_STEPS, self.begun), ())

    def without(self, name: str) -> Place:
        """The place without an effect."""
        kept = tuple(e for e in self.model.effects if e.name != name)
        return replace(self, model=replace(self.model, effects=kept))

    def additions(self, base: Look) -> list[Look]:
        """Looks at every effect of the catalogue that the set does not have, each in its best form.

        Of its forms the first in their order, which is that of their numbers, that is no worse than
        any other by the one decision.
        """
        core, scale = type(self.model.core), self.evidence.scale
        found = []
        for name, kind in CATALOGUE.items():
            if name in self.model.names:
                continue
            forms = [form for form in forms_of(kind) if form.fits_in(core)]
            begun = [each for form in forms if (each := self._foreseen(form.starts(scale)))]
            first = begun[:1]  # the simplest, and the one that begins best
            further = sorted(begun[1:], key=lambda each: each[0][0])[:1]
            kept = [each for each in begun if each in first or each in further]
            looks = [self._followed(each) for each in kept]
            found += no_worse(base, [look for look in looks if look is not None], self.evidence)[:1]
        return found

    def forms(self) -> list[list[Look]]:
        """Looks at every other form of the effects that the set has, by effect."""
        scale, core, found = self.evidence.scale, type(self.model.core), []
        for effect in self.model.effects:
            bare, kinds = self.without(effect.name), forms_of(type(effect))
            here, looks = kinds.index(type(effect)), []
            for k, form in enumerate(kinds):
                if k != here and form.fits_in(core):
                    simpler = form.from_simpler(effect, scale) if k > here else ()
                    looks.append(bare.look((*simpler, *form.starts(scale))))
            found.append([look for look in looks if look is not None])
        return found

    def pairs(self, singles: Sequence[Look], base: Look) -> list[Look]:
        """Looks at the pairs of effects whose changes of the residual together take most of it."""
        left = np.concatenate(base.lefts)
        changes = {look.new: left - np.concatenate(look.lefts) for look in singles}
        gains = []
        for a, b in combinations([look for look in singles if look.new], 2):
            columns = np.column_stack([changes[a.new], changes[b.new]])
            fitted = columns @ np.linalg.lstsq(columns, left, rcond=None)[0]
            alone = max(
                float(left @ left - np.sum((left - changes[k]) ** 2)) for k in (a.new, b.new)
            )
            gains.append((float(fitted @ left) - alone, a, b))
        gains.sort(key=lambda each: -each[0])
        found = []
        for _, a, b in gains[:PAIRS]:
            both = [e for look in (a, b) for e in look.model.effects if e.name in look.new]
            effects = in_chain_order([*self.model.effects, *both])
            try:
                fit = self._steps(effects, RACE_STEPS, self.begun)
            except NO_FIT:
                continue
            if math.isfinite(fit.train_rmse_um):
                found.append(self._seen(fit, tuple(e.name for e in both)))
        return found

    def blocks(self) -> list[Look]:
        """Looks at a free block at each place of the chain."""
        core = type(self.model.core)
        kinds = [k for k in FREE_BLOCKS if k.fits_in(core)]
        looks = [self.look(kind.starts(self.evidence.scale)) for kind in kinds]
        return [look for look in looks if look is not None]

    def clocks(self) -> list[Look]:
        """Looks at faults of the clock of each record, and of all records alike."""
        names = dict.fromkeys(r.name for r in self.evidence.train)
        wanted = [Clock("skew", "")]
        wanted += [Clock(kind, name) for name in names for kind in CLOCK_KINDS if len(names) > 1]
        present = {clock.name for clock in self.model.clocks}
        looks = [self._clocked(clock) for clock in wanted if clock.name not in present]
        return [look for look in looks if look is not None]

    def _clocked(self, clock: Clock) -> Look | None:
        """Estimate the size of a fault beside all other numbers of the set."""
        evidence, variant = self.evidence, self.begun.variant
        parts = (evidence.train, evidence.validation)
        both = []
        for records, at in zip(parts, self._linear, strict=True):
            rows = []
            for record, index, own in zip(
                records, kept_samples(records, RACE_SAMPLES), at.rows, strict=True
            ):
                column = clock_column(record, clock, variant)[index]
                rows.append(np.column_stack([own[:, :-1], column - column.mean(), own[:, -1]]))
            both.append(rows)
        moves = np.append(self._linear[0].moves, True)
        size = float(whole_step(both[0], moves)[-1])
        if size == 0.0:
            return None
        model = replace(self.model, clocks=(*self.model.clocks, replace(clock, value=size)))
        return Look(model, tuple(cross_fitted(both[0], moves, both[1])), (clock.name,))


def kinds(evidence: Evidence, model: Model, least_um: float) -> list[Model]:
    """First fits of every other kind of hysteresis beside the effects of a set, those that leave less."""
    found = []
    for kind in CORES.values():
        beside = [e for e in model.effects if type(e).fits_in(kind)]
        if isinstance(model.core, kind) or (kind.loose and beside):
            continue  # many gains beside effects are slow, and make up for any
        make = partial(first_fit, evidence.train, kind, beside, evidence.scale)
        fit = fit_or_none(partial(make, least_um=least_um))
        if fit is not None and fit.train_rmse_um < least_um:
            found.append(Model(fit.variant.hysteresis, fit.variant.effects, model.clocks))
    return found


def no_worse(base: Look, looks: Sequence[Look], evidence: Evidence) -> list[Look]:
    """Return the looks that are not worse than the best of them by the one decision, in their order."""
    if len(looks) < 2:
        return list(looks)
    _, scores = _scores(base, looks, evidence)
    behind = scores - scores[int(np.argmin(scores.mean(axis=1)))]
    worse = chances(behind, np.zeros(len(looks)), draw_blocks(scores.shape[1])) < LEVEL
    return [look for look, out in zip(looks, worse, strict=True) if not out]


def raced(base: Look, looks: Sequence[Look], evidence: Evidence, most: int) -> list[Look]:
    """Return the looks that gain most."""
    if not looks:
        return []
    here, scores = _scores(base, looks, evidence)
    gains = (here - scores).mean(axis=1)
    return [looks[k] for k in np.argsort(-gains)[:most] if gains[k] > 0.0]


def _scores(base: Look, looks: Sequence[Look], evidence: Evidence) -> tuple[Array, Array]:
    """Score of each block where looks begin, ``(B,)``, and of each look, ``(M, B)``."""
    blocks, floor_um = Blocks.of(base.lefts), evidence.floor_um(base.lefts)
    scores = np.array([blocks.scores(look.lefts, floor_um) for look in looks])
    return blocks.scores(base.lefts, floor_um), scores
