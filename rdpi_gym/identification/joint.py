"""Base model and effects refitted together: Gauss-Newton with non-negative weights inside."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.identification.fitting import MIN_MOTION
from rdpi_gym.identification.jacobian import Neighbours, Variant, take_out_initial
from rdpi_gym.identification.least_squares import BoolArray, signed_least_squares
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.cores.rdpi import RDPI
from rdpi_gym.plant.effects.base import Effect, Parameter
from rdpi_gym.plant.parameters import moved
from rdpi_gym.support.arrays import Array

R = TypeVar("R")

_GAIN_STEP = 1e-4  # of the largest gain: behind a nonlinear stage a gain acts nonlinearly
_LEAST_MOTION = 1e-6  # of the gain that moves most: what moves less is not solved for
_STEP = 1e-3  # of a free number, for finite differences
_LARGEST_FACTOR = math.log(4.0)
_LARGEST_DAMPING = 1e6
# Relative fall of the squares below which the first steps, and those of an experiment's numbers, end.
_SMALL = 1e-4
# Steps between two passes that take the derivatives by the weights anew.
_LIGHT_PASSES = 4
_SMALLEST_A0 = 1e-6  # of the gain that the data show
# Price of the squares of an effect's bends, against what its parameters do to the records on the
# average: it settles those that no record tells, and of those that one does it is not seen.
_BEND_PRICE = 1e-5
MOST_SAMPLES = 200_000
"""Samples in the squares of a fit from twice as many on: their derivatives are held in memory."""


@dataclass(frozen=True)
class Free:
    """A number that the search moves: of the core's shape (effect is None) or of an effect."""

    effect: int | None  # Place in the list of effects; None for the core
    # Its bounds; one whose lower bound is above zero is searched in its logarithm
    parameter: Parameter
    # Its size, of which a small share is the finite difference; not read for a logarithm
    size: float

    @property
    def logarithmic(self) -> bool:
        """Whether the search moves the logarithm."""
        return self.parameter.low > 0

    @property
    def low(self) -> float:
        """Lower bound of the search."""
        return self.coordinate(self.parameter.low)

    @property
    def high(self) -> float:
        """Upper bound of the search."""
        return self.coordinate(self.parameter.high)

    def coordinate(self, value: float) -> float:
        """Return a value as the search moves it."""
        return math.log(value) if self.logarithmic else value

    def physical(self, place: float) -> float:
        """Return the value at a place of the search."""
        return math.exp(place) if self.logarithmic else place

    @property
    def step(self) -> float:
        """Finite difference."""
        if self.parameter.step is not None:
            return self.parameter.step
        return _STEP if self.logarithmic else _STEP * self.size

    def name(self, variant: Variant[Any]) -> str:
        """Return ``effect.parameter``."""
        owner = "" if self.effect is None else f"{variant.effects[self.effect].name}."
        return owner + self.parameter.name

    def bounded(self, step: float) -> float:
        """Return the step that one pass may take: a logarithm moves by a factor of 4 at most."""
        return min(max(step, -_LARGEST_FACTOR), _LARGEST_FACTOR) if self.logarithmic else step

    def is_by_clock(self, variant: Variant[Any]) -> bool:
        """Whether it tells of the experiment and not of the plant."""
        return self.effect is not None and variant.effects[self.effect].clocked

    def at_bound(self, variant: Variant[Any]) -> bool:
        """Whether a variant stands at a bound; the value at which the effect vanishes is none."""
        here = self.read(variant)
        edges = (self.parameter.low, self.low), (self.parameter.high, self.high)
        bounds = [edge for physical, edge in edges if physical != self.parameter.neutral]
        return any(abs(here - bound) < 2 * self.step for bound in bounds)

    def ways(self, variant: Variant[Any]) -> tuple[bool, bool]:
        """Whether a variant may go up and down: one that would leave the bounds misleads others."""
        here = self.read(variant)
        return here < self.high, here > self.low

    def read(self, variant: Variant[Any]) -> float:
        """Return the value of a variant, or its logarithm."""
        owner = variant.hysteresis if self.effect is None else variant.effects[self.effect]
        return self.coordinate(float(getattr(owner, self.parameter.name)))

    def write(self, variant: Variant[Any], value: float) -> Variant[Any]:
        """Return the variant moved to a place, kept within the bounds."""
        inside = min(max(value, self.low), self.high)
        physical = min(max(self.physical(inside), self.parameter.low), self.parameter.high)
        if self.effect is None:
            core = variant.hysteresis.with_shape({self.parameter.name: float(physical)})
            return Variant(core, variant.effects)
        name, effects = self.parameter.name, list(variant.effects)
        if math.isfinite(physical):  # within its bounds
            effects[self.effect] = moved(effects[self.effect], Effect, **{name: float(physical)})
        else:
            effects[self.effect] = effects[self.effect].with_values({name: float(physical)})
        return Variant(variant.hysteresis, tuple(effects))


