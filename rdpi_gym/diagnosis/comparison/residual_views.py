"""Residual of a record averaged over command, rate and time at rest: the numbers of figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.diagnosis.comparison import breakdown
from rdpi_gym.diagnosis.comparison.traces import Trace, smooth_rate
from rdpi_gym.diagnosis.features.cycles import half_cycles
from rdpi_gym.diagnosis.features.rests import find_rests
from rdpi_gym.diagnosis.results import View
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array

RATE_STEPS = 25
HOLD_STEPS = 24
_FEWEST = 8  # samples of a mean that is worth drawing
_HELD_SHARE = 0.1  # of the samples that count; with fewer at rest there is no view over the hold
_FIRST = 4  # samples of a rest whose mean is what it begins with: less noisy than one
_SHORTEST_SEGMENT, _LONGEST_SEGMENT = 256, 2048


@dataclass(frozen=True, eq=False)
class Profile:
    """Mean residual along one quantity."""

    x: Array  # the quantity, ``(K,)``: V, V/s or s
    mean_um: Array  # mean of measured minus model (µm), ``(K,)``
    samples: NDArray[np.intp]  # ``intp[K]``


@dataclass(frozen=True, eq=False)
class ResidualProfiles:
    """Residual profiles of one model on one record."""

    # Along the command (V)
    rising: Profile
    falling: Profile
    rate: Profile  # along its rate (V/s)
    # Along the time since the command came to rest (s), counted positive in the direction of the
    # move before, each rest from the value it begins with; None where the command hardly rests
    hold: Profile | None
    # Frequency (Hz) and amplitude density (µm/√Hz) of the residual, ``(F,)``
    frequency_hz: Array
    density_um: Array


def view_trace(view: View, label: str) -> Trace:
    """Return one model of a view as the trace that :func:`rdpi_gym.diagnosis.comparison.compare` makes."""
    ts_s = float(np.median(np.diff(view.t_s)))
    cycles = half_cycles(view.u_V, ts_s)
    return Trace(
        name=view.name,
        role=view.role,
        t_s=view.t_s,
        u_V=view.u_V,
        rate_V_s=smooth_rate(view.u_V, ts_s, cycles),
        measured_um=view.y_um,
        model_um=view.models_um[label],
        counted=np.asarray(view.counted, dtype=np.bool_),
        cycles=cycles,
        offset_um=0.0,  # part of the model's displacement already
        ts_s=ts_s,
    )


def residual_profiles(trace: Trace) -> ResidualProfiles:
    """Average a residual over command, rate and time at rest, and take its spectrum."""
    samples = breakdown.sample_table([trace])
    table = breakdown.by_command(samples)
    directions = {}
    for name in ("rising", "falling"):
        rows = table[table["direction"] == name]
        directions[name] = Profile(
            (0.5 * (rows["low_V"] + rows["high_V"])).to_numpy(),
            rows["mean_um"].to_numpy(),
            rows["samples"].to_numpy(),
        )
    residual, rate = samples["residual_um"].to_numpy(), samples["rate_V_s"].to_numpy()
    reach = float(np.percentile(np.abs(rate), 99.5)) or 1.0
    frequency_hz, density_um = _spectrum(trace)
    return ResidualProfiles(
        rising=directions["rising"],
        falling=directions["falling"],
        rate=_means(rate, residual, np.linspace(-reach, reach, RATE_STEPS + 1)),
        hold=_hold(trace),
        frequency_hz=frequency_hz,
        density_um=density_um,
    )


def _means(x: Array, residual: Array, edges: Array, middle: Array | None = None) -> Profile:
    inside = (x >= edges[0]) & (x <= edges[-1])
    place = np.clip(np.searchsorted(edges, x[inside], side="right") - 1, 0, edges.size - 2)
    count = np.bincount(place, minlength=edges.size - 1)
    total = np.bincount(place, weights=residual[inside], minlength=edges.size - 1)
    known = count >= _FEWEST
    middles = 0.5 * (edges[1:] + edges[:-1]) if middle is None else middle
    return Profile(middles[known], total[known] / count[known], count[known])


def _hold(trace: Trace) -> Profile | None:
    """Mean over all rests of how the residual goes on in the direction of the move before."""
    record = Record(trace.name, trace.t_s, trace.u_V, trace.residual_um, ts_s=trace.ts_s)
    times, onward = [], []
    for rest in find_rests(record, float(np.ptp(trace.u_V))):
        inside = np.arange(rest.first + 1, rest.last)
        inside = inside[trace.counted[inside]]
        if rest.move_V != 0.0 and inside.size:
            times.append((inside - rest.first) * trace.ts_s)
            begin = np.mean(trace.residual_um[rest.first : rest.first + _FIRST])
            onward.append((trace.residual_um[inside] - begin) * np.sign(rest.move_V))
    if sum(t.size for t in times) < max(_FEWEST, _HELD_SHARE * np.count_nonzero(trace.counted)):
        return None
    time_s = np.concatenate(times)
    edges = np.geomspace(0.999 * trace.ts_s, 1.001 * time_s.max(), HOLD_STEPS + 1)
    return _means(time_s, np.concatenate(onward), edges, np.sqrt(edges[1:] * edges[:-1]))


def _spectrum(trace: Trace) -> tuple[Array, Array]:
    """Welch's density; what does not count is zero, and the density made up for it."""
    from scipy.signal import welch

    share = float(np.mean(trace.counted))
    residual = np.where(trace.counted, trace.residual_um, 0.0)
    # an eighth of the record, so that there are enough segments to average over
    segment = min(max(residual.size // 8, _SHORTEST_SEGMENT), _LONGEST_SEGMENT, residual.size)
    frequency_hz, power = welch(residual, 1.0 / trace.ts_s, nperseg=segment, detrend="constant")
    # without the two ends, which hold half of the power
    return frequency_hz[1:-1], np.sqrt(power[1:-1] / share)
