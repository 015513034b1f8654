"""Records as the fitting kernels read them: concatenated, rates beside the commands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.play import rate_block
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

# A thinned record keeps a sample where command and rate together moved by this part of their
# ranges, or by less where that leaves too few.
_THINNING = 0.2
# Range (V, V/s) that is added to those of a record: one that stands still is divided by it.
_STILL = 1e-300


class Stack(NamedTuple):
    """Samples of several records, concatenated."""

    u_V: Array  # float64[T]: Command (V)
    # float64[T]: Its rate (V/s), Eq. 5, low-passed where the model's rate is band-limited.
    rate_V_s: Array
    y_um: Array  # float64[T]: Displacement (µm), each record less its mean
    # float64[T]: Square root of the number of samples that a sample stands for; 0: simulated, not
    # counted
    root_weight: Array
    edges: NDArray[np.int64]  # int64[R + 1]: Record r is samples edges[r] to edges[r + 1] - 1

    def record(self, r: int) -> slice:
        """Samples of record `r`."""
        return slice(int(self.edges[r]), int(self.edges[r + 1]))


def command_rate(u_V: Array, ts_s: float, rate_bandwidth_hz: float | None) -> Array:
    """Rate of a record's command, Eq. 5, with v(0) = 0."""
    pole = 0.0 if rate_bandwidth_hz is None else math.exp(-2 * math.pi * rate_bandwidth_hz * ts_s)
    rate = np.empty((u_V.size, 1))
    rate_block(u_V[:, None], np.array([[pole], [0.0]]), np.array([[np.nan], [0.0]]), ts_s, rate)
    return rate[:, 0]


def stack_records(
    records: Sequence[Record], rate_bandwidth_hz: float | None
) -> tuple[Stack, Array]:
    """Concatenate records for a fit."""
    means = np.empty(len(records))
    for r, record in enumerate(records):
        if not record.error_mask.any():
            raise InputError(
                f"record {record.name} has no sample that counts; shorten skip_s or mask_s"
            )
        means[r] = record.y_um[record.error_mask].mean()
    stack = Stack(
        u_V=np.concatenate([record.u_V for record in records]),
        rate_V_s=np.concatenate(
            [command_rate(record.u_V, record.ts_s, rate_bandwidth_hz) for record in records]
        ),
        y_um=np.concatenate(
            [record.y_um - mean for record, mean in zip(records, means, strict=True)]
        ),
        root_weight=np.concatenate([record.error_mask.astype(np.float64) for record in records]),
        edges=np.concatenate([[0], np.cumsum([record.u_V.size for record in records])]),
    )
    return stack, means


def thin(stack: Stack, samples: int) -> Stack:
    """Keep the samples that a coarse search needs: turning points, and steps of command or rate.

    A play operator follows its input's turning points, so what is left out moves it little; each
    sample that is kept stands for its neighbours too.
    """
    if stack.u_V.size < 2 * samples:
        return stack
    part, spans = _THINNING, np.full((2, stack.edges.size - 1), _STILL)
    for r in range(stack.edges.size - 1):
        if stack.edges[r] < stack.edges[r + 1]:
            spans[0, r] += np.ptp(stack.u_V[stack.record(r)])
            spans[1, r] += np.ptp(stack.rate_V_s[stack.record(r)])
    while True:
        kept, weight = np.zeros(stack.u_V.size, dtype=np.bool_), np.zeros(stack.u_V.size)
        _thin(*stack, spans, part, kept, weight)
        if np.count_nonzero(kept) >= samples:
            break
        part /= 2
    counts = np.concatenate([[0], np.cumsum(kept)])
    return Stack(
        stack.u_V[kept],
        stack.rate_V_s[kept],
        stack.y_um[kept],
        np.sqrt(weight[kept]),
        counts[stack.edges],
    )


@njit(cache=True)
def _thin(
    u: Array,
    v: Array,
    y: Array,
    root_weight: Array,
    edges: NDArray[np.int64],
    spans: Array,
    part: float,
    kept: NDArray[np.bool_],
    weight: Array,
) -> None:
    for r in range(edges.shape[0] - 1):
        first, end = edges[r], edges[r + 1]
        if first == end:
            continue
        du, dv = spans[0, r], spans[1, r]
        last = first
        kept[first] = True
        for t in range(first + 1, end):
            moved = abs(u[t] - u[last]) / du
            turns = t + 1 < end and (u[t] - u[t - 1]) * (u[t + 1] - u[t]) < 0
            steps = moved + abs(v[t] - v[last]) / dv >= part
            if steps or (turns and moved >= 0.1 * part) or t + 1 == end:
                kept[t] = True
                for s in range(last + 1, t):  # those between count where their command lies
                    place = (u[s] - u[last]) / (u[t] - u[last]) if u[t] != u[last] else 0.0
                    place = min(max(place, 0.0), 1.0)
                    weight[last] += (1.0 - place) * root_weight[s] ** 2
                    weight[t] += place * root_weight[s] ** 2
                last = t
        for t in range(first, end):
            if kept[t]:
                weight[t] = weight[t] + 1.0 if root_weight[t] > 0 else 0.0
