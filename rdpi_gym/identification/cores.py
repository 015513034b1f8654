"""Fit of any hysteresis core: gains by least squares, shape by a search around them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.joint import (
    NO_FIT,
    JointFit,
    first_steps,
    fit_joint,
    kept_samples,
    shape_numbers,
)
from rdpi_gym.identification.least_squares import signed_least_squares
from rdpi_gym.identification.plausibility import check_motion
from rdpi_gym.identification.residuals import pooled_rmse, simulate_record, with_validated
from rdpi_gym.identification.scale import data_scale, plant_ranges
from rdpi_gym.identification.stack import command_rate
from rdpi_gym.measurement import Dataset, Quantities, Record, hold_out_blocks
from rdpi_gym.plant import PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, in_chain_order
from rdpi_gym.plant.parameters import Parameter
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.parallel import in_one_thread
from rdpi_gym.support.progress import Progress, silent

# Samples that enter the squares: a core of a hundred gains has hundreds for each; and for each gain
# where a price is tried.
_SAMPLES, _EACH = 40_000, 80
# Steps of the search over the shape from each start, and in all from the best.
_FIRST_STEPS, _STEPS = 6, 60
# Prices of uneven gains that are tried, and what the largest one taken may add to the least error
# of blocks held out: loops that records repeat tell nothing of what lies within them.
_PRICES, _PATIENCE = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5), 0.05
# Of the motion, what is left of it where there is no noise.
_EXACT = 1e-4
# Of the samples that move with a gain, the share of the one that moves most from which on it counts.
_LEAST_MOTION = 1e-6


@dataclass(frozen=True)
class CoreFit:
    """A hysteresis core fitted to records.

    Parameters
    ----------
    plant
        The model, ready to simulate and to save.
    shape
        The numbers that the displacement is not linear in, by name.
    standard_errors
        Of those, for white residuals; infinite where the data say nothing.
    at_bound
        Names of those that ended at a physical bound.
    offsets_um
        Offset (µm) of each training record by name.
    rmse_um
        Error (µm) of each record by name, one offset free.
    train_rmse_um, validation_rmse_um
        Error (µm) over all training and all validation records; None without any of the latter.
    evaluations
        Passes over the data.
    smoothness
        Price of uneven gains, as :func:`~rdpi_gym.identification.joint.fit_joint` has it.
    quantities
        What was measured; numbers named ``_V`` and ``_um`` are in the units of its input and
        output.
    warnings
        Samples that do not count, one sentence each.
    """

    plant: PlantModel[Any]
    shape: Mapping[str, float]
    standard_errors: Mapping[str, float]
    at_bound: tuple[str, ...]
    offsets_um: Mapping[str, float]
    rmse_um: Mapping[str, float]
    train_rmse_um: float
    validation_rmse_um: float | None
    evaluations: int
    smoothness: float = 0.0
    quantities: Quantities = field(default_factory=Quantities)
    warnings: tuple[str, ...] = ()


@in_one_thread
def fit_core(
    data: Dataset | Sequence[Record],
    kind: type[Core],
    *,
    name: str = "fit",
    progress: Progress | None = None,
) -> CoreFit:
    """Fit a hysteresis core to records by variable projection.

    For a given shape the gains are least squares, not negative where the core forbids it, with one
    free offset a record; the shape is searched around them, from each of the core's starts. Where
    one large loop leaves gains of the core open, uneven ones are priced: at the largest price that
    blocks held out of the training records hardly feel, or at none.

    Notes
    -----
    Golub, Pereyra, SIAM J. Numer. Anal. 10 (1973).
    """
    quantities = data.quantities if isinstance(data, Dataset) else Quantities()
    moving = data.train if isinstance(data, Dataset) else [r for r in data if not r.is_quiet]
    validation = list(data.validation) if isinstance(data, Dataset) else []
    check_motion(moving)
    found = _fitted(kind, list(moving), name, progress or silent)
    return with_quantities(judged(found, validation), quantities)


def with_quantities(found: CoreFit, quantities: Quantities) -> CoreFit:
    """Return a fit that says what was measured, and whose plant does where it is no piezo's."""
    plant = found.plant
    if not quantities.are_standard:
        plant = replace(plant, identification={"quantities": quantities.to_dict()})
    return replace(found, plant=plant, quantities=quantities)


