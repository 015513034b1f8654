"""Base model and effects refitted together: Gauss-Newton with non-negative weights inside."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rdpi_gym.arrays import Array
from rdpi_gym.identification.fitting import MIN_MOTION
from rdpi_gym.identification.jacobian import Variant, jacobian_blocks
from rdpi_gym.identification.nonnegative import bounded_least_squares
from rdpi_gym.measurement import Record
from rdpi_gym.plant.effects.base import Effect, Parameter
from rdpi_gym.plant.rdpi import RDPI

_WEIGHT_STEP = 1e-4  # of the largest gain: behind a nonlinear stage a weight acts nonlinearly
_STEP = 1e-3  # of a free number, for finite differences
_LARGEST_FACTOR = math.log(4.0)
_LARGEST_DAMPING = 1e6
_SMALLEST_A0 = 1e-6  # of the largest gain that the data show


@dataclass(frozen=True)
class Free:
    """A number that the search moves: δ2 (effect is None) or a parameter of an effect.

    Parameters
    ----------
    effect
        Place in the list of effects; None for δ2.
    parameter
        Its bounds; one whose lower bound is above zero is searched in its logarithm.
    """

    effect: int | None
    parameter: Parameter

    @property
    def logarithmic(self) -> bool:
        """Whether the search moves the logarithm."""
        return self.parameter.low > 0

    @property
    def low(self) -> float:
        """Lower bound of the search."""
        return math.log(self.parameter.low) if self.logarithmic else self.parameter.low

    @property
    def high(self) -> float:
        """Upper bound of the search."""
        return math.log(self.parameter.high) if self.logarithmic else self.parameter.high

    @property
    def step(self) -> float:
        """Finite difference."""
        if self.logarithmic:
            return _STEP
        low, high = self.parameter.typical
        return _STEP * max(abs(low), abs(high))

    def name(self, variant: Variant) -> str:
        """Return ``effect.parameter``."""
        owner = "" if self.effect is None else f"{variant.effects[self.effect].name}."
        return owner + self.parameter.name

    def bounded(self, step: float) -> float:
        """Return the step that one pass may take: a logarithm moves by a factor of 4 at most."""
        return min(max(step, -_LARGEST_FACTOR), _LARGEST_FACTOR) if self.logarithmic else step

    def at_bound(self, variant: Variant) -> bool:
        """Whether a variant stands at a bound; the value at which the effect vanishes is none."""
        here = self.read(variant)
        edges = (self.parameter.low, self.low), (self.parameter.high, self.high)
        bounds = [edge for physical, edge in edges if physical != self.parameter.neutral]
        return any(abs(here - bound) < 2 * self.step for bound in bounds)

    def read(self, variant: Variant) -> float:
        """Return where a variant stands."""
        if self.effect is None:
            return variant.hysteresis.delta2_s
        value = variant.effects[self.effect].values[self.parameter.name]
        return math.log(value) if self.logarithmic else value

    def write(self, variant: Variant, value: float) -> Variant:
        """Return the variant moved to a place, kept within the bounds."""
        inside = min(max(value, self.low), self.high)
        if self.effect is None:
            return replace(variant, hysteresis=replace(variant.hysteresis, delta2_s=inside))
        physical = math.exp(inside) if self.logarithmic else inside
        physical = min(max(physical, self.parameter.low), self.parameter.high)
        effects = list(variant.effects)
        effects[self.effect] = effects[self.effect].with_values({self.parameter.name: physical})
        return replace(variant, effects=tuple(effects))


@dataclass(frozen=True)
class JointFit:
    """What a joint refit found.

    Parameters
    ----------
    variant
        Hysteresis and effects.
    train_rmse_um
        Over the counted samples of the records, offsets free (µm).
    at_bound
        Names of effects' parameters that ended at a physical bound, as ``effect.parameter``.
    standard_errors
        Of the effects' parameters, by the same names, for white residuals; None where the data do
        not fix a parameter.
    passes
        Runs over the records.
    converged
        Whether the search ended by itself.
    """

    variant: Variant
    train_rmse_um: float
    at_bound: tuple[str, ...]
    standard_errors: Mapping[str, float | None]
    passes: int
    converged: bool


def free_numbers(
    effects: Sequence[Effect], delta2_scale_s: float, held: frozenset[str] = frozenset()
) -> list[Free]:
    """δ2 and every parameter of the effects.

    Parameters
    ----------
    effects
        The effects that are fitted.
    delta2_scale_s
        Size of δ2 (s) that the data would show.
    held
        Parameters that keep their value, as ``effect.parameter``.
    """
    delta2 = Parameter(
        "delta2_s", "s", 0.0, 100 * delta2_scale_s, (0.0, delta2_scale_s), "δ2 of Eq. 8"
    )
    numbers = [Free(None, delta2)]
    numbers += [
        Free(i, p) for i, effect in enumerate(effects) for p in effect.parameters if not p.fixed
    ]
    return numbers


@dataclass(frozen=True)
class _Pass:
    """Products of the regressors at one place, offsets taken out."""

    gram: Array
    rhs: Array
    total: float
    count: int
    motion: Array  # of every column, over the command's, in the record where it moves most

    def cost(self, x: Array) -> float:
        return float(self.total - 2 * x @ self.rhs + x @ self.gram @ x)


def _run(variant: Variant, free: Sequence[Free], records: Sequence[Record]) -> _Pass:
    h = variant.hysteresis
    changed, steps = [], []
    for number in free:
        here = number.read(variant)
        step = number.step if here + number.step <= number.high else -number.step
        changed.append(number.write(variant, here + step))
        steps.append(step)
    weights = np.array(h.weights)
    size = len(weights) + len(free)
    gram, rhs, total, count = np.zeros((size, size)), np.zeros(size), 0.0, 0
    motion = np.zeros(size)
    weight_step = _WEIGHT_STEP * h.A
    for record in records:
        sums, products, samples = np.zeros(size + 1), np.zeros((size + 1, size + 1)), 0
        blocks = jacobian_blocks(variant, changed, np.array(steps), weight_step, record)
        for part, y, derivatives in blocks:
            counted = record.error_mask[part]
            rows = np.empty((int(counted.sum()), size + 1))
            rows[:, :size] = derivatives[counted]
            linear = rows[:, : len(weights)] @ weights
            rows[:, size] = (record.y_um[part] - y)[counted] + linear
            sums += rows.sum(axis=0)
            products += rows.T @ rows
            samples += len(rows)
        products -= np.outer(sums, sums) / max(samples, 1)
        spread = np.sqrt(np.maximum(np.diag(products)[:size], 0.0))
        motion = np.maximum(motion, spread / max(float(spread[0]), 1e-300))
        gram += products[:size, :size]
        rhs += products[:size, size]
        total += products[size, size]
        count += samples
    return _Pass(gram, rhs, total, count, motion)


def _solve(at: _Pass, n_weights: int, damping: float) -> Array:
    """Best weights (not negative) and step of the free numbers (either sign)."""
    moves = at.gram.shape[0] - n_weights
    signs = np.concatenate([np.ones(n_weights), np.ones(moves), -np.ones(moves)])
    index = np.concatenate([np.arange(n_weights + moves), np.arange(n_weights, n_weights + moves)])
    damped = at.gram + np.diag(
        np.concatenate([np.zeros(n_weights), damping * np.diag(at.gram)[n_weights:]])
    )
    gram = damped[np.ix_(index, index)] * np.outer(signs, signs)
    rhs = at.rhs[index] * signs
    allowed = (at.motion >= MIN_MOTION) | (np.arange(len(at.motion)) >= n_weights)
    x, _ = bounded_least_squares(gram, rhs, allowed[index], _SMALLEST_A0)
    step = x[n_weights : n_weights + moves] - x[n_weights + moves :]
    return np.concatenate([x[:n_weights], step])


def fit_joint(
    records: Sequence[Record],
    start: RDPI,
    effects: Sequence[Effect] = (),
    passes: int = 30,
    tolerance: float = 1e-4,
    held: frozenset[str] = frozenset(),
) -> JointFit:
    """Refit the weights, δ2 and every parameter of the effects to records.

    Parameters
    ----------
    records
        Training records; their `error_mask` says which samples count.
    start
        Thresholds (kept), and where weights and δ2 start.
    effects
        Effects with their starting values.
    passes
        Most runs over the records.
    tolerance
        Relative fall of the squared error below which the search ends.
    held
        Parameters that keep their value, as ``effect.parameter``.
    """
    fastest = max(float(np.max(np.abs(np.diff(r.u_V)))) / r.ts_s for r in records)
    span = max(float(np.ptp(r.u_V)) for r in records)
    free = free_numbers(effects, 0.1 * span / fastest, held)
    n_weights = len(start.weights)
    best = _with_weights(Variant(start, tuple(effects)), np.array(start.weights))
    here = _run(best, free, records)
    best = _with_weights(best, _weights_alone(here, n_weights))
    here = _run(best, free, records)
    cost = here.cost(_padded(_weights_alone(here, n_weights), here))
    used, damping, converged = 2, 1e-3, False
    while used < passes and not converged:
        x = _solve(here, n_weights, damping)
        trial = _with_weights(best, x[:n_weights])
        for number, step in zip(free, x[n_weights:], strict=True):
            trial = number.write(trial, number.read(best) + number.bounded(step))
        there = _run(trial, free, records)
        used += 1
        trial_cost = there.cost(_padded(_weights_alone(there, n_weights), there))
        if trial_cost < cost:
            converged = cost - trial_cost < tolerance * cost
            best, here, cost, damping = trial, there, trial_cost, max(damping / 10, 1e-9)
        else:
            converged = damping > _LARGEST_DAMPING
            damping *= 10
    best = _with_weights(best, _weights_alone(here, n_weights))
    edge = [n for n in free if n.effect is not None and n.at_bound(best)]
    return JointFit(
        best,
        math.sqrt(max(cost, 0.0) / max(here.count, 1)),
        tuple(n.name(best) for n in edge),
        _standard_errors(best, free, here, cost),
        used,
        converged,
    )


def _with_weights(variant: Variant, weights: Array) -> Variant:
    return replace(variant, hysteresis=replace(variant.hysteresis, weights=tuple(weights.tolist())))


def _padded(weights: Array, at: _Pass) -> Array:
    x = np.zeros(len(at.rhs))
    x[: len(weights)] = weights
    return x


def _weights_alone(at: _Pass, n_weights: int) -> Array:
    gram = np.ascontiguousarray(at.gram[:n_weights, :n_weights])
    allowed = at.motion[:n_weights] >= MIN_MOTION
    x, _ = bounded_least_squares(gram, at.rhs[:n_weights].copy(), allowed, _SMALLEST_A0)
    weights: Array = x
    return weights


def _standard_errors(
    best: Variant, free: Sequence[Free], at: _Pass, cost: float
) -> dict[str, float | None]:
    """From the curvature over the free numbers and the weights that are off their bounds."""
    n_weights = len(best.hysteresis.weights)
    active = [i for i, a in enumerate(best.hysteresis.weights) if a > 0]
    index = np.array([*active, *range(n_weights, n_weights + len(free))])
    gram = at.gram[np.ix_(index, index)]
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    covariance = np.linalg.pinv(gram / np.outer(scale, scale), rcond=1e-12, hermitian=True)
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0)) / scale
    deviation *= math.sqrt(max(cost, 0.0) / max(at.count - len(index), 1))
    errors: dict[str, float | None] = {}
    for number, value in zip(free, deviation[len(active) :], strict=True):
        if number.effect is None:
            continue
        physical = math.exp(number.read(best)) * value if number.logarithmic else float(value)
        known = math.isfinite(physical) and not number.at_bound(best)
        errors[number.name(best)] = float(physical) if known else None
    return errors
