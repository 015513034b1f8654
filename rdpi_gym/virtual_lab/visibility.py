"""What is left of an effect once the base model has been refitted: whether it can be seen at all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.identification.jacobian import Variant, jacobian_rows
from rdpi_gym.measurement import Record
from rdpi_gym.plant import RDPI, PlantModel
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.arrays import Array

# Thresholds that a refit may give weight to, besides the plant's own: finer where loops are small.
_COMB, _SPREAD = 40, 1.5
_STEP = 1e-3
_SMALLEST = 1e-9  # of the largest singular value: below it a combination of columns is no column


def left_over(
    plant: PlantModel,
    known: Sequence[Effect],
    span_V: float,
    records: Sequence[Record],
    differences: Sequence[Array],
    others: Sequence[Array] = (),
    every: int = 1,
) -> dict[str, float]:
    """Return what a refit leaves of a difference in displacement, by record (µm rms).

    A linear least-squares fit over all records: weights on a fine comb of thresholds, not bound to
    be positive, δ2, the parameters of the known effects, and one offset for each record. A fit
    with bounds leaves more, so this is a lower limit.
    """
    base = Variant(_combed(plant.hysteresis, span_V), tuple(known))
    changed, steps = _neighbours(base, span_V)
    grams, rights, totals = [], [], []
    for number, (record, difference) in enumerate(zip(records, differences, strict=True)):
        kept = np.arange(0, len(record.u_V), every)
        more = others[number][kept] if others else np.empty((len(kept), 0))
        gram, right, total = _products(base, changed, steps, record, difference, kept, more)
        grams.append(gram)
        rights.append(right)
        totals.append(total)
    gram_sum, right_sum = np.sum(grams, axis=0), np.sum(rights, axis=0)
    scale = np.sqrt(np.maximum(np.diag(gram_sum), 1e-300))
    whole = gram_sum / np.outer(scale, scale)
    x = np.linalg.pinv(whole, _SMALLEST, hermitian=True) @ (right_sum / scale) / scale
    squares = [
        total - 2 * x @ right + x @ gram @ x
        for gram, right, total in zip(grams, rights, totals, strict=True)
    ]
    return {
        record.name: float(np.sqrt(max(square, 0.0) / len(record.u_V[::every])))
        for record, square in zip(records, squares, strict=True)
    }


def _combed(hysteresis: RDPI, span_V: float) -> RDPI:
    """Return the same plays among many more without weight."""
    comb = span_V * (np.arange(1, _COMB + 1) / _COMB) ** _SPREAD
    own = np.array(hysteresis.thresholds_V)
    apart = np.abs(comb[:, None] - own).min(axis=1, initial=np.inf) > 1e-3 * span_V
    thresholds = np.concatenate([own, comb[apart]])
    weights = np.concatenate([hysteresis.weights[1:], np.zeros(np.count_nonzero(apart))])
    order = np.argsort(thresholds)
    return RDPI(
        (hysteresis.a0, *weights[order].tolist()), tuple(thresholds[order].tolist()),
        hysteresis.delta2_s, hysteresis.rate_bandwidth_hz,
    )  # fmt: skip


def _neighbours(base: Variant, span_V: float) -> tuple[list[Variant], Array]:
    h = base.hysteresis
    # widens the plays by a thousandth of the span at the rate of a sine of 50 Hz
    steps = [_STEP / (2 * np.pi * 50.0)]
    wider = RDPI(h.weights, h.thresholds_V, h.delta2_s + steps[0], h.rate_bandwidth_hz)
    changed = [Variant(wider, base.effects)]
    for place, effect in enumerate(base.effects):
        for parameter in effect.parameters:
            if parameter.fixed:
                continue
            value = effect.values[parameter.name]
            step = _STEP * max(abs(value), abs(parameter.typical[0]))
            step = step if value + step <= parameter.high else -step
            effects = list(base.effects)
            effects[place] = effect.with_values({parameter.name: value + step})
            changed.append(Variant(h, tuple(effects)))
            steps.append(step)
    return changed, np.array(steps)


def _products(
    base: Variant, changed: list[Variant], steps: Array, record: Record, difference: Array,
    kept: NDArray[np.intp], more: Array,
) -> tuple[Array, Array, float]:  # fmt: skip
    """Gram matrix, right-hand side and total of a record, its offset taken out."""
    gain_steps = np.full(len(base.hysteresis.gains), _STEP * base.hysteresis.a0)
    rows = jacobian_rows(base, changed, steps, gain_steps, record, kept)
    columns = np.column_stack([rows[:, :-1], more])
    columns -= columns.mean(axis=0)
    target = difference[kept] - difference[kept].mean()
    return columns.T @ columns, columns.T @ target, float(target @ target)