def _fitted(kind: type[Core], train: Sequence[Record], name: str, report: Progress) -> CoreFit:
    """Return the fit of :func:`fit_core` to records, none of them judged beside."""
    problem = _Problem(train)
    begun: list[_Point] = []
    starts = kind.starts(data_scale(train))
    for done, start in enumerate(starts):
        report(f"starts of {kind.name}", done, len(starts))
        try:
            begun.append(problem.searched(start, _FIRST_STEPS))
        except NO_FIT as error:  # another start may lead somewhere
            if start is starts[-1] and not begun:
                raise InputError(f"core {kind.name}: {error}") from error
    best = min(begun, key=lambda point: point.squares)
    best = problem.searched(best.core, _STEPS)
    price, smooth, passes = _smoothest(train, starts, best.core)
    if price > 0.0:
        problem = _Problem(train, price, problem.passes)
        best = problem.searched(smooth, _STEPS)
    report(f"starts of {kind.name}", len(starts), len(starts))
    model = _plant(best, train, name)
    trained = [simulate_record(model, record) for record in train]
    numbers = {p.name: float(getattr(best.core, p.name)) for p in kind.shape}
    return CoreFit(
        model,
        numbers,
        problem.standard_errors(best),
        tuple(p.name for p in kind.shape if is_at_bound(p, numbers[p.name])),
        {left.record.name: model.offset_um + left.offset_um for left in trained},
        {left.record.name: left.rmse_um for left in trained},
        pooled_rmse(trained),
        None,
        problem.passes + passes,
        price,
    )


def judged(found: CoreFit, validation: Sequence[Record]) -> CoreFit:
    """Return a fit with the errors of the records to validate on."""
    if not validation:
        return found
    validated = [simulate_record(found.plant, record) for record in validation]
    rmse = with_validated(found.rmse_um, validated)
    return replace(found, rmse_um=rmse, validation_rmse_um=pooled_rmse(validated))


def _smoothest(
    train: Sequence[Record], starts: Sequence[Core], bare: Core
) -> tuple[float, Core, int]:
    """Largest price of uneven gains that blocks held out hardly feel, a core near its fit, and passes.

    The prices are gone down from the largest one, each from where the last one ended: what is
    free without a price falls into the optimum of the noise.
    """
    if not bare.loose:
        return 0.0, bare, 0
    parts = [hold_out_blocks(record) for record in train]
    fit, held = _Problem([part for part, _ in parts]), _Problem([part for _, part in parts])
    if not fit.enough_for(bare):
        return 0.0, bare, 0
    least = held.mean_square(fit.projected(bare).core)
    if least < _EXACT**2 * held.motion:  # no noise that it could learn
        return 0.0, bare, 1
    ways: list[tuple[float, Core, float]] = []
    begins, passes = starts, 1
    for price in _PRICES:
        problem = _Problem([part for part, _ in parts], price, samples=_EACH * len(bare.gains))
        best = min(
            (problem.searched(start, _FIRST_STEPS) for start in begins), key=lambda p: p.squares
        )
        begins = (best.core,)
        passes += problem.passes
        ways.append((price, best.core, held.mean_square(best.core)))
    least = min(least, *(square for *_, square in ways))
    for price, core, square in ways:
        if square <= (1.0 + _PATIENCE) ** 2 * least:
            return price, core, passes
    return 0.0, bare, passes


@dataclass(frozen=True)
class _Point:
    """A core with the best gains for its shape: what it leaves, and the squares with the price."""

    core: Core
    squares: float
    left: Array


