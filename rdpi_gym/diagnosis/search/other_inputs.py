"""Whether another input that was recorded, or the temperature, explains what is left."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.diagnosis.notices import statement
from rdpi_gym.diagnosis.words import template
from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.residuals import model_output
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.words import joined

TEMPERATURE = "temperature"
# Samples that are learned from, fewer where there are many inputs; numbers of one design matrix.
_MOST_ROWS, _MOST_NUMBERS = 24_000, 8_000_000
_MOST_INPUTS = 6
# Of an impulse response, the first lags stand for themselves, later ones share a weight; the last
# is this part of the longest record.
_SINGLE_LAGS, _SHARED_LAGS, _REACH = 64, 32, 0.25
_TIME_CONSTANTS = 8
_RIDGES = (1e-8, 1e-6, 1e-4, 1e-2, 1.0, 1e2, 1e6)  # the last predicts nothing
_FOLDS, _BLOCKS, _DRAWS = 4, 48, 400
# Share from whose lower end on an input is said to explain something.
EXPLAINS = 0.05


@dataclass(frozen=True)
class OtherInput:
    """Share of the residual that an input explains which the model does not have."""

    names: tuple[str, ...]  # the input, or several together; ``temperature`` for that channel
    # Share of the mean square of the excess over the noise that it explains on held-out records
    # beyond what a linear filter of the model's own input does, with the 95 % interval (0 to 1)
    share: float
    low: float
    high: float
    # What the model leaves, and what would be left (µm rms)
    before_um: float
    after_um: float
    sentence: str  # in words

    @property
    def explains(self) -> bool:
        """Whether it explains anything."""
        return self.low >= EXPLAINS


def other_inputs(
    variant: Variant[Core], train: Sequence[Record], validation: Sequence[Record], noise_um: float
) -> tuple[OtherInput, ...]:
    """Test whether another recorded input explains what a model leaves.

    Notes
    -----
    A ridge regression of the residual on the impulse responses of the inputs, of the temperature on
    low-passes; learned from the records to fit, its strength by cross-validation among them, and
    judged on the others. The model's own input is among the regressors of every trial, so that an
    input that only resembles it explains nothing. The interval is that of a bootstrap of stretches.
    """
    names = _names([*train, *validation])
    if not names:
        return ()
    reach = max(int(_REACH * len(r.t_s)) for r in train)
    longest_s = max(float(r.t_s[-1] - r.t_s[0]) for r in train)
    edges = _edges(reach)
    columns = (len(names) + 1) * (len(edges) - 1)
    most = min(_MOST_ROWS, _MOST_NUMBERS // columns)

    def features(record: Record, rows: NDArray[np.int64]) -> dict[str, Array]:
        found = {"": _responses(record.u_V, rows, edges)}
        for name in names:
            values = _channel(record, name)
            found[name] = (
                _low_passes(values, rows, record.ts_s, longest_s)
                if name == TEMPERATURE
                else _responses(values, rows, edges)
            )
        return found

    learned = _Parts(variant, train, most, features)
    judged = _Parts(variant, validation, most, features)
    square = float(np.mean(np.concatenate(judged.residuals_um) ** 2))
    if square <= noise_um**2:
        return ()
    without = _squares(learned, judged, ("",))
    trials = [(name,) for name in names] + ([names] if len(names) > 1 else [])
    found = []
    for trial in trials:
        gained = without - _squares(learned, judged, ("", *trial))
        found.append(_judged(trial, gained, judged.squares, judged.counts, noise_um))
    return tuple(sorted(found, key=lambda each: -each.share))


def said_of(found: Sequence[OtherInput]) -> str:
    """Say of all inputs that were tested what matters: what explains most, and each alone."""
    if not found:
        return ""
    if not found[0].explains or len(found[0].names) == 1:
        return found[0].sentence
    single = [each for each in found if len(each.names) == 1]
    shares = ", ".join(
        template("input share", name=x.names[0], share=100 * x.share) for x in single
    )
    return template("inputs alone", together=found[0].sentence, shares=shares)


def _names(records: Sequence[Record]) -> tuple[str, ...]:
    """Channels that every record has and that move in one of them, those that move most first."""
    shared = [n for n in records[0].others if all(n in r.others for r in records)]
    if all(r.temperature_C is not None for r in records):
        shared.append(TEMPERATURE)
    moving = [n for n in shared if any(np.ptp(_channel(r, n)) > 0.0 for r in records)]
    return tuple(moving[:_MOST_INPUTS])


def _channel(record: Record, name: str) -> Array:
    found = record.others.get(name, record.temperature_C)
    assert found is not None
    return found


def _edges(reach: int) -> NDArray[np.int64]:
    """Lags (samples) between which a response is constant: 0, 1, 2, ..., then ever further apart."""
    single = np.arange(min(_SINGLE_LAGS, reach) + 1, dtype=np.int64)
    if reach <= single[-1]:
        return single
    shared = np.geomspace(single[-1], reach, _SHARED_LAGS + 1).astype(np.int64)
    return np.unique(np.concatenate([single, shared]))


def _responses(values: Array, rows: NDArray[np.int64], edges: NDArray[np.int64]) -> Array:
    """Mean of a channel between lags, ``(rows, lags)``; before its start it is as at the start."""
    held = np.full(int(edges[-1]), values[0])
    total = np.concatenate([[0.0], np.cumsum(np.concatenate([held, values]) - values[0])])
    upper = rows[:, None] + int(edges[-1]) + 1 - edges[None, :]
    means: Array = -np.diff(total[upper], axis=1) / np.diff(edges)
    return means


def _low_passes(values: Array, rows: NDArray[np.int64], ts_s: float, longest_s: float) -> Array:
    """A slow channel as it is, and behind low-passes of first order from ten samples on."""
    from scipy.signal import lfilter

    found = [values[rows]]
    for tau_s in np.geomspace(10.0 * ts_s, max(3.0 * longest_s, 20.0 * ts_s), _TIME_CONSTANTS):
        keep = math.exp(-ts_s / tau_s)
        state = np.array([keep * values[0]])
        found.append(lfilter([1.0 - keep], [1.0, -keep], values, zi=state)[0][rows])
    return np.column_stack(found)


class _Parts:
    """Stretches of records: what the model leaves of them, and the regressors, each less its mean."""

    def __init__(
        self,
        variant: Variant[Core],
        records: Sequence[Record],
        most: int,
        features: Callable[[Record, NDArray[np.int64]], Mapping[str, Array]],
    ) -> None:
        counted = sum(int(np.count_nonzero(r.error_mask)) for r in records)
        step = max(1, -(-counted // most))
        blocks = max(_FOLDS, -(-_BLOCKS // len(records)))
        self.residuals_um: list[Array] = []
        self.regressors: list[Mapping[str, Array]] = []
        for record in records:
            rows = np.flatnonzero(record.error_mask)[::step]
            left = (record.y_um - model_output(variant, record))[rows]
            groups = {n: x - x.mean(axis=0) for n, x in features(record, rows).items()}
            for part in np.array_split(np.arange(len(rows)), blocks):
                if len(part):
                    self.residuals_um.append(left[part] - left.mean())
                    self.regressors.append({n: x[part] for n, x in groups.items()})

    @property
    def squares(self) -> Array:
        """Sum of squares of what is left, one a stretch (µm²)."""
        return np.array([float(x @ x) for x in self.residuals_um])

    @property
    def counts(self) -> Array:
        """Samples, one a stretch."""
        return np.array([float(len(x)) for x in self.residuals_um])

    def matrix(self, part: int, names: Sequence[str]) -> Array:
        """Regressors of a stretch."""
        return np.column_stack([self.regressors[part][name] for name in names])


def _squares(learned: _Parts, judged: _Parts, names: Sequence[str]) -> Array:
    """Squares that a regression leaves of each stretch that it is judged on (µm²)."""
    weights = _weights(learned, names)
    left = []
    for part, residual in enumerate(judged.residuals_um):
        error = residual - judged.matrix(part, names) @ weights
        left.append(float(error @ error))
    return np.array(left)


def _weights(learned: _Parts, names: Sequence[str]) -> Array:
    """Weights of a ridge regression whose strength is best on the folds left out."""
    from scipy.linalg import cho_factor, cho_solve

    sums = []
    for fold in range(_FOLDS):
        parts = range(fold, len(learned.residuals_um), _FOLDS)
        x = np.concatenate([learned.matrix(k, names) for k in parts])
        y = np.concatenate([learned.residuals_um[k] for k in parts])
        sums.append((x.T @ x, x.T @ y))
    gram, rhs = sum(g for g, _ in sums), sum(r for _, r in sums)
    size = np.sqrt(np.diag(gram))
    size[size == 0.0] = 1.0

    def solve(g: Array, r: Array, ridge: float) -> Array:
        scaled = g / np.outer(size, size) + ridge * np.eye(len(size))
        weights: Array = cho_solve(cho_factor(scaled), r / size) / size
        return weights

    losses = []
    for ridge in _RIDGES:
        loss = 0.0
        for g, r in sums:
            w = solve(gram - g, rhs - r, ridge)
            loss += float(w @ g @ w - 2.0 * w @ r)
        losses.append(loss)
    return solve(gram, rhs, _RIDGES[int(np.argmin(losses))])


def _judged(
    names: tuple[str, ...], gained: Array, squares: Array, counts: Array, noise_um: float
) -> OtherInput:
    excess = squares - counts * noise_um**2
    share = float(gained.sum() / excess.sum())
    draw = np.random.default_rng(0).integers(0, len(gained), (_DRAWS, len(gained)))
    below = np.maximum(excess[draw].sum(axis=1), 1e-3 * excess.sum())
    low, high = np.quantile(gained[draw].sum(axis=1) / below, [0.025, 0.975])
    low, high = (float(np.clip(end, 0.0, 1.0)) for end in (low, high))
    share = min(max(share, 0.0), 1.0)
    samples = counts.sum()
    before = math.sqrt(squares.sum() / samples)
    after = math.sqrt((squares.sum() - share * excess.sum()) / samples)
    sentence = _sentence(names, share, low, high, before, after)
    return OtherInput(names, share, low, high, before, after, sentence)


def _sentence(
    names: tuple[str, ...], share: float, low: float, high: float, before: float, after: float
) -> str:
    inputs = [name for name in names if name != TEMPERATURE]
    kinds = ["one" if len(inputs) == 1 else "several"] if inputs else []
    kinds += [TEMPERATURE] if TEMPERATURE in names else []
    what = statement(f"inputs/{'+'.join(kinds)}", inputs=joined(inputs))
    kind = "together" if len(names) > 1 else "alone" if inputs else TEMPERATURE
    if low < EXPLAINS:
        kind = f"{'together' if len(names) > 1 else 'alone'} little"
    return template(
        f"explains/{kind}", what=what, share=100 * share, low=100 * low, high=100 * high,
        before=before, after=after,
    )  # fmt: skip
