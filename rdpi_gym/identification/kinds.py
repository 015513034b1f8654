"""Which kind of hysteresis: every core fitted to the same records, chosen by the held-out error."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from rdpi_gym.identification.cores import CoreFit, is_at_bound, judged, stating
from rdpi_gym.identification.first_fits import first_fit, or_none, with_one_more
from rdpi_gym.identification.held_out import left_by
from rdpi_gym.identification.joint import NO_FIT, JointFit, fit_joint
from rdpi_gym.identification.kind_rules import Way, judged_way, told_apart
from rdpi_gym.identification.plausibility import check_motion
from rdpi_gym.identification.residuals import pooled_rmse, simulate_record
from rdpi_gym.identification.scale import data_scale, plant_ranges
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import CORES, PlantModel
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.base import DataScale, Effect, in_chain_order
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress, silent

# Effects that every kind is fitted beside; passes and samples of full refits, and times the best
# held-out error, up to which a kind gets one.
_BESIDE, _PASSES, _SAMPLES, _NEAR = ("creep", "sensor_lag"), 15, 20_000, 3.0
# Effects that take a kind's place in part, tried beside each where much is left: times what changes
# from sample to sample (mean square), and the share that one has to take.
_BESIDES, _MUCH, _TAKES = ("backlash", "resonance"), 1.1, 0.1
# Of the largest span of a command, how far from 0 V a record that begins at rest may begin.
_AT_REST = 0.02
# Times what is usual of a record's error, from which on no kind explains it; times the best error, up
# to which a kind is refitted without such records; and the fewest records of which any can be left out.
_UNTOLD, _HOPEFUL, _FEWEST = 3.0, 6.0, 3
# Cycles, area over the product of the standard deviations, and its standard errors, from which on
# loops are said to turn one way.
_CYCLES, _AREA, _SURE = 2, 0.02, 4.0


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
    if dataset.holds_out_quarters or not validation:
        train, validation = map(list, dataset.in_blocks)
    report, scale = progress or silent, data_scale(train)
    every, train, validation = train, from_rest(train), from_rest(validation)
    refused: dict[str, str] = {}

    def begun(present: Mapping[str, Sequence[Effect]], records: Sequence[Record]) -> list[Way]:
        ways = []
        for done, (kind, effects) in enumerate(present.items()):
            report("kinds of hysteresis", done, len(present))
            try:
                fit = first_fit(records, CORES[kind], effects, scale)
            except NO_FIT as error:
                refused[kind] = str(error)
                continue
            if fit is not None and math.isfinite(fit.train_rmse_um):
                ways.append(judged_way(fit, validation))
        report("kinds of hysteresis", len(present), len(present))
        return ways

    ways = begun(dict.fromkeys(CORES, beside(scale)), train)
    if not ways:
        raise InputError(next(iter(refused.values())))
    best = min(ways, key=_left)
    if _left(best) > _MUCH * float(best.white_um2.mean()):
        wider = _near(ways, _HOPEFUL)
        for done, way in enumerate(wider):
            report("kinds with an effect more", done, len(wider))
            tried = (
                or_none(partial(with_one_more, train, way.fit, CATALOGUE[name], scale))
                for name in _BESIDES
            )
            fits = [judged_way(fit, validation) for fit in tried if fit is not None]
            more = min(fits, key=_left, default=way)
            if _left(more) < (1.0 - _TAKES) * _left(way):
                ways[ways.index(way)] = more
    told = explained(train, [way.fit for way in ways])
    if len(told) < len(train):
        hopeful = {w.core.name: w.fit.variant.effects for w in _near(ways, _HOPEFUL)}
        ways = begun(hopeful, told)
    near = _near(ways, _NEAR)
    for done, way in enumerate(near):
        report("kinds that come near", done, len(near))
        variant = way.fit.variant
        core, effects = variant.hysteresis, variant.effects
        fit = or_none(partial(fit_joint, told, core, effects, _PASSES, samples=_SAMPLES))
        if fit is not None:
            ways[ways.index(way)] = judged_way(fit, validation)
    found = told_apart(ways, told)
    stated = {
        way.core.name: stating(
            judged(_as_core_fit(way.fit, told, name), validation), dataset.quantities
        )
        for way in ways
    }
    return KindChoice(
        tuple(sorted(stated.values(), key=_held_out)),
        stated[found.chosen.core.name],
        found.alike,
        orientation(every),
        refused,
        found.same,
        tuple(record.name for record in every if record not in told),
    )


def from_rest(records: Sequence[Record]) -> list[Record]:
    """Return the records that begin at 0 V or have a recorded past, where half of all do; else all."""
    span = max(float(np.ptp(record.u_V)) for record in records)
    kept = [r for r in records if r.before_V.size or abs(float(r.u_V[0])) <= _AT_REST * span]
    return kept if 2 * len(kept) >= len(records) else list(records)


def explained(records: Sequence[Record], fits: Sequence[JointFit]) -> list[Record]:
    """Return the records without those that no fit explains as it does the others.

    What is left of those is thrice what is usual, in µm and over their motion.
    """
    if len(records) < _FEWEST:
        return list(records)
    least = np.array([min(_rms(left_by(f.variant, r)) for f in fits) for r in records])
    share = least / np.array([max(float(np.std(r.y_um[r.error_mask])), 1e-300) for r in records])
    untold = (least > _UNTOLD * np.median(least)) & (share > _UNTOLD * np.median(share))
    return [record for record, out in zip(records, untold, strict=True) if not out]


def _rms(left: Array) -> float:
    return math.sqrt(float(np.mean(left**2)))


def _near(ways: Sequence[Way], times: float) -> list[Way]:
    """Return the kinds that leave at most so many times what the best one leaves held out (rms)."""
    least = min(map(_left, ways))
    return [way for way in ways if _left(way) <= times**2 * least]


def _left(way: Way) -> float:
    return float(way.pieces.mean())


def beside(scale: DataScale) -> tuple[Effect, ...]:
    """Return what every kind is fitted beside: a creep and a lag, which bend and widen loops as well.

    Without them the rate-dependent kinds take a lag for hysteresis.
    """
    return in_chain_order(CATALOGUE[name].starts(scale)[0] for name in _BESIDE)


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


def orientation(records: Sequence[Record]) -> bool | None:
    """Return whether loops turn clockwise in the plane of command and displacement.

    None where the area that they enclose does not stand out from its scatter over the cycles.
    """
    areas = []
    for record in records:
        u, y = record.u_V - record.u_V.mean(), record.y_um - record.y_um[record.error_mask].mean()
        size = float(np.std(u) * np.std(y))
        crossings = np.flatnonzero((u[:-1] < 0.0) & (u[1:] >= 0.0))
        for start, end in pairwise(crossings.tolist()):
            part = slice(start, end + 1)
            if size > 0.0 and record.error_mask[part].all():
                areas.append(float(np.trapezoid(y[part], u[part])) / size)
    if len(areas) < _CYCLES:
        return None
    middle = float(np.median(areas))
    spread = float(np.median(np.abs(np.array(areas) - middle)))
    if abs(middle) < max(_AREA, _SURE * 1.4826 * spread / math.sqrt(len(areas))):
        return None
    return middle > 0.0


def _held_out(fit: CoreFit) -> float:
    return math.inf if fit.validation_rmse_um is None else fit.validation_rmse_um
