"""From a refit to a plant: its core, the threshold law of Eq. 8 where it costs little, and refits as reported."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from rdpi_gym.diagnosis.beam.constants import FIT_SAMPLES
from rdpi_gym.diagnosis.notices import Code, Notice, statement
from rdpi_gym.diagnosis.results import Errors
from rdpi_gym.diagnosis.search.setting import Outcome, Setting, assess_refit
from rdpi_gym.diagnosis.words import template
from rdpi_gym.identification.jacobian import simulate_effects
from rdpi_gym.identification.joint import FirstSteps, JointFit, first_steps, fit_joint, or_none
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Record
from rdpi_gym.measurement.quantities import template_of, unit_template
from rdpi_gym.plant import RDPI, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.parallel import ALONE, Pool
from rdpi_gym.support.words import digits

# Of the noise's variance and of the error's, what the law may cost and still be kept.
_COST = 0.1
# Price of uneven weights, as of `fit_joint`: of 0.0004 and 0.004 the one that holds out better on the measured stack.
_SMOOTHNESS = 4e-4
_GRID = 24
# Of δ1, relative, and the most steps on the way there.
_RESOLUTION, _REFINEMENTS = 3e-4, 16
# Most plays of a law where no model says how many, and the share of all weights that one carries.
_MOST_PLAYS, _LEAST_WEIGHT = 14, 1e-3


def in_few_numbers(
    setting: Setting,
    outcome: Outcome,
    given: PlantModel[Any] | None,
    noise_um: float,
    pool: Pool = ALONE,
) -> tuple[Outcome, tuple[str, ...]]:
    """Return the refit that a diagnosis ends with, and a sentence where there was a choice.

    The RDPI model has even weights where records hold out better with them, and takes the threshold
    law of Eq. 8 where that costs little. Any other core loses the thresholds without a weight where
    it is saved; the sentence says what is left.
    """
    core = outcome.fit.variant.hysteresis
    if not isinstance(core, RDPI):
        return outcome, (_said(core.slim()),)
    outcome = _evened(setting, outcome, noise_um)
    own = given is not None and isinstance(given.hysteresis, RDPI)
    plays = given.hysteresis.n if given is not None and own else None
    law, sentence = _to_threshold_law(setting, outcome, plays, noise_um, pool)
    return law, (sentence,)


def _evened(setting: Setting, outcome: Outcome, noise_um: float) -> Outcome:
    """Return the refit with even weights where that gains more than the threshold law may cost.

    Loops of one size do not tell weights apart: those of the least error follow the noise.
    """
    least = outcome.mean_square - _allowed_um2(outcome, noise_um)
    if least <= noise_um**2:
        return outcome
    variant = outcome.fit.variant
    refit = partial(
        fit_joint, setting.train, variant.hysteresis, variant.effects, samples=FIT_SAMPLES,
        smoothness=_SMOOTHNESS,
    )  # fmt: skip
    even = or_none(refit, variant.effects)
    found = outcome if even is None else assess_refit(setting, outcome.effect, even)
    return found if found.mean_square < least else outcome


def _allowed_um2(outcome: Outcome, noise_um: float) -> float:
    """Cost of the threshold law (µm²) up to which it is kept."""
    return _COST * (noise_um**2 + outcome.mean_square)


def _said(core: Core) -> str:
    shape = [(p, float(getattr(core, p.name))) for p in type(core).shape if not p.fixed]
    numbers = [
        f"{template_of(p.meaning)} {digits(v, 3)} {unit_template(p.unit)}".removesuffix(" 1")
        for p, v in shape
    ]
    used = sum(gain != 0.0 for gain in core.gains)
    return template(
        "core numbers", parts=[statement("core gains", core=core.name, used=used), *numbers]
    )


def _to_threshold_law(
    setting: Setting, outcome: Outcome, given: int | None, noise_um: float, pool: Pool
) -> tuple[Outcome, str]:
    """Return the refit with the thresholds of Eq. 8 where they cost little, and what was decided."""
    fit = outcome.fit

    def found() -> Outcome:
        best = _best_law(setting, fit, given or _MOST_PLAYS, pool)
        return assess_refit(setting, "", best if given else _without_tail(best))

    law = or_none(found)
    if law is None:
        return outcome, template("law/none")
    plays = law.fit.variant.hysteresis.n
    cost = law.mean_square - outcome.mean_square
    before, after = outcome.errors.validation_rmse_um, law.errors.validation_rmse_um
    change = 100.0 * (after / max(before, 1e-300) - 1.0)
    if cost <= _allowed_um2(outcome, noise_um):
        return law, template("law/kept", plays=plays, change=change)
    return outcome, template("law/comb", plays=plays, change=change)


def plant_of(setting: Setting, outcome: Outcome, given: PlantModel[Any] | None) -> PlantModel[Any]:
    """Return a refit as a plant to save, without the thresholds that have no weight."""
    fit = outcome.fit
    variant = replace(fit.variant, hysteresis=fit.variant.hysteresis.slim())
    record = setting.train[0]
    y = simulate_effects([variant], record)[:, 0]
    offset = float(np.mean((record.y_um - y)[record.error_mask]))
    scale = setting.scale
    span = 1.02 * scale.span_V
    shown = [r.y_um[r.error_mask] for r in setting.train]
    low, high = min(map(np.min, shown)), max(map(np.max, shown))
    make: Callable[..., PlantModel[Any]] = PlantModel
    return make(
        hysteresis=variant.hysteresis,
        name="discovered" if given is None else given.name,
        command_range_V=(scale.centre_V - span, scale.centre_V + span)
        if given is None
        else given.command_range_V,
        reference_um=(float(low + high) / 2, 0.45 * float(high - low))
        if given is None
        else given.reference_um,
        offset_um=offset,
        effects=variant.effects,
        note="found by a diagnosis of measured records",
        identification={
            "train_rmse_um": outcome.errors.train_rmse_um,
            "validation_rmse_um": outcome.errors.validation_rmse_um,
            "standard_errors": dict(fit.standard_errors),
            "at_bound": list(fit.at_bound),
        },
    )


def _best_law(setting: Setting, fit: JointFit, plays: int, pool: Pool) -> JointFit:
    """Search δ1: a grid, for its optima are many, then Brent's method around the best."""
    from scipy.optimize import minimize_scalar

    span = setting.scale.span_V
    at = partial(_at_law, setting, fit, plays)
    grid = np.linspace(math.log(0.05 * span / plays), math.log(2.0 * span / plays), _GRID)
    tried = pool.map(at, grid.tolist())

    def attempt(log_delta1: float) -> float:
        tried.append(at(log_delta1))
        return tried[-1].train_rmse_um

    best = min(range(_GRID), key=lambda k: tried[k].train_rmse_um)
    centre, width = float(grid[best]), float(grid[1] - grid[0])
    minimize_scalar(
        attempt, bounds=(centre - width, centre + width), method="bounded",
        options={"xatol": _RESOLUTION, "maxiter": _REFINEMENTS},
    )  # fmt: skip
    found = min(tried, key=lambda each: each.train_rmse_um).variant
    return fit_joint(setting.train, found.hysteresis, found.effects)