class _Problem:
    """Records, what a core leaves of them, and what the unevenness of its gains costs."""

    def __init__(
        self,
        records: Sequence[Record],
        price: float = 0.0,
        passes: int = 0,
        samples: int = _SAMPLES,
    ) -> None:
        self._records = records
        self._kept = kept_samples(records, samples)
        self._price = price
        self.passes = passes

    def enough_for(self, core: Core) -> bool:
        """Whether there are twice as many samples as gains."""
        return sum(map(len, self._kept)) >= 2 * len(core.gains)

    def mean_square(self, core: Core) -> float:
        """Return what a core leaves as it is (µm²)."""
        rows, y = self._rows(core)
        return float(np.mean((y - np.array(core.gains) @ rows) ** 2))

    @property
    def motion(self) -> float:
        """Mean square of the displacement (µm²)."""
        y = np.concatenate([r.y_um[kept] - r.y_um[kept].mean() for r, kept in self._pairs()])
        return float(np.mean(y**2))

    def _rows(self, core: Core) -> tuple[Array, Array]:
        """Return responses and displacement (µm) at the samples kept, each record's without mean."""
        rows = np.empty((len(core.gains), sum(map(len, self._kept))))
        measured, first = [], 0
        for record, kept in self._pairs():
            part = rows[:, first : first + len(kept)]
            # every index is within: without the check NumPy copies once
            np.take(responses_to(core, record).T, kept, axis=1, out=part, mode="clip")
            part -= part.mean(axis=1, keepdims=True)
            y = record.y_um[kept]
            measured.append(y - y.mean())
            first += len(kept)
        return rows, np.concatenate(measured)

    def projected(self, core: Core) -> _Point:
        """Solve for the gains of a core of this shape."""
        self.passes += 1
        rows, y = self._rows(core)
        if not self.enough_for(core):
            raise InputError(
                f"{len(y)} samples count for {len(rows)} gains of the core {core.name}; give twice "
                "as many samples, or a core with fewer"
            )
        gram = rows @ rows.T
        spread = np.sqrt(np.diag(gram))
        moves = spread > _LEAST_MOTION * spread.max()
        if self._price > 0.0:  # what no record moves is as its neighbours are
            price = len(y) * self._price**2 * core.roughness()
            moves |= np.diag(price) > 0.0
            gram += price
        turned = np.flatnonzero(core.signed)
        may = np.concatenate([moves, moves[turned]])
        gains = signed_least_squares(gram, rows @ y, turned, may, 0.0, may)
        fitted = core.with_gains(gains.tolist())
        found = np.array(fitted.gains)
        left: Array = y - found @ rows
        paid = float(found @ price @ found) if self._price > 0.0 else 0.0
        return _Point(fitted, float(left @ left) + paid, left)

    def searched(self, start: Core, steps: int) -> _Point:
        """Search over the shape from a start, the gains solved for at each step."""
        from scipy.optimize import least_squares

        variant = Variant(start, ())
        numbers = shape_numbers(start)
        if not numbers:
            return self.projected(start)
        low, high = np.array([[n.low for n in numbers], [n.high for n in numbers]])

        def at(place: Array) -> Core:
            values = zip(numbers, place.tolist(), strict=True)
            return start.with_shape({n.parameter.name: n.physical(value) for n, value in values})

        begun = np.array([n.read(variant) for n in numbers])
        scale = float(np.sqrt(sum(np.sum(r.y_um[k] ** 2) for r, k in self._pairs())))

        def left(place: Array) -> Array:
            point = self.projected(at(place))
            paid = max(point.squares - float(point.left @ point.left), 0.0)
            return np.append(point.left, math.sqrt(paid)) / max(scale, 1e-300)

        inside = np.clip(begun, low + 1e-9 * (high - low), high - 1e-9 * (high - low))
        sizes = np.array([1.0 if n.logarithmic else n.size for n in numbers])
        found = least_squares(
            left, inside, bounds=(low, high), x_scale=sizes, diff_step=[1e-5] * len(numbers), max_nfev=steps,
            xtol=1e-12, ftol=1e-12, gtol=1e-14,
        )  # fmt: skip
        return self.projected(at(found.x))

    def _pairs(self) -> list[tuple[Record, NDArray[np.intp]]]:
        return list(zip(self._records, self._kept, strict=True))

    def standard_errors(self, point: _Point) -> dict[str, float]:
        """Return those of the shape, gains solved for anew at each difference."""
        numbers = [p for p in type(point.core).shape if not p.fixed]
        if not numbers:
            return {}
        changes = []
        for p in numbers:
            here = float(getattr(point.core, p.name))
            step = 1e-4 * (abs(here) if here != 0.0 else max(map(abs, p.typical)))
            step = step if here + step <= p.high else -step
            moved = self.projected(point.core.with_shape({p.name: here + step}))
            changes.append((moved.left - point.left) / step)
        slopes = np.stack(changes, axis=1)
        spread = np.sqrt(np.maximum(np.sum(slopes**2, axis=0), 1e-300))
        gram = (slopes / spread).T @ (slopes / spread)
        variance = float(point.left @ point.left) / max(
            len(point.left) - len(numbers) - len(point.core.gains), 1
        )
        covariance = np.linalg.pinv(gram, rcond=1e-12, hermitian=True)
        deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0) * variance) / spread
        return {
            p.name: float(value) if size > 1e-140 else math.inf
            for p, value, size in zip(numbers, deviation, spread, strict=True)
        }


