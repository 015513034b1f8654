"""The comb of thresholds that a search begins with, and what it is cut down to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rdpi_gym.diagnosis.features.half_cycles import half_cycles, vary
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Record
from rdpi_gym.plant import RDPI
from rdpi_gym.support.arrays import Array

# Thresholds of the comb: enough that a play between two of them is not missed.
COMB = 60
_SPREAD = 1.5  # finer at small thresholds, where the small loops are


def one_size(records: Sequence[Record]) -> bool:
    """Whether loops of one size are all that records hold: they do not tell weights apart.

    Parameters
    ----------
    records
        Records of one plant.

    Examples
    --------
    >>> t = np.arange(4000) * 1e-3
    >>> wave = np.sin(2 * np.pi * t)
    >>> one = Record("one", t, wave, wave, ts_s=1e-3)
    >>> one_size([one]), one_size([one, Record("small", t, 0.5 * wave, wave, ts_s=1e-3)])
    (True, False)
    """
    cycles = [half_cycles(r.u_V, r.ts_s) for r in records]
    sizes = np.concatenate([c.amplitude_V[c.whole] for c in cycles])
    return bool(sizes.size) and not vary(sizes)


def comb(records: Sequence[Record], thresholds: int = COMB) -> RDPI:
    """Return a model with a fine fixed comb of thresholds, to be fitted: convex in its weights.

    Parameters
    ----------
    records
        Records of one plant; the comb reaches half of the widest swing.
    thresholds
        How many.
    """
    scale = data_scale(records)
    gain = max(scale.stroke_um / scale.span_V, 1e-9)
    # A play wider than half the swing only shifts the offset after the first excursion.
    rest: Array = scale.span_V * (np.arange(1, thresholds + 1) / thresholds) ** _SPREAD
    weights = (0.5 * gain, *[0.5 * gain / thresholds] * thresholds)
    return RDPI(weights, tuple(rest.tolist()), 0.05 * scale.span_V / scale.fastest_V_s)


def pruned(model: RDPI) -> RDPI:
    """Return the model with only the plays that have a weight, and their neighbours.

    The candidates of a round are compared on it: half the plays, half the time.

    Examples
    --------
    >>> pruned(RDPI((1.0, 0.0, 0.0, 0.0, 0.5), (1.0, 2.0, 3.0, 4.0), 0.0)).thresholds_V
    (3.0, 4.0)
    """
    active = np.array(model.weights[1:]) > 0
    near = active.copy()
    near[1:] |= active[:-1]
    near[:-1] |= active[1:]
    kept = np.flatnonzero(near) if near.any() else np.arange(1)
    weights = (model.a0, *(model.weights[1 + i] for i in kept))
    rest = tuple(model.thresholds_V[i] for i in kept)
    return RDPI(weights, rest, model.delta2_s, model.rate_bandwidth_hz)


def on_comb(model: RDPI, whole: RDPI) -> RDPI:
    """Return the model on the whole comb again, with weights where it has them.

    Examples
    --------
    >>> part = RDPI((1.0, 0.5), (2.0,), 1e-4)
    >>> on_comb(part, RDPI((1.0, 0.1, 0.1), (1.0, 2.0), 0.0)).weights
    (1.0, 0.0, 0.5)
    """
    own = dict(zip(model.thresholds_V, model.weights[1:], strict=True))
    weights = (model.a0, *(own.get(r, 0.0) for r in whole.thresholds_V))
    return RDPI(weights, whole.thresholds_V, model.delta2_s, model.rate_bandwidth_hz)
