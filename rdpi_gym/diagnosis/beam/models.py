"""A model of the search, its refit, and its phantoms."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.diagnosis.beam.constants import FIT_SAMPLES, PASSES, ROUNDS
from rdpi_gym.diagnosis.beam.evidence import Clock, Evidence
from rdpi_gym.diagnosis.beam.score import (
    cross_fitted,
    further_step,
    orthogonal,
    squares,
    whole_step,
    within,
)
from rdpi_gym.identification.jacobian import Variant, centred, simulate_effects
from rdpi_gym.identification.joint import (
    JointFit,
    Tangents,
    effect_rows,
    fit_linearised,
    free_numbers,
    kept_samples,
    or_none,
    refit_experiment,
    tangents,
)
from rdpi_gym.identification.least_squares import BoolArray
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, forms_of
from rdpi_gym.plant.effects.unknown import Unknown
from rdpi_gym.support.arrays import Array


@dataclass(frozen=True)
class Model:
    """A core, a set of effects in their forms, and clock faults of records."""

    core: Core
    effects: tuple[Effect, ...] = ()  # In the chain's order
    clocks: tuple[Clock, ...] = ()

    @property
    def key(self) -> tuple[str, ...]:
        """Identity of a set: kind of the core, forms of effects, clock faults."""
        clocks = sorted(clock.name for clock in self.clocks)
        return (self.core.name, *sorted(e.full_name() for e in self.effects), *clocks)

    @property
    def names(self) -> frozenset[str]:
        """Names of the effects and clock faults, without forms."""
        return frozenset([e.name for e in self.effects] + [c.name for c in self.clocks])

    @property
    def numbers(self) -> int:
        """Count of the numbers of effects that a refit is free in."""
        return sum(not p.fixed for effect in self.effects for p in effect.parameters)

    def simplified(self, scale: DataScale) -> list[Model]:
        """Return the models with one effect in its simplest form."""
        found = []
        for effect in self.effects:
            simplest = forms_of(type(effect))[0]
            if effect.name != Unknown.name and simplest is not type(effect):
                start = simplest.starts(scale)[0]
                others = tuple(start if e is effect else e for e in self.effects)
                found.append(replace(self, effects=others))
        return found

    def without_one(self) -> list[Model]:
        """Return the models with one effect or clock fault less."""
        fewer = [tuple(e for e in self.effects if e is not effect) for effect in self.effects]
        sound = [tuple(c for c in self.clocks if c is not clock) for clock in self.clocks]
        return [
            *(replace(self, effects=each) for each in fewer),
            *(replace(self, clocks=each) for each in sound),
        ]


@dataclass(frozen=True, eq=False)
class Visited:
    """A set that was refitted whole."""

    model: Model
    fit: JointFit
    # What it leaves where it was not fitted (µm), by record: those to fit, then those to judge by
    lefts: tuple[Array, ...]
    parent: tuple[str, ...] | None = None  # Key of the set that a move made it of
    # The same of the parent, linearised, alone and with each phantom of the move
    ghosts: tuple[tuple[Array, ...], ...] = ()
    new: tuple[str, ...] = ()  # Names that the move brought
    seconds: float = 0.0  # Processor time of its refit

    @property
    def key(self) -> tuple[str, ...]:
        """Key of its model."""
        return self.model.key

    @property
    def rmse_um(self) -> float:
        """Cross-fitted error over all samples (µm rms)."""
        return math.sqrt(float(np.mean(np.concatenate(self.lefts) ** 2)))


def residuals(records: Sequence[Record], variant: Variant[Core], samples: int) -> list[Array]:
    """Return what a model leaves of records (µm), offset free, at the samples that count."""
    found = []
    for record, kept in zip(records, kept_samples(records, samples), strict=True):
        left = (record.y_um - simulate_effects([variant], record)[:, 0])[kept]
        found.append(centred(left, record, variant.effects, kept))
    return found


def refitted(
    evidence: Evidence, model: Model, parent: tuple[str, ...] | None = None
) -> Visited | None:
    """Refit a set whole and cross-fit it; None where it leaves the bounds of its numbers."""
    return or_none(partial(_refitted, evidence, model, parent), model.effects)


def _refitted(evidence: Evidence, model: Model, parent: tuple[str, ...] | None) -> Visited | None:
    began = time.process_time()
    for _ in range(ROUNDS if model.clocks else 1):
        here = evidence.mended(model.clocks)
        fit, at = fit_linearised(here.train, model.core, model.effects, PASSES, FIT_SAMPLES)
        rows = _with_clocks(here.train, at.rows, model.clocks, fit.variant)
        moves = np.concatenate([at.moves, np.ones(len(model.clocks), dtype=np.bool_)])
        judged, variant, clocks = _judged(here, fit.variant, at, model.clocks)
        if not clocks:
            break
        steps = whole_step(rows, moves)[-len(clocks) :]
        model = replace(
            model,
            core=fit.variant.hysteresis,
            effects=fit.variant.effects,
            clocks=tuple(
                replace(clock, value=clock.value + float(step))
                for clock, step in zip(clocks, steps, strict=True)
            ),
        )
        if not all(
            clock.fits(r) for clock in model.clocks for r in (*here.train, *here.validation)
        ):
            return None
    lefts = [*cross_fitted(rows, moves), *judged]
    if not math.isfinite(squares(lefts)):
        return None
    # plays without a weight stay: what an effect takes up leaves others to be wanted
    found = replace(model, core=variant.hysteresis, effects=variant.effects)
    fit = replace(fit, variant=variant)
    return Visited(found, fit, tuple(lefts), parent, seconds=time.process_time() - began)


def of_experiment(variant: Variant[Core]) -> BoolArray:
    """Which numbers of a linearised model tell of the experiment and not of the plant.

    What goes by the clock does: no record tells how it went in another one.
    """
    free = free_numbers(variant.hysteresis, variant.effects, 1.0)
    by_clock = [number.is_by_clock(variant) for number in free]
    return np.array([False] * len(variant.hysteresis.gains) + by_clock, dtype=np.bool_)


def _judged(
    evidence: Evidence, variant: Variant[Core], at: Tangents, clocks: tuple[Clock, ...]
) -> tuple[list[Array], Variant[Core], tuple[Clock, ...]]:
    """Return what a model that was fitted leaves of the records to judge by, the model there, clocks.

    Its numbers of the experiment are refitted to all records, and each stretch of those to judge by
    is left out in turn; so do the clock faults of these records alone.
    """
    faults = np.array([evidence.only_judges(clock) for clock in clocks], dtype=np.bool_)
    moves = of_experiment(variant) & at.moves
    if not moves.any() and not faults.any():
        return residuals(evidence.validation, variant, FIT_SAMPLES), variant, clocks
    train, judged, count = evidence.train, evidence.validation, len(evidence.train)
    variant, here = refit_experiment(train, judged, variant, PASSES, FIT_SAMPLES)
    rows = [
        *_with_clocks(train, here.rows[:count], clocks, variant),
        *_with_clocks(judged, here.rows[count:], clocks, variant),
    ]
    columns = np.flatnonzero(np.concatenate([here.moves, faults]))
    pairs = [(each[:, columns], each[:, -1]) for each in rows]
    found = list(clocks)
    for column, step in zip(columns, further_step(pairs), strict=True):
        if column >= len(here.moves):
            clock = clocks[column - len(here.moves)]
            found[column - len(here.moves)] = replace(clock, value=clock.value + float(step))
    return within(pairs)[count:], variant, tuple(found)


def _with_clocks(
    records: Sequence[Record],
    rows: Sequence[Array],
    clocks: Sequence[Clock],
    variant: Variant[Core],
) -> list[Array]:
    """Put the derivative by each clock fault before the residual."""
    found = []
    for record, kept, each in zip(records, kept_samples(records, FIT_SAMPLES), rows, strict=True):
        own = [_clock_rows(record, clock, variant, kept) for clock in clocks]
        found.append(np.hstack([each[:, :-1], *own, each[:, -1:]]))
    return found


def _clock_rows(
    record: Record, clock: Clock, variant: Variant[Core], kept: NDArray[np.intp]
) -> Array:
    column = clock_column(record, clock, variant)[kept]
    return np.asarray(column - column.mean())[:, None]


def clock_column(record: Record, clock: Clock, variant: Variant[Core]) -> Array:
    """Derivative of a model's displacement by a clock fault, ``(T,)``."""
    if clock.record not in ("", record.name):
        return np.zeros(record.u_V.size)
    y = simulate_effects([variant], record)[:, 0]
    step = {"delay": 0.25 * record.ts_s, "skew": 0.25 / y.size, "step": 1e-3}[clock.kind]
    moved = replace(clock, record="", value=step).mended(record)
    return np.asarray((simulate_effects([variant], moved)[:, 0] - y) / step)


