"""Which kind of hysteresis: every core fitted to the same records, chosen by the held-out error."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from rdpi_gym.identification.cores import (
    CoreFit,
    fitted_core,
    is_at_bound,
    judged,
    responses_to,
    stating,
)
from rdpi_gym.identification.joint import fit_joint
from rdpi_gym.identification.plausibility import check_motion
from rdpi_gym.identification.residuals import pooled_rmse, simulate_record
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Dataset, Record, hold_out_blocks
from rdpi_gym.plant import CORES, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.base import DataScale, Effect, in_chain_order
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress, silent

# Of the best held-out error, what another kind may have more and not be told from it.
_ALIKE = 0.05
# What moving numbers may change of the displacement, and how many standard errors they may move,
# where a model is one with that of other numbers.
_SAME, _ERRORS = 1e-3, 2.0
# Effects that every kind is fitted beside, passes and samples of those refits.
_BESIDE, _STEPS_BESIDE, _SAMPLES_BESIDE = ("creep", "sensor_lag"), 15, 20_000
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
        That of the fewest numbers among those that the records do not tell from the best.
    alike
        Names of the others among those, and of kinds that are one model with it.
    clockwise
        Whether the loops turn clockwise; None: they enclose no area that stands out.
    refused
        Why a kind was not fitted, by its name.
    same
        Names of those among `alike` that are one model with the chosen kind at the numbers found.
    """

    fits: tuple[CoreFit, ...]
    chosen: CoreFit
    alike: tuple[str, ...]
    clockwise: bool | None
    refused: Mapping[str, str]
    same: tuple[str, ...] = ()


def choose_kind(
    data: Dataset | Sequence[Record], *, name: str = "fit", progress: Progress | None = None
) -> KindChoice:
    """Fit every kind of hysteresis and order them by their held-out error.

    Each is fitted together with a creep and a lag of the sensor, which bend and widen loops as well:
    without them the rate-dependent kinds take a lag for hysteresis. Without records to validate on,
    blocks of each record are held out.

    Parameters
    ----------
    data, name, progress
        As :func:`fit_core`.

    Returns
    -------
    KindChoice

    Raises
    ------
    InputError
        As :func:`fit_core`.

    Examples
    --------
    >>> from rdpi_gym.plant import P5, Plant
    >>> t = np.arange(0, 2.0, 1e-3)
    >>> u = 20 * np.sin(2 * np.pi * t) * t
    >>> y = Plant(P5, 1e-3).simulate(u)
    >>> found = choose_kind([Record("growing", t, u, y, ts_s=1e-3)])
    >>> found.chosen.plant.hysteresis.name
    'rdpi'
    """
    dataset = data if isinstance(data, Dataset) else Dataset("records", tuple(data))
    train, validation = list(dataset.train), list(dataset.validation)
    check_motion(train)
    if dataset.holds_out_quarters or not validation:
        whole = [r for r in dataset.records if r.role == "train" and not r.is_quiet]
        parts = [hold_out_blocks(record) for record in whole]
        train, validation = [fit for fit, _ in parts], [held for _, held in parts]
    clockwise = orientation(train)
    kinds = list(CORES.values())
    report, fits, refused = progress or silent, [], {}
    for done, kind in enumerate(kinds):
        report("kinds of hysteresis", done, len(kinds))
        try:
            found = _beside(fitted_core(kind, train, name, silent), train)
        except InputError as error:
            refused[kind.name] = str(error)
            continue
        fits.append(stating(judged(found, validation), dataset.quantities))
    report("kinds of hysteresis", len(kinds), len(kinds))
    if not fits:
        raise InputError(next(iter(refused.values())))
    fits.sort(key=_held_out)
    best = _held_out(fits[0])
    near = [fit for fit in fits if _held_out(fit) <= (1.0 + _ALIKE) * best]
    chosen = min(near, key=_freedom)
    others = [fit.plant.hysteresis.name for fit in near if fit is not chosen]
    same = same_models(chosen, train)
    alike = (*others, *(name for name in same if name not in others))
    return KindChoice(tuple(fits), chosen, alike, clockwise, refused, same)


