"""Random effects of a size that suits a plant, and that can be seen there."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.identification.jacobian import Neighbours, Variant
from rdpi_gym.measurement import Record
from rdpi_gym.plant import RDPI, PlantModel
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects import CATALOGUE, Effect, Parameter
from rdpi_gym.plant.effects.base import in_chain_order
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.virtual_lab.dataset import Truth, clock, plant_displacement
from rdpi_gym.virtual_lab.independent import twins

# Thresholds that a refit may give weight to, besides the plant's own: finer where loops are small.
_COMB, _SPREAD = 40, 1.5
_STEP = 1e-3
_SMALLEST = 1e-9  # of the largest singular value: below it a combination of columns is no column


def refit_residuals(
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
    rows = Neighbours(base, changed, steps, gain_steps).derivatives(record, kept)
    columns = np.column_stack([rows[:, :-1], more])
    columns -= columns.mean(axis=0)
    target = difference[kept] - difference[kept].mean()
    return columns.T @ columns, columns.T @ target, float(target @ target)


HIDEABLE: tuple[str, ...] = tuple(twins())
"""Effects that the independent formulation knows."""

VISIBLE = 3.0
"""Noise floors (rms) that an effect leaves at least, after a refit, on one record."""

_TYPICAL_SPAN = 40.0  # V and µm: the size of the plants that the typical ranges are written for
_POSITIONS = ("centre_V", "extremum_V")  # commands, and no differences of commands
_MAINS_HZ = (50.0, 60.0)
_PATIENCE, _WIDER, _ATTEMPTS = 4, 1.5, 40
_COARSE_S = 1e-4  # grid on which visibility is judged: no data are made on it


class MaskedError(InputError):
    """No draw shows an effect: noise or another effect masks it."""


def draw_effect(name: str, truth: Truth, rng: np.random.Generator, widened: float = 1.0) -> Effect:
    """Draw the parameters of an effect.

    Parameters
    ----------
    name
        One of :data:`HIDEABLE`.
    truth
        The plant: its span, its stroke and the centre of its command.
    rng
        Where from.
    widened
        Factor by which the typical ranges reach further at both ends.

    Returns
    -------
    Effect
        Each parameter from its typical range: uniform, or uniform in its logarithm where the range
        spans a factor of three or more. Typical ranges are those of a stage of 40 V and 40 µm:
        voltages and their rates are scaled with the span of the experiments, lengths and their
        rates with the stroke, times and shares stay. The sign is random where the bounds are
        symmetric. The mains has 50 or 60 Hz.

    Examples
    --------
    >>> from rdpi_gym.plant import P5
    >>> small = Truth(P5, (), noise_um=0.0, seed=0)
    >>> limits = [draw_effect("saturation", small, np.random.default_rng(k)) for k in range(20)]
    >>> all(1.5 <= e.limit_V / small.span_V <= 4.0 for e in limits)
    True
    """
    kind = CATALOGUE[name]
    values = {p.name: _draw(p, truth, rng, widened) for p in kind.parameters}
    return kind(**values)


def _draw(parameter: Parameter, truth: Truth, rng: np.random.Generator, widened: float) -> float:
    p = parameter
    if p.name == "frequency_hz":
        return float(rng.choice(_MAINS_HZ))
    size = {"V": truth.span_V, "V/s": truth.span_V, "µm": truth.stroke_um, "µm/s": truth.stroke_um}
    scale = size.get(p.unit, _TYPICAL_SPAN) / _TYPICAL_SPAN
    low, high = (scale * end for end in p.typical)
    if high > low > 0:
        low, high = low / widened, high * widened
    low, high = min(max(low, p.low), p.high), min(max(high, p.low), p.high)
    if low > 0 and high >= 3.0 * low:
        value = math.exp(rng.uniform(math.log(low), math.log(high)))
    else:
        value = rng.uniform(low, high)
    if p.low == -p.high and low > 0:
        value *= rng.choice((-1.0, 1.0))
    if p.name in _POSITIONS:
        value += truth.centre_V
    return float(min(max(value, p.low), p.high))


def hide(names: Sequence[str], truth: Truth, rng: np.random.Generator) -> Truth:
    """Draw effects until each of them can be seen, and hide them.

    An effect can be seen where it leaves :data:`VISIBLE` noise floors rms on one record at least,
    after all that a refit of the base model and of the other effects can take up of it
    (:func:`~rdpi_gym.virtual_lab.draws.refit_residuals`). Where a few draws in a row cannot, the
    typical ranges are widened. This is judged on a coarser grid than the data are made on.

    Parameters
    ----------
    names
        Of :data:`HIDEABLE`, each once.
    truth
        The plant, with nothing hidden yet.
    rng
        Where the draws come from.

    Returns
    -------
    Truth
        The same plant with the effects hidden.

    Raises
    ------
    MaskedError
        No draw shows each of the effects: noise hides one, or they mask each other.
    """
    if not names:
        return truth
    core: Core = truth.plant.hysteresis
    if not isinstance(core, RDPI):
        raise InputError(
            f"effects are hidden in plants of the core {RDPI.name}, and plant {truth.plant.name} has "
            f"the core {core.name}; give the plant its effects in its file, and hide nothing"
        )
    view = View(truth)
    for attempt in range(_ATTEMPTS):
        widened = _WIDER ** (attempt // _PATIENCE)
        effects = [draw_effect(name, truth, rng, widened) for name in names]
        if view.shows(effects):
            return truth.with_hidden(effects)
    raise MaskedError(
        f"{' and '.join(names)} cannot be seen on {truth.plant.name} with {truth.noise_um} µm of noise "
        f"in {_ATTEMPTS} draws; hide something else, or give less noise"
    )


def hide_one(names: Sequence[str], truth: Truth, rng: np.random.Generator) -> Truth:
    """Hide one effect, chosen at random among those that can be seen.

    Parameters
    ----------
    names, truth, rng
        As :func:`hide`.

    Raises
    ------
    MaskedError
        None can be seen.
    """
    for name in rng.permutation(list(names)):
        try:
            return hide([str(name)], truth, rng)
        except MaskedError:
            continue
    raise MaskedError(
        f"no effect can be seen on {truth.plant.name} with {truth.noise_um} µm of noise; give less noise"
    )


class View:
    """Visibility of effects in the experiments on a plant.

    Its records have commands and times; their displacement is a placeholder.
    """

    def __init__(self, truth: Truth) -> None:
        self._truth = truth
        experiments = truth.experiments()
        self.records = [
            Record(e.name, t, u := e.command_V(), u, ts_s=e.ts_s)
            for e, t in zip(experiments, clock(experiments), strict=True)
        ]
        self._simulated: dict[tuple[Effect, ...], list[Array]] = {}

    def shows(self, effects: Sequence[Effect]) -> bool:
        """Whether each effect is visible when the others are known."""
        return all(self._shows(e, [o for o in effects if o is not e]) for e in effects)

    def _shows(self, effect: Effect, others: Sequence[Effect]) -> bool:
        known = [*in_chain_order([*self._truth.plant.effects, *others])]
        full, less = self.displacements([*known, effect]), self.displacements(known)
        differences = [a - b for a, b in zip(full, less, strict=True)]
        # without noise every difference can be seen; a billionth of the stroke is none
        least = max(VISIBLE * self._truth.noise_um, 1e-9 * self._truth.stroke_um)
        if max(float(np.std(d)) for d in differences) < least:
            return False  # too small even before a refit
        found = refit_residuals(
            self._truth.plant, known, self._truth.span_V, self.records, differences
        )
        return max(found.values()) >= least

    def displacements(self, effects: Sequence[Effect]) -> list[Array]:
        """Displacement of each record (µm) with these effects, without noise."""
        key = in_chain_order(effects)
        if key not in self._simulated:
            self._simulated[key] = [
                plant_displacement(self._truth.plant, list(key), r.t_s, r.u_V, _COARSE_S)
                for r in self.records
            ]
        return self._simulated[key]
