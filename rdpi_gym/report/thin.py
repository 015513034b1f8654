"""Fewer samples for display: the lowest and the highest of every stretch are kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.diagnosis import Trace
from rdpi_gym.support.arrays import Array

DISPLAY_SAMPLES = 3000
"""Samples of one trace that a page is given: more than any screen has columns."""


def thin_index(*traces: Array, samples: int = DISPLAY_SAMPLES) -> NDArray[np.intp]:
    """Choose the samples of traces that are worth drawing.

    The record is cut into stretches of equal length; of each, the samples where a trace is lowest
    and highest are kept, so that no peak is lost, and the first and the last of all.
    """
    total = traces[0].shape[0]
    if total <= samples:
        return np.arange(total)
    stretches = max(1, samples // (2 * len(traces)))
    edges = np.linspace(0, total, stretches + 1).astype(np.intp)
    length = int(np.max(np.diff(edges)))
    # each stretch is a row; rows that are one sample shorter repeat their last sample
    rows = np.minimum(edges[:-1, None] + np.arange(length), edges[1:, None] - 1)
    chosen = [np.array([0, total - 1], dtype=np.intp)]
    for trace in traces:
        values = np.asarray(trace, dtype=np.float64)[rows]
        low = np.argmin(np.where(np.isnan(values), np.inf, values), axis=1)
        high = np.argmax(np.where(np.isnan(values), -np.inf, values), axis=1)
        row = np.arange(stretches)
        chosen += [rows[row, low], rows[row, high]]
    return np.unique(np.concatenate(chosen))


def around_largest_error(
    trace: Trace, samples: int = DISPLAY_SAMPLES, *others: Array
) -> NDArray[np.intp]:
    """Choose the samples of the half-cycle of the largest error, and of those beside it.

    Thinned so that no peak of the others is lost either.
    """
    error = np.where(trace.counted, np.abs(trace.residual_um), -1.0)
    worst = int(np.argmax(error))
    edges = trace.cycles.edges
    at = int(np.searchsorted(edges, worst, side="right")) - 1
    around = np.arange(edges[max(0, at - 1)], edges[min(edges.size - 1, at + 2)])
    kept = [values[around] for values in (trace.measured_um, trace.residual_um, *others)]
    thinned = thin_index(*kept, samples=samples)
    return around[thinned]