def responses_to(core: Core, record: Record) -> Array:
    """Return the displacement (µm) over each gain of a core that a record's command moves, ``(T, K)``."""
    whole = record.with_history
    u = np.ascontiguousarray(whole.u_V)
    v = command_rate(u, record.ts_s, core.rate_bandwidth_hz)
    return core.responses(u, v, core.settled(()))[record.before_V.size :]


def _plant(point: _Point, train: Sequence[Record], name: str) -> PlantModel[Any]:
    make: Callable[..., PlantModel[Any]] = PlantModel
    model = make(point.core, name, *plant_ranges(train))
    lefts = [simulate_record(model, record) for record in train]
    offset = float(np.average([o.offset_um for o in lefts], weights=[o.counted for o in lefts]))
    return make(
        point.core, name, model.command_range_V, model.reference_um, offset,
        note=f"core {point.core.name} fitted to {', '.join(record.name for record in train)}.",
    )  # fmt: skip


def is_at_bound(parameter: Parameter, value: float) -> bool:
    """Whether a number of a core stands at a physical bound that is not its neutral value."""
    near = 1e-6 * max(abs(value), max(map(abs, parameter.typical)))
    low_counts = parameter.neutral != parameter.low
    return value >= parameter.high - near or (low_counts and value <= parameter.low + 1e-3 * near)


FIRST_SAMPLES = 6_000
"""Samples in the squares of first fits."""
# Steps from each start of a core, starts that are followed further, passes from each of those, and passes of a
# model that goes on with an effect more.
_START_STEPS, _FOLLOWED, _PASSES, _PASSES_ON = 6, 2, 15, 6
# Times a model's error, from which on an effect's start leads away from the records.
_AWAY = 1.02


def first_fit(
    records: Sequence[Record],
    kind: type[Core],
    effects: Sequence[Effect],
    scale: DataScale,
) -> JointFit:
    """Refit a kind of hysteresis on few samples, from the starts of which a few steps leave least.

    A kind of one start is convex in its weights: it begins on its comb.
    """
    starts = kind.starts(scale)
    variants: list[Variant[Core]] = [Variant(kind.comb(scale), tuple(effects))]
    if len(starts) > 1:
        begun = [
            first_steps(records, start, effects, _START_STEPS, samples=FIRST_SAMPLES)
            for start in starts
        ]
        begun.sort(key=lambda each: each.train_rmse_um)
        variants = [each.variant for each in begun[:_FOLLOWED]]
    fits = [
        fit_joint(
            records, variant.hysteresis, variant.effects, _PASSES, samples=FIRST_SAMPLES
        )
        for variant in variants
    ]  # fmt: skip
    return min(fits, key=lambda fit: fit.train_rmse_um)


def with_one_more(
    records: Sequence[Record], fit: JointFit, kind: type[Effect], scale: DataScale
) -> JointFit | None:
    """Refit a model with an effect more, on few samples, from the best of the effect's starts.

    Where the core has several starts, the refit begins at each of them again: what it was without the
    effect is another optimum. None where a few steps from every start of the effect lead away from the
    records.
    """
    core, present = fit.variant.hysteresis, fit.variant.effects
    begun = [
        first_steps(
            records, core, in_chain_order([*present, start]), _START_STEPS, samples=FIRST_SAMPLES
        )
        for start in kind.starts(scale)
    ]
    least = min(begun, key=lambda each: each.train_rmse_um)
    if least.train_rmse_um > _AWAY * fit.train_rmse_um:
        return None
    best = least.variant
    if core.loose or len(core.starts(scale)) == 1:
        return fit_joint(
            records,
            core,
            best.effects,
            _PASSES_ON,
            samples=FIRST_SAMPLES,
        )
    return first_fit(records, type(core), best.effects, scale)