@dataclass(frozen=True)
class JointFit:
    """Result of a joint refit."""

    variant: Variant[Core]  # Hysteresis and effects
    train_rmse_um: float  # Over the counted samples of the records, offsets free (µm)
    # Names of effects' parameters that ended at a physical bound, as ``effect.parameter``
    at_bound: tuple[str, ...]
    # Standard errors of the effects' parameters, by the same names, for white residuals; None where the data do
    # not fix a parameter
    standard_errors: Mapping[str, float | None]
    passes: int  # Runs over the records
    converged: bool  # Whether the search ended by itself
    smoothness: float = 0.0  # Smoothness asked of the weights
    # Standard errors of the numbers of the core's shape, by name, as those of effects
    shape_errors: Mapping[str, float | None] = field(default_factory=dict)


def shape_numbers(core: Core) -> list[Free]:
    """Return the numbers of a core's shape that are not fixed."""
    return [Free(None, p, max(map(abs, p.typical))) for p in core.shape if not p.fixed]


def free_numbers(
    core: Core,
    effects: Sequence[Effect],
    delta2_scale_s: float,
    held: frozenset[str] = frozenset(),
) -> list[Free]:
    """Return the numbers of the core's shape and every parameter of the effects."""
    if isinstance(core, RDPI):
        delta2 = Parameter(
            "delta2_s", "s", 0.0, 100 * delta2_scale_s, (0.0, delta2_scale_s), "δ2 of Eq. 8"
        )
        numbers = [Free(None, delta2, delta2_scale_s)]
    else:
        numbers = shape_numbers(core)
    numbers += [
        Free(i, p, _size(effect, p))
        for i, effect in enumerate(effects)
        for p in effect.parameters
        if not p.fixed and f"{effect.name}.{p.name}" not in held
    ]
    return numbers


def _size(effect: Effect, parameter: Parameter) -> float:
    """Typical size of a parameter; of a voltage of either sign, the largest that the effect has.

    A voltage that begins at zero is moved as far as the others: data have no usual unit.
    """
    if parameter.unit == "V" and parameter.low < 0.0:
        sizes = [abs(effect.values[p.name]) for p in effect.parameters if p.unit == "V"]
        if max(sizes) > 0.0:
            return max(sizes)
    return max(map(abs, parameter.typical))


