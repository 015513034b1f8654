"""Hysteresis of a kind refitted on few samples, from its best starts: what a choice among kinds is made by."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.joint import NO_FIT, JointFit, first_steps, fit_joint
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import DataScale, Effect, in_chain_order

FIRST_SAMPLES = 6_000
"""Samples in the squares of first fits."""
# Steps from each start of a core, starts that are followed further, passes from each of those, and passes of a
# model that goes on with an effect more.
_FIRST_STEPS, _FOLLOWED, _PASSES, _PASSES_ON = 6, 2, 15, 6
# Times a model's error, from which on an effect's start leads away from the records.
_AWAY = 1.02


def first_fit(
    records: Sequence[Record],
    kind: type[Core],
    effects: Sequence[Effect],
    scale: DataScale,
    smoothness: float = 0.0,
    least_um: float = math.inf,
) -> JointFit | None:
    """Refit a kind of hysteresis on few samples, from the starts of which a few steps leave least.

    A kind of one start is convex in its weights: it begins on its comb.
    """
    starts = kind.starts(scale)
    variants: list[Variant[Core]] = [Variant(kind.comb(scale), tuple(effects))]
    if len(starts) > 1:
        begun = [
            first_steps(
                records, start, effects, _FIRST_STEPS, samples=FIRST_SAMPLES, smoothness=smoothness
            )
            for start in starts
        ]
        begun.sort(key=lambda each: each.train_rmse_um)
        if begun[0].train_rmse_um > least_um:
            return None
        variants = [each.variant for each in begun[:_FOLLOWED]]
    fits = [
        fit_joint(
            records, variant.hysteresis, variant.effects, _PASSES, samples=FIRST_SAMPLES,
            smoothness=smoothness,
        )
        for variant in variants
    ]  # fmt: skip
    return min(fits, key=lambda fit: fit.train_rmse_um)


def or_none(fit: Callable[[], JointFit | None]) -> JointFit | None:
    """Return a fit, or None where it leaves the bounds of its numbers: one of several is dropped."""
    try:
        return fit()
    except NO_FIT:
        return None


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
            records, core, in_chain_order([*present, start]), _FIRST_STEPS, samples=FIRST_SAMPLES
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
            smoothness=fit.smoothness,
        )
    return first_fit(records, type(core), best.effects, scale, fit.smoothness)