@dataclass(frozen=True, eq=False)
class Linear:
    """A set linearised on all records, for phantoms."""

    evidence: Evidence  # With the set's clocks mended
    variant: Variant[Core]

    @cached_property
    def train(self) -> Tangents:
        """On the records to fit."""
        return tangents(self.evidence.train, self.variant, FIT_SAMPLES)

    @cached_property
    def validation(self) -> Tangents:
        """On the records to judge by."""
        return tangents(self.evidence.validation, self.variant, FIT_SAMPLES)

    def with_phantoms(self, model: Model, new: Collection[str]) -> tuple[tuple[Array, ...], ...]:
        """Return what this set leaves beside each phantom of names of another, at their places there.

        A phantom has the columns that the names' numbers would have, were the plant driven by the
        command of the record in reverse, or by another record's, less what their own columns explain
        of them: it can not be the cause, and is as flexible. Beside a fault of one record's clock
        stands the same fault of all records: what they all want is of the plant.
        """
        count, every = len(self.evidence.train), (*self.evidence.train, *self.evidence.validation)
        own = self._columns(every, model, new)
        local = [*self._new_own(model, new)]
        local += [self.evidence.only_judges(c) for c in model.clocks if c.name in new]
        ghosts = [
            (orthogonal(self._columns(records, model, new), own), local)
            for records in (list(map(_reversed, every)), _exchanged(every))
        ]
        if any(clock.record for clock in model.clocks if clock.name in new):
            clocks = [replace(c, record="") for c in model.clocks if c.name in new]
            shared = replace(model, clocks=tuple(clocks))
            names = [clock.name for clock in clocks]
            ghosts.append((self._columns(every, shared, names), [True] * len(clocks)))
        found = []
        for columns, own_numbers in ghosts:
            both = [
                np.column_stack([rows[:, :-1], column, rows[:, -1]])
                for rows, column in zip(
                    (*self.train.rows, *self.validation.rows), columns, strict=True
                )
            ]
            moves = np.concatenate([self.train.moves, np.ones(len(own_numbers), dtype=np.bool_)])
            local_numbers = np.concatenate([self._own, np.array(own_numbers, dtype=np.bool_)])
            found.append(tuple(cross_fitted(both[:count], moves, both[count:], local_numbers)))
        return (self.alone, *found)

    @property
    def _own(self) -> BoolArray:
        return of_experiment(self.variant)

    @staticmethod
    def _new_own(model: Model, new: Collection[str]) -> list[bool]:
        """Which columns of new effects are numbers of the experiment."""
        return [
            effect.clocked
            for effect in model.effects
            if effect.name in new
            for p in effect.parameters
            if not p.fixed
        ]

    @cached_property
    def alone(self) -> tuple[Array, ...]:
        """Residual of the set without a phantom (µm), by record, by the same steps."""
        train, validation = self.train, self.validation
        return tuple(cross_fitted(train.rows, train.moves, validation.rows, self._own))

    def _columns(
        self, records: Sequence[Record], model: Model, new: Collection[str]
    ) -> list[Array]:
        variant, count, found = Variant(model.core, model.effects), len(self.evidence.train), []
        places = [k for k, effect in enumerate(model.effects) if effect.name in new]
        clocks = [clock for clock in model.clocks if clock.name in new]
        for part in (records[:count], records[count:]):
            by_name = [
                [each[:, :-1] for each in effect_rows(part, [variant], k, FIT_SAMPLES)[0].rows]
                for k in places
            ]
            kept = kept_samples(part, FIT_SAMPLES)
            by_name += [
                [_clock_rows(r, c, variant, index) for r, index in zip(part, kept, strict=True)]
                for c in clocks
            ]
            found += [np.hstack(each) for each in zip(*by_name, strict=True)]
        return found


def _reversed(record: Record) -> Record:
    return replace(record, u_V=record.u_V[::-1].copy(), before_V=np.zeros(0))


def _exchanged(records: Sequence[Record]) -> list[Record]:
    """Return records, each with the command of the next of another name, repeated or cut."""
    names = list(dict.fromkeys(r.name for r in records))
    by_name = {r.name: r for r in records}
    found = []
    for record in records:
        other = by_name[names[(names.index(record.name) + 1) % len(names)]]
        u = other.u_V if other is not record else np.roll(record.u_V, record.u_V.size // 2)
        found.append(replace(record, u_V=np.resize(u, record.u_V.size), before_V=np.zeros(0)))
    return found