def kept_samples(records: Sequence[Record], samples: int | None) -> list[NDArray[np.intp]]:
    """Return which samples of each record enter the squares, as :func:`fit_joint` thins them."""
    counted = [np.flatnonzero(record.error_mask) for record in records]
    stride = max(1, sum(map(len, counted)) // (MOST_SAMPLES if samples is None else samples))
    return [index[::stride] for index in counted]


@dataclass(frozen=True)
class _Pass:
    """Products of the regressors at one place, offsets taken out."""

    gram: Array
    rhs: Array
    total: float
    count: int
    motion: Array  # of every column, over the command's, in the record where it moves most
    columns: Sequence[Array]  # derivatives by the weights, by record
    squares: Sequence[Array]  # their Gram matrices
    changes: Sequence[
        Array
    ]  # derivatives by the free numbers, and what the plant leaves, by record
    bends: float  # what their price adds to `total`
    core: Core

    @cached_property
    def allowed(self) -> BoolArray:
        """Which gains move enough in some record to stand out from its offset."""
        least = MIN_MOTION if self.core.keeps_first else _LEAST_MOTION
        return np.asarray(self.motion[: len(self.core.gains)] >= least)

    @cached_property
    def floor(self) -> float:
        """Lower bound of the first gain: of a_0 (µm/V) a share of the gain that it alone would have."""
        if not self.core.keeps_first:
            return 0.0
        gain = abs(float(self.rhs[0])) / max(float(self.gram[0, 0]), 1e-300)
        return max(_SMALLEST_A0 * gain, 1e-300)

    @cached_property
    def gains(self) -> Array:
        """Best gains where the free numbers stay."""
        n, core = len(self.core.gains), self.core
        turned = np.flatnonzero(core.signed)
        may = np.concatenate([self.allowed, self.allowed[turned]])
        found: Array = signed_least_squares(
            self.gram[:n, :n], self.rhs[:n], turned, may, self.floor, may
        )
        return found

    @cached_property
    def least(self) -> float:
        """Squares that these gains leave."""
        x = np.zeros(len(self.rhs))
        x[: len(self.gains)] = self.gains
        return self.cost(x)

    def cost(self, x: Array) -> float:
        return float(self.total - 2 * x @ self.rhs + x @ self.gram @ x)


@dataclass(frozen=True)
class _Problem:
    """Free numbers, records and prices, common to all passes."""

    free: Sequence[Free]
    records: Sequence[Record]
    kept: Sequence[NDArray[np.intp]]
    price: Array  # of the weights' roughness, a sample (µm² over the products of two weights)
    gain_sizes: Array  # of each gain that makes as much as the largest of the command

    def whole_pass(self, variant: Variant[Any]) -> _Pass:
        """Derivatives by every weight and every free number."""
        n_weights = len(variant.hysteresis.gains)
        rows = self.rows(variant)
        columns, changes = [r[:, :n_weights] for r in rows], [r[:, n_weights:] for r in rows]
        squares = [c.T @ c for c in columns]
        return _products(variant, self.free, columns, changes, squares, self.price)

    def rows(self, variant: Variant[Any]) -> list[Array]:
        """Derivatives by every weight and every free number and the residual, by record, centred."""
        gain_steps = self.gain_sizes * (_GAIN_STEP * variant.hysteresis.A)
        lanes = Neighbours(variant, *self.neighbours(variant), gain_steps)
        return self._by_record(lanes.derivatives, variant)

    def with_best_gains(self, variant: Variant[Any], here: _Pass) -> tuple[Variant[Any], _Pass]:
        """Return a variant with the best gains of its pass, and a light pass there."""
        best = _with_gains(variant, here.gains)
        return best, self.light_pass(best, here)

    def light_pass(self, variant: Variant[Any], last: _Pass) -> _Pass:
        """Derivatives by the free numbers; those by the weights are of another place near by."""
        return self.changes_at(variant, last.columns, last.squares)

    def changes_at(
        self, variant: Variant[Any], columns: Sequence[Array], squares: Sequence[Array]
    ) -> _Pass:
        """Return the same with given derivatives by the weights and their Gram matrices."""
        return _products(variant, self.free, columns, self.changes(variant), squares, self.price)

    def changes(self, variant: Variant[Any]) -> list[Array]:
        """Derivatives by every free number and the residual, by record, centred."""
        lanes = Neighbours(variant, *self.neighbours(variant))
        return self._by_record(lanes.changes, variant)

    def _by_record(
        self, rows_of: Callable[[Record, NDArray[np.intp]], Array], variant: Variant[Any]
    ) -> list[Array]:
        """Return rows of each record, less what the record leaves open."""
        found = []
        for record, kept in zip(self.records, self.kept, strict=True):
            rows = rows_of(record, kept)
            take_out_initial(rows, record, variant.effects, kept)
            found.append(rows)
        return found

    def stepped(self, best: Variant[Any], here: _Pass, damping: float) -> Variant[Any]:
        """Return where a damped step of weights and free numbers leads from a place."""
        n_weights = len(best.hysteresis.gains)
        x = _solve(
            here, best.hysteresis.gains, damping, [number.ways(best) for number in self.free]
        )
        trial = _with_gains(best, x[:n_weights])
        for number, step in zip(self.free, x[n_weights:], strict=True):
            trial = number.write(trial, number.read(best) + number.bounded(step))
        return trial

    def priced(self, best: Variant[Any], here: _Pass) -> float:
        """Return what the prices of roughness and of bends add to the squares of a place."""
        weights = np.array(best.hysteresis.gains)
        return here.count * float(weights @ self.price @ weights) + here.bends

    def neighbours(self, variant: Variant[Any]) -> tuple[list[Variant[Any]], Array]:
        """Return the variant after a step of each free number, and the steps."""
        changed, steps = [], []
        for number in self.free:
            here = number.read(variant)
            step = number.step if here + number.step <= number.high else -number.step
            changed.append(number.write(variant, here + step))
            steps.append(step)
        return changed, np.array(steps)


@njit(cache=True)
def _add_record(
    square: Array, across: Array, moved_by: Array, first: bool, gram: Array, motion: Array
) -> None:
    """Add the products of a record; `motion` of every column is over that of the command."""
    n, size = square.shape[0], gram.shape[0] - 1
    spread = np.empty(size)
    for i in range(n):
        spread[i] = np.sqrt(square[i, i])
    for i in range(n, size):
        spread[i] = np.sqrt(moved_by[i - n, i - n])
    moves = spread[0] if first else spread[:n].max()
    for i in range(size):
        share = spread[i] / max(moves, 1e-300)
        if share > motion[i] or np.isnan(share):
            motion[i] = share
    for i in range(n):
        for j in range(n):
            gram[i, j] += square[i, j]
        for j in range(across.shape[1]):
            gram[i, n + j] += across[i, j]
            gram[n + j, i] += across[i, j]
    for i in range(moved_by.shape[0]):
        for j in range(moved_by.shape[1]):
            gram[n + i, n + j] += moved_by[i, j]


def _products(
    variant: Variant[Any],
    free: Sequence[Free],
    columns: Sequence[Array],
    changes: Sequence[Array],
    squares: Sequence[Array],
    price: Array,
) -> _Pass:
    """Gram matrix of columns of the weights, by record, and of the free numbers beside them."""
    weights = np.array(variant.hysteresis.gains)
    n, size = len(weights), len(weights) + changes[0].shape[1] - 1
    gram, motion = np.zeros((size + 1, size + 1)), np.zeros(size)
    for own, change, square in zip(columns, changes, squares, strict=True):
        with np.errstate(over="ignore", invalid="ignore"):
            across, moved_by = own.T @ change, change.T @ change
        _add_record(square, across, moved_by, variant.hysteresis.keeps_first, gram, motion)
    # what is left, plus what the weights give now: to be solved for weights, not for their steps
    whole = np.eye(size + 1)
    whole[:n, size] = weights
    with np.errstate(over="ignore", invalid="ignore"):  # such a step is not taken
        gram = whole.T @ gram @ whole
    count = sum(map(len, changes))
    inner, rhs = gram[:size, :size].copy(), gram[:size, size].copy()
    inner[:n, :n] += count * price
    bends = _add_bends(variant, free, inner[n:, n:], rhs[n:])
    total = float(gram[size, size]) + bends
    core = variant.hysteresis
    return _Pass(inner, rhs, total, count, motion, columns, squares, changes, bends, core)


def _add_bends(variant: Variant[Any], free: Sequence[Free], gram: Array, rhs: Array) -> float:
    """Add the price of the effects' bends to the products of the free numbers; return it."""
    paid = 0.0
    for i, effect in enumerate(variant.effects):
        bends = effect.bends()
        own = [k for k, number in enumerate(free) if number.effect == i]
        if bends is None or bends.shape[1] != len(own):  # some keep their value
            continue
        price = _BEND_PRICE * float(np.diag(gram)[own].mean()) * bends.T @ bends
        here = np.array([free[k].read(variant) for k in own])
        gram[np.ix_(own, own)] += price
        rhs[own] -= price @ here
        paid += float(here @ price @ here)
    return paid


def _solve(
    at: _Pass, gains: Sequence[float], damping: float, ways: Sequence[tuple[bool, bool]]
) -> Array:
    """Best gains and step of the free numbers, whose `ways` are up and down.

    Gains that may not be negative stay at zero or above; the search begins at those that are there.
    """
    n, moves = len(gains), at.gram.shape[0] - len(gains)
    signed, free = np.flatnonzero(at.core.signed), np.arange(n, n + moves)
    damped = at.gram.copy()
    damped[free, free] += damping * damped[free, free]
    up, down = np.array(ways, dtype=np.bool_).reshape(-1, 2).T
    allowed = np.concatenate([at.allowed, up, at.allowed[signed], down])
    guess = np.zeros(len(allowed), dtype=np.bool_)
    guess[:n] = np.array(gains) > 0.0
    turned = np.concatenate([signed, free])
    x: Array = signed_least_squares(damped, at.rhs, turned, allowed, at.floor, guess)
    return x


def fit_joint(
    records: Sequence[Record],
    start: Core,
    effects: Sequence[Effect] = (),
    passes: int = 30,
    tolerance: float = 1e-4,
    held: frozenset[str] = frozenset(),
    samples: int | None = None,
    smoothness: float = 0.0,
) -> JointFit:
    """Refit the weights, δ2 and every parameter of the effects to records."""
    return _refitted(records, start, effects, passes, tolerance, held, samples, smoothness)[0]


def fit_linearised(
    records: Sequence[Record], start: Core, effects: Sequence[Effect], passes: int, samples: int
) -> tuple[JointFit, Tangents]:
    """Refit as :func:`fit_joint`, and linearise the model where it ends: by the last pass."""
    fit, at, gains, free = _refitted(
        records, start, effects, passes, 1e-4, frozenset(), samples, 0.0
    )
    return fit, _tangents_of(fit.variant, free, at, gains)


def _refitted(
    records: Sequence[Record],
    start: Core,
    effects: Sequence[Effect],
    passes: int,
    tolerance: float,
    held: frozenset[str],
    samples: int | None,
    smoothness: float,
) -> tuple[JointFit, _Pass, Array, Sequence[Free]]:
    """Return the refit, its last pass, the gains of that pass's place, and the free numbers."""
    problem, best = _begun(records, start, effects, samples, held, smoothness)
    best, here = problem.with_best_gains(best, problem.whole_pass(best))
    cost = here.least
    used, damping, moves, converged = 2, 1e-3, 0, False
    while used < passes and not converged:
        trial = problem.stepped(best, here, damping)
        there = problem.light_pass(trial, here)
        used += 1
        trial_cost = there.least
        better, small = trial_cost < cost, cost - trial_cost < tolerance * cost
        stale = moves > 0
        if better:
            best, here, cost, moves = trial, there, trial_cost, moves + 1
            damping = max(damping / 10, 1e-9)
        if stale and (small or moves > _LIGHT_PASSES):
            # simulated: behind a nonlinear stage the squares that gains promise are none that a step finds
            best = _with_gains(best, here.gains)
            best, here = problem.with_best_gains(best, problem.whole_pass(best))
            cost, moves = here.least, 0
        elif better:
            converged = small
        else:
            converged = damping > _LARGEST_DAMPING
            damping *= 10
    before, best = best, _with_gains(best, here.gains)
    if moves > 0 and not converged:  # one small step after a whole pass moves no derivative
        here = problem.whole_pass(best)
        before = best
        best = _with_gains(best, here.gains)
        cost = here.least
    cost -= problem.priced(best, here)
    edge = [n for n in problem.free if n.effect is not None and n.at_bound(best)]
    errors = _standard_errors(best, problem.free, here, cost)
    own = [n.name(best) for n in problem.free if n.effect is None]
    fit = JointFit(
        best,
        math.sqrt(max(cost, 0.0) / max(here.count, 1)),
        tuple(n.name(best) for n in edge),
        {name: error for name, error in errors.items() if name not in own},
        used,
        converged,
        smoothness,
        {name: errors[name] for name in own},
    )
    return fit, here, np.array(before.hysteresis.gains), problem.free


NO_FIT = (ValueError, ArithmeticError)
"""Errors of a fit that leaves the bounds of its numbers or the floats: of one of several, that one is
dropped. InputError and LinAlgError are among them; any other error is a fault of the program."""


def caught_with(effects: Iterable[Effect | type[Effect]]) -> tuple[type[Exception], ...]:
    """Return the errors for which one of several fits is dropped: a user's effect may raise any."""
    kinds = (each if isinstance(each, type) else type(each) for each in effects)
    ours = all(kind.__module__.startswith("rdpi_gym.") for kind in kinds)
    return NO_FIT if ours else (Exception,)


def or_none(fit: Callable[[], R], effects: Iterable[Effect | type[Effect]] = ()) -> R | None:
    """Return what a fit with some effects returns, or None where there is no fit."""
    try:
        return fit()
    except caught_with(effects):
        return None


@dataclass(frozen=True)
class FirstSteps:
    """Result of a few steps of a refit."""

    variant: Variant[Core]  # Hysteresis and effects
    train_rmse_um: float  # Over the samples that entered the squares, offsets free (µm)
    # Derivatives by the weights, by record, of a place near by
    columns: Sequence[Array]
    squares: Sequence[Array]
    left_um: Sequence[Array]  # Residual at the same samples (µm), without offset
    linearise: Callable[[], Tangents]  # By its last pass


def first_steps(
    records: Sequence[Record],
    start: Core,
    effects: Sequence[Effect],
    steps: int,
    samples: int | None = None,
    near: FirstSteps | None = None,
) -> FirstSteps:
    """Go a few steps of :func:`fit_joint`, to see which of several starts is worth the rest.

    The derivatives by the weights, dozens of lanes, are those of the start or of another one near
    by: the error that is returned is that of a model in which they are linear.
    """
    problem, best = _begun(records, start, effects, samples)
    here = (
        problem.whole_pass(best)
        if near is None
        else problem.changes_at(best, near.columns, near.squares)
    )
    best, here = problem.with_best_gains(best, here)
    cost, damping, tried = here.least, 1e-3, 0
    while tried < steps:
        trial = problem.stepped(best, here, damping)
        there = problem.light_pass(trial, here)
        tried += 1
        trial_cost = there.least
        if trial_cost < cost:
            small = cost - trial_cost < _SMALL * cost
            best, here, cost = trial, there, trial_cost
            damping = max(damping / 10, 1e-9)
            if small:
                break
        else:
            damping *= 10
    gains = np.array(best.hysteresis.gains)
    best = _with_gains(best, here.gains)
    cost -= problem.priced(best, here)
    left = [change[:, -1] for change in here.changes]
    return FirstSteps(
        best,
        math.sqrt(max(cost, 0.0) / max(here.count, 1)),
        here.columns,
        here.squares,
        left,
        partial(_tangents_of, best, problem.free, here, gains),
    )


@dataclass(frozen=True)
class Tangents:
    """Derivatives of a model's displacement on records, the offset of each record taken out."""

    # By record, one row a sample: by each gain, by each free number, and what the model leaves (µm)
    rows: Sequence[Array]
    # Which of these numbers may move: gains above zero or of either sign, others within their bounds
    moves: BoolArray


def tangents(
    records: Sequence[Record], variant: Variant[Any], samples: int | None = None
) -> Tangents:
    """Linearise a model on the samples that :func:`kept_samples` names."""
    core, effects = variant.hysteresis, variant.effects
    problem, _ = _begun(records, core, effects, samples)
    return Tangents(problem.rows(variant), _moves(variant, problem.free))


def _moves(variant: Variant[Any], free: Sequence[Free]) -> BoolArray:
    """Whether each gain is above zero or of either sign, and each free number inside its bounds."""
    core = variant.hysteresis
    gains = (np.array(core.gains) > 0.0) | np.array(core.signed)
    inside = np.array([any(number.ways(variant)) for number in free], dtype=np.bool_)
    return np.concatenate([gains, inside])


def _tangents_of(variant: Variant[Any], free: Sequence[Free], at: _Pass, gains: Array) -> Tangents:
    """Linearise a model by a pass whose place had other gains."""
    further = np.array(variant.hysteresis.gains) - gains
    rows = [
        np.column_stack([own, change[:, :-1], change[:, -1] - own @ further])
        for own, change in zip(at.columns, at.changes, strict=True)
    ]
    return Tangents(rows, _moves(variant, free))


def refit_experiment(
    train: Sequence[Record],
    validation: Sequence[Record],
    variant: Variant[Any],
    passes: int,
    samples: int | None = None,
    held: frozenset[str] = frozenset(),
) -> tuple[Variant[Any], Tangents]:
    """Refit to all records the numbers of what goes by the clock, the plant held, and linearise there.

    The rows have columns of these numbers alone.
    """
    core, effects, records = variant.hysteresis, variant.effects, (*train, *validation)
    problem, best = _begun(records, core, effects, samples, held)
    own = [number for number in problem.free if number.is_by_clock(variant)]
    kept = [*kept_samples(train, samples), *kept_samples(validation, samples)]
    problem = replace(problem, free=own, kept=kept)
    rows, damping, converged = problem.changes(best), 1e-3, False
    cost = _squares(rows)
    for _ in range(passes if own else 0):
        gram = np.sum([each.T @ each for each in rows], axis=0)
        size = np.sqrt(np.maximum(np.diag(gram)[:-1], 1e-300))
        scaled = gram[:-1, :-1] / np.outer(size, size) + damping * np.eye(len(own))
        trial = best
        for number, step in zip(
            own, np.linalg.solve(scaled, gram[:-1, -1] / size) / size, strict=True
        ):
            trial = number.write(trial, number.read(best) + number.bounded(float(step)))
        there = problem.changes(trial)
        fallen = cost - _squares(there)
        if fallen > 0.0:
            best, rows, cost, damping = trial, there, cost - fallen, max(damping / 10, 1e-9)
            converged = fallen < _SMALL * cost
        else:
            damping *= 10
            converged = damping > _LARGEST_DAMPING
        if converged:
            break
    inside = np.array([any(number.ways(best)) for number in own], dtype=np.bool_)
    return best, Tangents(rows, inside)


def _squares(rows: Sequence[Array]) -> float:
    return sum(float(each[:, -1] @ each[:, -1]) for each in rows)


def tangents_near(
    records: Sequence[Record], variant: Variant[Any], columns: Sequence[Array], samples: int
) -> Tangents:
    """Linearise a model, given the derivatives by the gains of another one near by."""
    core, effects = variant.hysteresis, variant.effects
    problem, _ = _begun(records, core, effects, samples)
    rows = [
        np.hstack([own, change])
        for own, change in zip(columns, problem.changes(variant), strict=True)
    ]
    return Tangents(rows, _moves(variant, problem.free))


@dataclass(frozen=True, eq=False)
class EffectRows:
    """Derivatives of a model's displacement by the parameters of one of its effects."""

    # By record, centred, one row a sample: by each parameter, and what the model leaves (µm)
    rows: Sequence[Array]
    ways: Sequence[tuple[bool, bool]]  # Whether each parameter may go up and down


def effect_rows(
    records: Sequence[Record],
    variants: Sequence[Variant[Any]],
    place: int,
    samples: int | None = None,
) -> list[EffectRows]:
    """Linearise models that differ by one effect alone, each in the parameters of that effect.

    What they have in common is simulated once.
    """
    base, lanes, steps, own = variants[0], list[Variant[Any]](), list[float](), list[list[Free]]()
    for variant in variants:
        problem, _ = _begun(records, variant.hysteresis, variant.effects, samples)
        own.append([number for number in problem.free if number.effect == place])
        changed, by = replace(problem, free=own[-1]).neighbours(variant)
        lanes += [variant, *changed]
        steps += [1.0, *by]
    apart = Neighbours(base, lanes[1:], np.ones(len(lanes) - 1))
    parts = []
    for record, kept in zip(records, kept_samples(records, samples), strict=True):
        rows = apart.changes(record, kept)
        take_out_initial(rows, record, base.effects, kept)
        parts.append(np.hstack([np.zeros((len(rows), 1)), rows]))  # of the base, less itself
    found, first = [], 0
    for variant, free in zip(variants, own, strict=True):
        end, by = first + 1 + len(free), np.array(steps[first + 1 : first + 1 + len(free)])
        own_rows = [
            np.column_stack(
                [(p[:, first + 1 : end] - p[:, first, None]) / by, p[:, -1] - p[:, first]]
            )
            for p in parts
        ]
        found.append(EffectRows(own_rows, [number.ways(variant) for number in free]))
        first = end
    return found


def _begun(
    records: Sequence[Record],
    start: Core,
    effects: Sequence[Effect],
    samples: int | None,
    held: frozenset[str] = frozenset(),
    smoothness: float = 0.0,
) -> tuple[_Problem, Variant[Any]]:
    fastest = max(float(np.max(np.abs(np.diff(r.u_V)))) / r.ts_s for r in records)
    span = max(float(np.ptp(r.u_V)) for r in records)
    free = free_numbers(start, effects, 0.1 * span / fastest, held)
    n = len(start.gains)
    price = smoothness**2 * start.roughness() if smoothness else np.zeros((n, n))
    # RDPI's gains all act on volts
    sizes = np.ones(n) if isinstance(start, RDPI) else _gain_sizes(start, records)
    problem = _Problem(free, records, kept_samples(records, samples), price, sizes)
    return problem, _with_gains(Variant(start, tuple(effects)), np.array(start.gains))


def _gain_sizes(core: Core, records: Sequence[Record]) -> Array:
    """Return the size of each gain over the largest one that acts on the command itself."""
    largest, u_V = np.zeros(len(core.gains)), 0.0
    for record in records:
        u, v = record.u_V, np.diff(record.u_V, prepend=record.u_V[0]) / record.ts_s
        columns = core.responses(u, v, core.settled(()))
        largest = np.maximum(largest, np.abs(columns).max(axis=0))
        u_V = max(u_V, float(np.abs(u).max()))
    sizes: Array = u_V / np.where(largest > 0.0, largest, u_V)
    return sizes


def _with_gains(variant: Variant[Any], gains: Array) -> Variant[Any]:
    return Variant(variant.hysteresis.with_gains(gains.tolist()), variant.effects)


def _standard_errors(
    best: Variant[Any], free: Sequence[Free], at: _Pass, cost: float
) -> dict[str, float | None]:
    """From the curvature over the free numbers and the weights that are off their bounds."""
    n_weights = len(best.hysteresis.gains)
    active = [i for i, a in enumerate(best.hysteresis.gains) if a != 0.0]
    index = np.array([*active, *range(n_weights, n_weights + len(free))])
    gram = at.gram[np.ix_(index, index)]
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    covariance = np.linalg.pinv(gram / np.outer(scale, scale), rcond=1e-12, hermitian=True)
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0)) / scale
    deviation *= math.sqrt(max(cost, 0.0) / max(at.count - len(index), 1))
    errors: dict[str, float | None] = {}
    curvature = np.diag(gram)[len(active) :]
    for number, value, shows in zip(free, deviation[len(active) :], curvature > 0.0, strict=True):
        physical = math.exp(number.read(best)) * value if number.logarithmic else float(value)
        known = shows and math.isfinite(physical) and not number.at_bound(best)
        errors[number.name(best)] = float(physical) if known else None
    return errors