def same_models(fit: CoreFit, records: Sequence[Record]) -> tuple[str, ...]:
    """Return the other kinds that are one model with a fit at the numbers that it found.

    The numbers of a case that both kinds have are within two standard errors, or putting them there
    changes the displacement by less than a thousandth.

    Parameters
    ----------
    fit
        Of any core.
    records
        Records that it was fitted to.

    Examples
    --------
    >>> from rdpi_gym.identification.cores import fit_core
    >>> from rdpi_gym.plant import Plant
    >>> t = np.arange(0, 2.0, 1e-3)
    >>> u = 20 * np.sin(2 * np.pi * t) * t
    >>> plant = PlantModel(CORES["duhem"](1.0, 0.7, 12.0), "piezo", (-40.0, 40.0), (0.0, 10.0))
    >>> record = Record("growing", t, u, Plant(plant, 1e-3).simulate(u), ts_s=1e-3)
    >>> same_models(fit_core([record], CORES["duhem"]), [record])
    ('asymmetric_bouc_wen', 'bouc_wen')
    """
    core: Core = fit.plant.hysteresis
    met = {case for case, numbers in core.cases.items() if _stands_at(fit, core, numbers, records)}
    return tuple(k.name for k in CORES.values() if k.name != core.name and met & set(k.cases))


def _stands_at(
    fit: CoreFit, core: Core, numbers: Mapping[str, float], records: Sequence[Record]
) -> bool:
    told = {
        name: value
        for name, value in numbers.items()
        if abs(getattr(core, name) - value) > _ERRORS * fit.standard_errors.get(name, 0.0)
    }
    try:
        there = replace(core, **told)  # type: ignore[type-var]
    except InputError:  # what the other numbers do not allow
        return False
    moves = changes = 0.0
    for record in records:
        here = responses_to(core, record) @ np.array(core.gains)
        change = responses_to(there, record) @ np.array(there.gains) - here
        moves += len(here) * float(np.var(here))
        changes += len(here) * float(np.var(change))
    return changes <= _SAME**2 * moves


def beside(scale: DataScale) -> tuple[Effect, ...]:
    """Return what every kind is fitted beside: a creep and a lag, which bend and widen loops as well.

    Without them the rate-dependent kinds take a lag for hysteresis.

    Parameters
    ----------
    scale
        Size of the data.
    """
    return in_chain_order(CATALOGUE[name].starts(scale)[0] for name in _BESIDE)


def _beside(found: CoreFit, train: Sequence[Record]) -> CoreFit:
    """Return a fit with a creep and a lag of the sensor refitted beside the core."""
    core = found.plant.hysteresis
    variant = fit_joint(
        train,
        core,
        beside(data_scale(train)),
        _STEPS_BESIDE,
        samples=_SAMPLES_BESIDE,
        smoothness=found.smoothness,
    ).variant
    make: Callable[..., PlantModel[Any]] = PlantModel
    bench = found.plant
    plant = make(
        variant.hysteresis, bench.name, bench.command_range_V, bench.reference_um,
        effects=variant.effects, note=bench.note,
    )  # fmt: skip
    trained = [simulate_record(plant, record) for record in train]
    offset = float(np.average([o.offset_um for o in trained], weights=[o.counted for o in trained]))
    core = variant.hysteresis
    numbers = {p.name: float(getattr(core, p.name)) for p in type(core).shape}
    return replace(
        found,
        plant=replace(plant, offset_um=offset),
        shape=numbers,
        at_bound=tuple(p.name for p in type(core).shape if is_at_bound(p, numbers[p.name])),
        offsets_um={left.record.name: left.offset_um for left in trained},
        rmse_um={left.record.name: left.rmse_um for left in trained},
        train_rmse_um=pooled_rmse(trained),
    )


def orientation(records: Sequence[Record]) -> bool | None:
    """Return whether loops turn clockwise in the plane of command and displacement.

    None where the area that they enclose does not stand out from its scatter over the cycles.

    Parameters
    ----------
    records
        Records that move.

    Examples
    --------
    >>> t = np.arange(0.0, 5.0, 1e-3)
    >>> u, lag, lead = (np.sin(2 * np.pi * t + shift) for shift in (0.0, -0.3, 0.3))
    >>> orientation([Record("lag", t, u, lag, ts_s=1e-3)])
    False
    >>> orientation([Record("lead", t, u, lead, ts_s=1e-3)])
    True
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


def _freedom(fit: CoreFit) -> int:
    return int(np.count_nonzero(fit.plant.hysteresis.gains)) + len(fit.shape)
