"""Whether what is left follows from the input, or something else moved the stage."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rdpi_gym.arrays import Array
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.measurement import Record
from rdpi_gym.plant.effects.base import DataScale
from rdpi_gym.plant.play import play_columns

# Low-passes of the command over four decades of time constants, in units of the shortest sampling.
_DECADES = 4
_PLAYS = 6
# Strengths of the ridge that are tried: the learner that predicts best speaks.
_RIDGES = (1e-6, 1e-4, 1e-2, 1.0)
# Of the excess over the noise, the share that a learner must predict to call it a function of u.
FOLLOWS = 0.3


@dataclass(frozen=True)
class Remainder:
    """Whether the remainder follows from the input.

    Parameters
    ----------
    predicted_share
        Share of its excess over the noise that a learner with memory predicts on held-out records.
    sentence
        In words.
    """

    predicted_share: float
    sentence: str


def remainder(
    variant: Variant,
    train: Sequence[Record],
    validation: Sequence[Record],
    scale: DataScale,
    noise_um: float,
) -> Remainder:
    """Fit a generic learner with memory to the residual and try it on held-out records.

    Parameters
    ----------
    variant
        The final model.
    train, validation
        Records.
    scale
        Size of the data.
    noise_um
        Noise floor (µm rms).

    Notes
    -----
    Ridge regression on the command, its low-passes over four decades, play states at the rate of
    the command, its rate, and all products of these.
    """
    rows = [_rows(variant, record, scale) for record in train]
    gram = np.sum([features.T @ features for features, _ in rows], axis=0)
    rhs = np.sum([features.T @ residual for features, residual in rows], axis=0)
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scaled, target = gram / np.outer(size, size), rhs / size
    learned = [np.linalg.solve(scaled + r * np.eye(len(size)), target) / size for r in _RIDGES]
    weights = np.column_stack(learned)
    before, after, samples = 0.0, np.zeros(len(_RIDGES)), 0
    for record in validation:
        features, residual = _rows(variant, record, scale)
        left = residual[:, None] - features @ weights
        before += float(residual @ residual)
        after += np.sum((left - left.mean(axis=0)) ** 2, axis=0)
        samples += len(residual)
    excess = before / samples - noise_um**2
    share = float(before - after.min()) / samples / excess if excess > 0 else 0.0
    left_um = math.sqrt(max(excess, 0.0))
    if excess <= 0.33 * noise_um**2:
        sentence = "What is left is the noise."
    elif share >= FOLLOWS:
        sentence = (
            f"What is left ({left_um:.3g} µm rms over the noise) follows from the input: a learner "
            f"with memory predicts {100 * share:.0f} % of it on held-out records. An effect outside "
            "the catalogue, or an imperfect form of one in it, is missing."
        )
    else:
        sentence = (
            f"What is left ({left_um:.3g} µm rms over the noise) does not follow from the recorded "
            f"input, as far as a learner with memory can tell: it predicts {100 * max(share, 0.0):.0f} % "
            "of it on held-out records. A disturbance that nobody recorded or another input moves "
            "the stage, or its hysteresis is of another kind."
        )
    return Remainder(share, sentence)


def _rows(variant: Variant, record: Record, scale: DataScale) -> tuple[Array, Array]:
    residual = record.y_um - simulate_effects([variant], record)[:, 0]
    features = _features(record, scale)[record.error_mask]
    residual = residual[record.error_mask]
    return features - features.mean(axis=0), residual - residual.mean()


def _features(record: Record, scale: DataScale) -> Array:
    u = (record.u_V - scale.centre_V) / scale.span_V
    rate = np.diff(u, prepend=u[:1]) / record.ts_s * scale.span_V / scale.fastest_V_s
    linear = [u, np.clip(rate, -2.0, 2.0)]
    for decade in range(_DECADES):
        linear.append(_low_pass(u, record.ts_s / (5.0 * scale.shortest_s * 10.0**decade)))
    rest = np.arange(1, _PLAYS + 1) / (_PLAYS + 1.0)
    columns = np.empty((_PLAYS, len(u)))
    play_columns(u, np.zeros_like(u), rest, 0.0, np.zeros(_PLAYS), columns)
    linear += list(columns)
    products = [a * b for i, a in enumerate(linear) for b in linear[i:]]
    return np.column_stack([*linear, *products])


def _low_pass(u: Array, step: float) -> Array:
    from scipy.signal import lfilter

    pole = math.exp(-step)
    filtered, _ = lfilter([1.0 - pole], [1.0, -pole], u, zi=[pole * u[0]])
    return np.asarray(filtered, dtype=np.float64)
