"""Choice of the kind of hysteresis: every core fitted to the same records, compared by held-out error."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from rdpi_gym.identification.cores import (
    CoreFit,
    first_fit,
    is_at_bound,
    judged,
    responses_to,
    with_one_more,
    with_quantities,
)
from rdpi_gym.identification.joint import NO_FIT, JointFit, fit_joint, or_none
from rdpi_gym.identification.plausibility import check_motion, orientation
from rdpi_gym.identification.residuals import (
    beats,
    centred_residual,
    pieces_of,
    pooled_rmse,
    simulate_record,
)
from rdpi_gym.identification.scale import data_scale, plant_ranges
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import CORES, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.base import DataScale, Effect, in_chain_order
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress, silent

# Ratio of held-out rms errors up to which two kinds are equally good.
_EQUAL_RATIO = 1.05
# Share of bootstrap draws from which on the better of two kinds is significantly better.
_SIGNIFICANT = 0.95
# Ratio of mean squares beyond the noise up to which a worse kind is not excluded: where an effect is
# missing as well, small differences do not separate kinds.
_INCONCLUSIVE_RATIO = 3.0
# Exponent of the ratio of free numbers in the price of the freer kind (mean square).
_PRICE_EXPONENT = 0.1
# Relative change of the displacement, and standard errors of the numbers, within which two models
# are the same.
_SAME_DISPLACEMENT, _SAME_ERRORS = 1e-3, 2.0


@dataclass(frozen=True)
class KindFit:
    """A kind of hysteresis refitted to records, and what it leaves of records held out."""

    fit: JointFit
    # float64[R, PIECES]: Mean squares (µm²) of what it leaves of the pieces of each record
    pieces: Array
    # float64[R]: Mean square (µm²) of what changes from one sample to the next in that: of white
    # noise all of it, of what a model misses little
    white_um2: Array

    @property
    def core(self) -> Core:
        """The core as it was fitted."""
        return self.fit.variant.hysteresis

    @property
    def freedom(self) -> int:
        """Numbers of the core: gains that are not zero, and those of its shape."""
        free = sum(not p.fixed for p in self.core.shape)
        return int(np.count_nonzero(self.core.gains)) + free


def held_out_fit(fit: JointFit, held_out: Sequence[Record]) -> KindFit:
    """Return a refit with what it leaves of records held out."""
    lefts = [centred_residual(fit.variant, record) for record in held_out]
    white = [float(np.mean(np.diff(left) ** 2)) / 2.0 if left.size > 1 else 0.0 for left in lefts]
    return KindFit(fit, pieces_of(lefts), np.array(white))


@dataclass(frozen=True)
class KindComparison:
    """Comparison of kinds by their held-out errors."""

    chosen: KindFit  # Kind of the fewest numbers among those no worse than the best
    # Names of the others that the records do not tell from the best, and of kinds that are one
    # model with the chosen one
    alike: tuple[str, ...]
    same: tuple[str, ...]  # The latter
    # Share of draws of held-out pieces in which the best one beats every kind that is told from
    # it; None where there is none
    confidence: float | None


def compare_kinds(
    rivals: Sequence[KindFit], records: Sequence[Record], seed: int = 0
) -> KindComparison:
    """Compare kinds by what they leave of records held out.

    Every record counts alike: by what kinds leave of it over the least that any of them leaves.
    """
    least = np.maximum(np.min([rival.pieces.mean(axis=1) for rival in rivals], axis=0), 1e-300)
    pieces = [rival.pieces / least[:, None] for rival in rivals]
    left = [float(piece.mean()) for piece in pieces]
    best = int(np.argmin(left))
    noise = float(np.minimum(rivals[best].white_um2 / least, 1.0).mean())
    beyond = max(left[best] - noise, 0.0)
    rng, near = np.random.default_rng(seed), list[KindFit]()
    alike, apart = list[str](), list[float]()
    for k, rival in enumerate(rivals):
        priced = max(rivals[best].freedom / max(rival.freedom, 1), 1.0) ** _PRICE_EXPONENT
        if left[k] <= _EQUAL_RATIO**2 * priced * left[best]:
            near.append(rival)
            continue
        sure = beats(pieces[k], pieces[best], rng)
        if sure < _SIGNIFICANT or left[k] - noise < _INCONCLUSIVE_RATIO * beyond:
            alike.append(rival.core.name)
        else:
            apart.append(sure)
    chosen = min(near, key=lambda rival: rival.freedom)
    same = same_models(chosen.core, records, chosen.fit.shape_errors)
    alike = [rival.core.name for rival in near if rival is not chosen] + alike
    alike += [name for name in same if name not in alike]
    return KindComparison(chosen, tuple(alike), same, min(apart) if apart else None)


def same_models(
    core: Core, records: Sequence[Record], errors: Mapping[str, float | None]
) -> tuple[str, ...]:
    """Return the other kinds that are one model with a core at the numbers that a fit found.

    The numbers of a case that both kinds have are within two standard errors, or putting them there
    changes the displacement by less than a thousandth.
    """
    met = {
        case for case, numbers in core.cases.items() if _holds_at(core, numbers, records, errors)
    }
    return tuple(k.name for k in CORES.values() if k.name != core.name and met & set(k.cases))


def _holds_at(
    core: Core,
    numbers: Mapping[str, float],
    records: Sequence[Record],
    errors: Mapping[str, float | None],
) -> bool:
    changed = {}
    for name, value in numbers.items():
        error = errors.get(name, 0.0)
        if error is None or abs(getattr(core, name) - value) > _SAME_ERRORS * error:
            changed[name] = value
    try:
        there = replace(core, **changed)  # type: ignore[type-var]
    except InputError:  # what the other numbers do not allow
        return False
    moves = changes = 0.0
    for record in records:
        here = responses_to(core, record) @ np.array(core.gains)
        change = responses_to(there, record) @ np.array(there.gains) - here
        moves += len(here) * float(np.var(here))
        changes += len(here) * float(np.var(change))
    return changes <= _SAME_DISPLACEMENT**2 * moves


# Effects that are fitted together with every kind.
_COMMON_EFFECTS = ("creep", "sensor_lag")
# Passes and samples of a full refit, and the ratio of held-out rms errors up to which a kind gets one.
_PASSES, _SAMPLES, _REFIT_RATIO = 15, 20_000, 3.0
# Effects that imitate a kind, tried with each where the mean square exceeds so many times that of
# the sample-to-sample differences, and the share of the mean square that one has to remove.
_IMITATING_EFFECTS, _UNEXPLAINED_RATIO, _LEAST_GAIN = ("backlash", "resonance"), 1.1, 0.1
# Share of the largest command span within which a record begins at rest.
_AT_REST = 0.02
# Ratio to the median error from which on a record is unexplained by all kinds; ratio of rms errors up
# to which a kind is refitted without such records; fewest records of which one can be left out.
_UNEXPLAINED_RECORD, _HOPEFUL_RATIO, _FEWEST_RECORDS = 3.0, 6.0, 3


@dataclass(frozen=True)
class KindChoice:
    """Kinds of hysteresis, each fitted to the same records.

    Parameters
    ----------
    fits : tuple of CoreFit
        Best held-out error first.
    chosen
        That of the fewest numbers among those that leave least.
    alike
        Names of the others among those, and of kinds that are one model with it.
    clockwise
        Whether the loops turn clockwise; None: they enclose no area that stands out.
    refused
        Why a kind was not fitted, by its name.
    same
        Names of those among `alike` that are one model with the chosen kind at the numbers found.
    left_out
        Names of records that were not fitted: they begin away from rest while others begin there, or
        no kind explains them as it does the others.
    """

    fits: tuple[CoreFit, ...]
    chosen: CoreFit
    alike: tuple[str, ...]
    clockwise: bool | None
    refused: Mapping[str, str]
    same: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()


def choose_kind(
    data: Dataset | Sequence[Record], *, name: str = "fit", progress: Progress | None = None
) -> KindChoice:
    """Fit every kind of hysteresis and order them by their held-out error.

    Each is fitted together with a creep and a lag of the sensor, which bend and widen loops as well:
    without them the rate-dependent kinds take a lag for hysteresis. First fits on few samples show
    which kinds come near the best; those are refitted on more. Where even the best leaves much, those
    are tried beside a backlash and beside a resonance too, of which kinds take the place. A record that
    begins away from rest, while others begin there, is left out, for some kinds never forget what
    came before; so is one that no kind explains as it does the others. Without records to validate
    on, blocks of each record are held out.
    """
    dataset = data if isinstance(data, Dataset) else Dataset("records", tuple(data))
    train, validation = list(dataset.train), list(dataset.validation)
    check_motion(train)
    report, scale = progress or silent, data_scale(train)
    every, train, validation = train, from_rest(train), from_rest(validation)
    refused: dict[str, str] = {}

    def first_fits(
        present: Mapping[str, Sequence[Effect]], records: Sequence[Record]
    ) -> list[KindFit]:
        rivals = []
        for done, (kind, effects) in enumerate(present.items()):
            report("kinds of hysteresis", done, len(present))
            try:
                fit = first_fit(records, CORES[kind], effects, scale)
            except NO_FIT as error:
                refused[kind] = str(error)
                continue
            if math.isfinite(fit.train_rmse_um):
                rivals.append(held_out_fit(fit, validation))
        report("kinds of hysteresis", len(present), len(present))
        return rivals

    rivals = first_fits(dict.fromkeys(CORES, beside(scale)), train)
    if not rivals:
        raise InputError(next(iter(refused.values())))
    best = min(rivals, key=_mean_square)
    if _mean_square(best) > _UNEXPLAINED_RATIO * float(best.white_um2.mean()):
        wider = _near(rivals, _HOPEFUL_RATIO)
        for done, rival in enumerate(wider):
            report("kinds with an effect more", done, len(wider))
            tried = (
                or_none(partial(with_one_more, train, rival.fit, CATALOGUE[name], scale))
                for name in _IMITATING_EFFECTS
            )
            fits = [held_out_fit(fit, validation) for fit in tried if fit is not None]
            more = min(fits, key=_mean_square, default=rival)
            if _mean_square(more) < (1.0 - _LEAST_GAIN) * _mean_square(rival):
                rivals[rivals.index(rival)] = more
    explainable = explained(train, [rival.fit for rival in rivals])
    if len(explainable) < len(train):
        hopeful = {w.core.name: w.fit.variant.effects for w in _near(rivals, _HOPEFUL_RATIO)}
        rivals = first_fits(hopeful, explainable)
    near = _near(rivals, _REFIT_RATIO)
    for done, rival in enumerate(near):
        report("kinds that come near", done, len(near))
        variant = rival.fit.variant
        core, effects = variant.hysteresis, variant.effects
        fit = or_none(partial(fit_joint, explainable, core, effects, _PASSES, samples=_SAMPLES))
        if fit is not None:
            rivals[rivals.index(rival)] = held_out_fit(fit, validation)
    found = compare_kinds(rivals, explainable)
    stated = {
        rival.core.name: with_quantities(
            judged(_as_core_fit(rival.fit, explainable, name), validation), dataset.quantities
        )
        for rival in rivals
    }
    return KindChoice(
        tuple(sorted(stated.values(), key=_held_out)),
        stated[found.chosen.core.name],
        found.alike,
        orientation(every),
        refused,
        found.same,
        tuple(record.name for record in every if record not in explainable),
    )


def from_rest(records: Sequence[Record]) -> list[Record]:
    """Return the records that begin at 0 V or have a recorded past, where half of all do; else all."""
    span = max(float(np.ptp(record.u_V)) for record in records)
    kept = [r for r in records if r.before_V.size or abs(float(r.u_V[0])) <= _AT_REST * span]
    return kept if 2 * len(kept) >= len(records) else list(records)


def explained(records: Sequence[Record], fits: Sequence[JointFit]) -> list[Record]:
    """Return the records without those that no fit explains as it does the others.

    Their error is three times the median, in µm and relative to their motion.
    """
    if len(records) < _FEWEST_RECORDS:
        return list(records)
    least = np.array([min(_rms(centred_residual(f.variant, r)) for f in fits) for r in records])
    share = least / np.array([max(float(np.std(r.y_um[r.error_mask])), 1e-300) for r in records])
    unexplained = (least > _UNEXPLAINED_RECORD * np.median(least)) & (
        share > _UNEXPLAINED_RECORD * np.median(share)
    )
    return [record for record, out in zip(records, unexplained, strict=True) if not out]


def _rms(left: Array) -> float:
    return math.sqrt(float(np.mean(left**2)))


def _near(rivals: Sequence[KindFit], times: float) -> list[KindFit]:
    """Return the kinds whose held-out rms error is at most so many times the least."""
    least = min(map(_mean_square, rivals))
    return [rival for rival in rivals if _mean_square(rival) <= times**2 * least]


def _mean_square(rival: KindFit) -> float:
    return float(rival.pieces.mean())


def beside(scale: DataScale) -> tuple[Effect, ...]:
    """Return what every kind is fitted beside: a creep and a lag, which bend and widen loops as well.

    Without them the rate-dependent kinds take a lag for hysteresis.
    """
    return in_chain_order(CATALOGUE[name].starts(scale)[0] for name in _COMMON_EFFECTS)


def _as_core_fit(fit: JointFit, train: Sequence[Record], name: str) -> CoreFit:
    """Return a joint refit as the fit of a core."""
    core = fit.variant.hysteresis
    make: Callable[..., PlantModel[Any]] = PlantModel
    note = f"core {core.name} fitted to {', '.join(record.name for record in train)}."
    plant = make(core, name, *plant_ranges(train), effects=fit.variant.effects, note=note)
    trained = [simulate_record(plant, record) for record in train]
    offset = float(np.average([o.offset_um for o in trained], weights=[o.counted for o in trained]))
    numbers = {p.name: float(getattr(core, p.name)) for p in type(core).shape}
    return CoreFit(
        replace(plant, offset_um=offset),
        numbers,
        {n: math.inf if error is None else error for n, error in fit.shape_errors.items()},
        tuple(p.name for p in type(core).shape if is_at_bound(p, numbers[p.name])),
        {left.record.name: left.offset_um for left in trained},
        {left.record.name: left.rmse_um for left in trained},
        pooled_rmse(trained),
        None,
        fit.passes,
        fit.smoothness,
    )


def _held_out(fit: CoreFit) -> float:
    return math.inf if fit.validation_rmse_um is None else fit.validation_rmse_um