def _at_law(setting: Setting, fit: JointFit, plays: int, log_delta1: float) -> FirstSteps:
    """Give a model the thresholds of a law, and go one step towards its refit."""
    a = _rdpi(fit)
    start = RDPI.from_law((a.a0, *[a.S / plays] * plays), math.exp(log_delta1), a.delta2_s)
    return first_steps(setting.train, start, fit.variant.effects, 1, samples=FIT_SAMPLES)


def _without_tail(fit: JointFit) -> JointFit:
    """Drop the last plays of a law that carry next to nothing."""
    h = _rdpi(fit)
    carrying = np.flatnonzero(np.array(h.weights[1:]) > _LEAST_WEIGHT * h.S)
    n = int(carrying[-1]) + 1 if carrying.size else 1
    law = RDPI(h.weights[: n + 1], h.thresholds_V[:n], h.delta2_s, h.rate_bandwidth_hz)
    return replace(fit, variant=replace(fit.variant, hysteresis=law))


def _rdpi(fit: JointFit) -> RDPI:
    core = fit.variant.hysteresis
    assert isinstance(core, RDPI)
    return core


@dataclass(frozen=True)
class Refit:
    """A model that was refitted whole, as a search goes through its candidates.

    Parameters
    ----------
    effect, form
        The candidate in it; an empty effect is the model that the candidates are added to, an empty
        form the simplest.
    plant
        The model; None where no refit converged.
    errors
        What it leaves (µm rms).
    parameters
        Of the candidate.
    standard_errors
        Of every number that was fitted, as ``effect.parameter``, those of the core by their name
        alone; None where the records do not fix it.
    at_bound
        Which of them ended at a bound.
    remark
        Why there is no refit.
    """

    effect: str
    form: str
    plant: PlantModel[Any] | None
    errors: Errors
    parameters: Mapping[str, float]
    standard_errors: Mapping[str, float | None]
    at_bound: tuple[str, ...] = ()
    remark: str = ""


OnCandidate: TypeAlias = Callable[[Refit], None]
"""Called as soon as a refit is there, in the process that searches."""


def refit_of(setting: Setting, outcome: Outcome, given: PlantModel[Any] | None) -> Refit:
    """Return what a search found for one candidate."""
    values = outcome.fitted.values if outcome.effect else {}
    return Refit(
        outcome.effect, outcome.form, plant_of(setting, outcome, given), outcome.errors, values,
        dict(outcome.fit.standard_errors), tuple(outcome.fit.at_bound),
    )  # fmt: skip


AUTO = "auto"
"""Asks for every kind of hysteresis."""


def kind_experiment(kind: type[Core], alike: Iterable[type[Core]]) -> Notice | None:
    """Name the experiment that would tell a kind from those that the records do not tell from it."""
    others = list(alike)
    if not others:
        return None
    ways = {
        Code.LOOPS_WITHIN: [o for o in others if o.wipes_out != kind.wipes_out],
        Code.ONE_LOOP: [o for o in others if o.rated != kind.rated],
    }
    most = max(ways, key=lambda way: len(ways[way]))
    code, told = (most, ways[most]) if ways[most] else (Code.NESTED, others)
    return Notice(code, (kind.name, *(other.name for other in told)))


def on_comb(core: Core, records: Sequence[Record]) -> Core:
    """Return a core on the whole comb of its kind again, with weights where it has them."""
    return core.on(type(core).comb(data_scale(records)))
