"""From the comb of a diagnosis back to the threshold law of Eq. 8, and what that costs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rdpi_gym.diagnosis.candidates import SEARCH_SAMPLES, Outcome, Setting, assess
from rdpi_gym.identification.jacobian import simulate_effects
from rdpi_gym.identification.joint import JointFit, fit_joint
from rdpi_gym.plant import RDPI, PlantModel

# Plays of a model that is not given.
PLAYS = 10
# Of the noise's variance and of the error's, what the law may cost and still be kept.
_COST = 0.1
_GRID = 16
_SEARCH_PASSES = 3
_REFINEMENTS = 7


def to_threshold_law(
    setting: Setting, outcome: Outcome, given: PlantModel | None, noise_um: float
) -> tuple[PlantModel, Outcome, tuple[str, ...]]:
    """Return the plant that a diagnosis ends with, and what was decided on the way.

    Parameters
    ----------
    setting
        The data.
    outcome
        The final refit, on the comb.
    given
        The model that the diagnosis started from: its name, ranges and number of plays are kept.
    noise_um
        Noise floor (µm rms).

    Returns
    -------
    PlantModel
        With thresholds δ1 i where that costs little, else with those of the comb.
    Outcome
        Its fit and errors.
    tuple of str
        Sentences.
    """
    assert outcome.fit is not None
    plays = PLAYS if given is None else given.hysteresis.n
    law = assess(setting, "", _best_law(setting, outcome.fit, plays))
    cost = law.mean_square - outcome.mean_square
    allowed = _COST * (noise_um**2 + outcome.mean_square)
    before, after = outcome.errors.validation_rmse_um, law.errors.validation_rmse_um
    if cost <= allowed and law.fit is not None:
        note = (
            f"thresholds of Eq. 8 with {plays} plays: validation error {after:.4g} µm, "
            f"{before:.4g} µm on the comb of the diagnosis"
        )
        return _plant(setting, law.fit, law, given), law, (note,)
    note = (
        f"the thresholds stay those of the comb ({before:.4g} µm): Eq. 8 with {plays} plays would "
        f"leave {after:.4g} µm on validation records"
    )
    return _plant(setting, _slim(outcome.fit), outcome, given), outcome, (note,)


def _best_law(setting: Setting, fit: JointFit, plays: int) -> JointFit:
    """Search δ1: a grid, for its optima are many, then a golden section."""
    span = setting.scale.span_V

    def attempt(log_delta1: float, passes: int) -> JointFit:
        a = fit.variant.hysteresis
        delta1 = math.exp(log_delta1)
        weights = (a.a0, *[a.S / plays] * plays)
        start = RDPI.from_law(weights, delta1, a.delta2_s)
        samples = SEARCH_SAMPLES if passes == _SEARCH_PASSES else None
        return fit_joint(
            setting.train, start, fit.variant.effects, passes=passes, samples=samples
        )

    grid = np.linspace(math.log(0.05 * span / plays), math.log(2.0 * span / plays), _GRID)
    found = {float(x): attempt(float(x), _SEARCH_PASSES) for x in grid}
    centre = min(found, key=lambda x: found[x].train_rmse_um)
    low, high = centre - (grid[1] - grid[0]), centre + (grid[1] - grid[0])
    ratio = (math.sqrt(5.0) - 1.0) / 2.0
    for _ in range(_REFINEMENTS):
        left, right = high - ratio * (high - low), low + ratio * (high - low)
        for x in (left, right):
            if x not in found:
                found[x] = attempt(x, _SEARCH_PASSES)
        if found[left].train_rmse_um < found[right].train_rmse_um:
            high = right
        else:
            low = left
    best = min(found, key=lambda x: found[x].train_rmse_um)
    return attempt(best, 30)


def _slim(fit: JointFit) -> JointFit:
    """Drop the plays that have no weight."""
    h = fit.variant.hysteresis
    kept = [i for i, a in enumerate(h.weights[1:]) if a > 0] or [0]
    weights = (h.a0, *(h.weights[1 + i] for i in kept))
    thresholds = tuple(h.thresholds_V[i] for i in kept)
    slim = RDPI(weights, thresholds, h.delta2_s, h.rate_bandwidth_hz)
    return replace(fit, variant=replace(fit.variant, hysteresis=slim))


def _plant(
    setting: Setting, fit: JointFit, outcome: Outcome, given: PlantModel | None
) -> PlantModel:
    record = setting.train[0]
    y = simulate_effects([fit.variant], record)[:, 0]
    offset = float(np.mean((record.y_um - y)[record.error_mask]))
    scale = setting.scale
    span = 1.02 * scale.span_V
    shown = [r.y_um[r.error_mask] for r in setting.train]
    low, high = min(map(np.min, shown)), max(map(np.max, shown))
    return PlantModel(
        hysteresis=fit.variant.hysteresis,
        name="discovered" if given is None else given.name,
        command_range_V=(scale.centre_V - span, scale.centre_V + span)
        if given is None
        else given.command_range_V,
        reference_um=(float(low + high) / 2, 0.45 * float(high - low))
        if given is None
        else given.reference_um,
        offset_um=offset,
        effects=fit.variant.effects,
        note="found by a diagnosis of measured records",
        identification={
            "train_rmse_um": outcome.errors.train_rmse_um,
            "validation_rmse_um": outcome.errors.validation_rmse_um,
            "standard_errors": dict(fit.standard_errors),
            "at_bound": list(fit.at_bound),
        },
    )
