"""Generic learners with memory of a residual, each tried on blocks of data that it has not seen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement, pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.diagnosis.features.cycles import runs
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.play import play_columns
from rdpi_gym.plant.effects.base import DataScale
from rdpi_gym.support.arrays import Array

_PLAYS = 12
_SPREAD = 1.5  # finer at small thresholds, as the comb of the diagnosis
# Widths of the memory that fades along the path, as shares of the span.
_WIDTHS = np.geomspace(0.02, 0.8, 6)
# Relays with ramps: functions of some plays that switch about these commands, in shares of the span.
_SWITCHED, _MIDDLES, _RAMP = slice(0, _PLAYS, 3), np.linspace(-0.75, 0.75, 7), 0.15
# Time constants from two of the shortest samples to half of the longest record, six decades at most.
_TIME_CONSTANTS, _FEW_CONSTANTS, _DECADES = 13, 7, 6
# Oscillators over two decades below half of the highest Nyquist frequency, and their dampings.
_OSCILLATORS, _DAMPINGS = 24, (0.02, 0.1)
_SPRUNG, _SPRUNG_DAMPING = 12, 0.1  # of those that a power of the displacement drives
_FASTEST_RATE = 2.0
# A layer of random units, always the same, that stands for what no other group multiplies.
_UNITS, _SEED = 300, 20

FAMILIES: tuple[tuple[str, ...], ...] = (
    ("path", "powers"),
    ("output", "time"),
    ("path", "powers", "products", "output"),
    ("path", "powers", "output", "time"),
    ("output", "time", "heat", "slow"),
    ("output", "time", "sprung"),
    ("path", "powers", "relays", "output", "time", "rate"),
    ("path", "output", "time", "units"),
    (
        "path", "powers", "relays", "products", "mixed", "output", "time", "rate", "heat",
        "slow", "sprung",
    ),
)  # fmt: skip
"""Sets of features that a learner may have, from few to all."""


def memory_features(
    record: Record, output_um: Array, scale: DataScale, rows: NDArray[np.intp]
) -> dict[str, Array]:
    """Return features of the input's past, at some of a record's samples.

    The stage is taken to be at rest, with no memory, where the record begins.

    Notes
    -----
    Sums over functions of play operators and of fading memory are the two classical ways to
    approximate a rate-independent operator: Preisach's class has the wiping-out property and
    forgets at larger excursions, Duhem's forgets with the path travelled (Visintin, "Differential
    Models of Hysteresis", Springer 1994).
    """
    u = (record.u_V - scale.centre_V) / scale.span_V
    y = output_um / max(scale.stroke_um, 1e-9) - scale.centre_V / scale.span_V
    ts = record.ts_s
    all_plays = _plays(u)
    plays = all_plays[rows]
    fading = _fading(u)[rows]
    all_rates = _rate(u, ts, scale)
    rate = all_rates[rows]
    lags = _low_passes(u, ts, scale, rows, _TIME_CONSTANTS)
    lags_of_y = _low_passes(y, ts, scale, rows, _TIME_CONSTANTS)
    ringing = [c for d in _DAMPINGS for c in _oscillations(y, ts, scale, rows, _OSCILLATORS, d)]
    slow, sprung = [], []
    for x in (u**2, *all_plays.T[_SWITCHED], *np.abs(all_plays.T[_SWITCHED])):
        slow += _low_passes(x, ts, scale, rows, _FEW_CONSTANTS)
    for x in (y**2, y**3):
        sprung += _oscillations(x, ts, scale, rows, _SPRUNG, _SPRUNG_DAMPING)
        sprung += _low_passes(x, ts, scale, rows, _FEW_CONSTANTS)
    x, z = u[rows, None], y[rows, None]
    path = np.column_stack([x, plays, fading])
    stops = x - plays
    sizes = np.column_stack([np.abs(rate), np.sqrt(np.abs(rate))])
    moved = np.column_stack([x, plays])
    remembered = np.column_stack([plays, fading])
    switched = np.tanh((plays[:, _SWITCHED, None] - _MIDDLES) / _RAMP)
    return {
        "path": path,
        "powers": np.column_stack(
            [x**2, x**3, x**4, x**5, plays**2, plays**3, stops**2, stops**3, np.abs(stops)]
        ),
        "relays": switched.reshape(len(rows), -1),
        "products": np.column_stack([_products(fading, 2), _products(fading, 3)]),
        "mixed": np.column_stack([x * remembered, x**2 * remembered]),
        "output": np.column_stack([z, z**2, z**3, z * x, z**2 * x, z * x**2]),
        "time": np.column_stack([*lags, *lags_of_y, *ringing, rate]),
        "heat": np.column_stack(_low_passes(all_rates**2, ts, scale, rows, _TIME_CONSTANTS)),
        "slow": np.column_stack(slow),
        "sprung": np.column_stack(sprung),
        "rate": np.column_stack(
            [
                rate * np.abs(rate),
                sizes,
                sizes[:, :1] * moved,
                sizes[:, 1:] * moved,
                rate[:, None] * moved,
            ]
        ),
        "units": _units(np.column_stack([path, rate, *lags[::2]])),
    }


def _units(columns: Array) -> Array:
    """A layer of random sigmoid units: a small neural network of which only the last layer learns."""
    rng = np.random.default_rng(_SEED)
    size = columns.shape[1]
    # few inputs to each, so that some look at little else than two of them
    weights = rng.standard_normal((size, _UNITS)) * (rng.random((size, _UNITS)) < 4.0 / size)
    return np.asarray(np.tanh(2.0 * columns @ weights + rng.uniform(-1.0, 1.0, _UNITS)))


def _plays(u: Array) -> Array:
    thresholds = (np.arange(1, _PLAYS + 1) / (_PLAYS + 1.0)) ** _SPREAD
    columns = np.empty((_PLAYS, len(u)))
    play_columns(u, np.zeros_like(u), thresholds, 0.0, np.full(_PLAYS, u[0]), columns)
    return columns.T


def _fading(u: Array) -> Array:
    columns = np.zeros((len(_WIDTHS), len(u)))
    _directions(u, _WIDTHS, columns)
    return columns.T


@njit(cache=True)
def _directions(u: Array, widths: Array, columns: Array) -> None:
    """Direction of travel, low-passed over the path travelled instead of over time."""
    for i in range(widths.shape[0]):
        z = 0.0
        for k in range(1, u.shape[0]):
            step = u[k] - u[k - 1]
            direction = 1.0 if step > 0.0 else -1.0
            z = direction + (z - direction) * math.exp(-abs(step) / widths[i])
            columns[i, k] = z


def _rate(u: Array, ts_s: float, scale: DataScale) -> Array:
    steps = np.diff(u, prepend=u[:1])
    fastest = max(scale.fastest_V_s / scale.span_V * ts_s, 1e-12)
    return np.clip(steps / fastest, -_FASTEST_RATE, _FASTEST_RATE)


def _low_passes(
    x: Array, ts_s: float, scale: DataScale, rows: NDArray[np.intp], count: int
) -> list[Array]:
    """Differences between a trace and its low-passes: of the size of a lag, not of the stroke."""
    longest_s = 0.5 * scale.longest_s
    shortest_s = max(2.0 * scale.shortest_s, longest_s * 10.0**-_DECADES)
    constants = np.geomspace(shortest_s, longest_s, count)
    return [(x - _filtered(x, -ts_s / constant).real)[rows] for constant in constants]


def _oscillations(
    x: Array, ts_s: float, scale: DataScale, rows: NDArray[np.intp], count: int, damping: float
) -> list[Array]:
    highest_hz = 0.25 / scale.shortest_s
    columns = []
    for frequency_hz in np.geomspace(0.01 * highest_hz, highest_hz, count):
        root = 2.0 * np.pi * frequency_hz * complex(-damping, math.sqrt(1.0 - damping**2))
        ringing = _filtered(x, root * ts_s)[rows]
        columns += [ringing.real, ringing.imag]
    return columns


def _filtered(x: Array, step: complex) -> NDArray[np.complex128]:
    """First-order low-pass of gain 1 with a real or complex root, settled where x begins."""
    from scipy.signal import lfilter

    pole = np.exp(complex(step))
    filtered, _ = lfilter([1.0 - pole], [1.0, -pole], x, zi=[pole * x[0]])
    return np.asarray(filtered, dtype=np.complex128)


def _products(columns: Array, factors: int) -> Array:
    return np.column_stack(
        [
            np.prod(columns[:, list(chosen)], axis=1)
            for chosen in combinations_with_replacement(range(columns.shape[1]), factors)
        ]
    )


_RIDGES = (1e-7, 1e-5, 1e-3, 3e-2)
# A record is held out whole where there are three of its role or more, else in as many pieces.
_PIECES = (4, 2)
_GAP = 0.15  # of what is held out: so much on either side of it is not learned from either
_FOLDS = 8  # at most
_BLOCKS = 24  # of all that is held out
_RARE = 1e-3  # share of residuals that are larger than a learner may predict


@dataclass(frozen=True)
class Part:
    """One record, some of its samples."""

    # float64[N, K] by group: of the input's past, what follows the clock taken off
    features: Mapping[str, Array]
    residual_um: Array  # float64[N]: what is to be predicted, likewise
    # bool[N]: samples on which a learner is tried; all are learned from where they are not held out
    asked: NDArray[np.bool_]

    @cached_property
    def matrix(self) -> Array:
        """All features, side by side."""
        return np.column_stack(list(self.features.values()))


@dataclass(frozen=True)
class HeldOut:
    """Squared residuals of blocks of samples that were held out, B of them."""

    # float64[B]: sums of squares (µm²), without and with what the learner predicts
    before: Array
    after: Array
    blocks: tuple[tuple[int, slice], ...]  # where each stands: the part, and its samples there


def learn_across(parts: Sequence[Part]) -> HeldOut:
    """Predict the samples asked for, record after record, from all other data.

    Notes
    -----
    What is held out at a time is long, a record or a large piece of one with gaps beside it: across
    a short stretch a slow disturbance is known from either side, and features that are slow
    themselves would carry it over. The errors are summed over shorter blocks, which have a spread.

    Ridge regressions, on several sets of features and with several strengths, and one learner that
    predicts nothing. The one that predicts a fold is chosen by its errors in the other folds, so
    that no fold speaks for its own learner; the records that are not asked for choose too. Some of the features are a layer of random units: a
    small neural network whose last layer alone is fitted (Rahimi, Recht, "Weighted sums of random
    kitchen sinks", NIPS 2008). A learner predicts nothing larger than it has seen.
    """
    matrix = np.concatenate([part.matrix for part in parts])
    target = np.concatenate([part.residual_um for part in parts])
    size = np.sqrt(np.mean(matrix**2, axis=0))
    matrix /= np.where(size > 0.0, size, 1.0)
    labels = np.concatenate([[n] * x.shape[1] for n, x in parts[0].features.items()])
    sets = [np.flatnonzero(np.isin(labels, family)) for family in FAMILIES]
    starts = np.cumsum([0, *(len(part.residual_um) for part in parts)])
    folds = _folds(parts)
    longest = sum(int(np.count_nonzero(part.asked)) for part in parts) / _BLOCKS
    gram, rhs = matrix.T @ matrix, matrix.T @ target
    largest = float(np.quantile(np.abs(target), 1.0 - _RARE))
    blocks: list[tuple[int, slice]] = []
    owners, after = [], []
    for fold, held in enumerate(folds):
        out = np.concatenate([_with_gaps(rows, starts[k], starts[k + 1]) for k, rows in held])
        lost = matrix[out]
        weights = _ridges(
            gram - lost.T @ lost, rhs - lost.T @ target[out], sets, len(target) - len(out)
        )
        for k, rows in ((k, rows) for k, piece in held for rows in _cut(piece, longest)):
            span = slice(starts[k] + rows.start, starts[k] + rows.stop)
            predicted = np.clip(matrix[span] @ weights, -largest, largest)
            blocks.append((k, rows))
            owners.append(fold)
            after.append(np.sum((target[span, None] - predicted) ** 2, axis=0))
    left, owner = np.array(after), np.array(owners)
    chosen = [int(np.argmin(left[owner != fold].sum(axis=0))) for fold in range(len(folds))]
    asked = [b for b, (k, rows) in enumerate(blocks) if parts[k].asked[rows.start]]
    return HeldOut(
        left[asked, -1],  # of the one that predicts nothing
        left[asked, np.array(chosen)[owner[asked]]],
        tuple(blocks[b] for b in asked),
    )


def _folds(parts: Sequence[Part]) -> list[list[tuple[int, slice]]]:
    """Folds of records, or of pieces of them, those that are asked for spread out."""
    pieces: list[tuple[int, slice]] = []
    for asked in (True, False):
        found: list[tuple[int, slice]] = []
        for k, part in enumerate(parts):
            own = part.asked if asked else ~part.asked
            found += [(k, slice(a, b)) for a, b in runs(own)]
        number = dict(enumerate(_PIECES, start=1)).get(len(found), 1)
        pieces += [(k, x) for k, run in found for x in _cut(run, (run.stop - run.start) / number)]
    return [pieces[fold::_FOLDS] for fold in range(min(_FOLDS, len(pieces)))]


def _with_gaps(rows: slice, start: int, end: int) -> NDArray[np.intp]:
    """Rows of a stretch and of the gaps beside it, in a record from `start` to `end`."""
    gap = round(_GAP * (rows.stop - rows.start))
    return np.arange(max(start + rows.start - gap, start), min(start + rows.stop + gap, end))


def _cut(rows: slice, longest: float) -> list[slice]:
    """Cut a stretch into equal pieces of about a length."""
    pieces = max(1, round((rows.stop - rows.start) / max(longest, 1.0)))
    cuts = np.linspace(rows.start, rows.stop, pieces + 1).round().astype(int)
    return [slice(int(a), int(b)) for a, b in pairwise(cuts)]


def _ridges(gram: Array, rhs: Array, sets: Sequence[NDArray[np.intp]], rows: int) -> Array:
    """Weights of all learners, a column each, the last without any."""
    from scipy.linalg import cho_factor, cho_solve

    weights = np.zeros((len(rhs), len(sets) * len(_RIDGES) + 1))
    for i, own in enumerate(sets):
        part = gram[np.ix_(own, own)]
        for j, ridge in enumerate(_RIDGES):
            try:
                factor = cho_factor(part + ridge * rows * np.eye(len(own)), check_finite=False)
            except np.linalg.LinAlgError:
                continue  # features that rounding makes alike: a stronger ridge will do
            weights[own, i * len(_RIDGES) + j] = cho_solve(factor, rhs[own], check_finite=False)
    return weights
