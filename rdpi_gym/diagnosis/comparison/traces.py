"""Records beside what a model makes of them, sample by sample, and tables of the error."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rdpi_gym.diagnosis.features.cycles import HalfCycles, half_cycles
from rdpi_gym.diagnosis.features.recurrence import find_rests
from rdpi_gym.diagnosis.results import View
from rdpi_gym.identification.residuals import simulate_record
from rdpi_gym.measurement import Record
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array


@dataclass(frozen=True, eq=False)
class Trace:
    """A record of N samples and the model's displacement for it.

    Parameters
    ----------
    name, role
        Of the record.
    t_s, u_V, rate_V_s
        Time (s), command (V) and its rate (V/s), each ``(N,)``.
    measured_um, model_um
        Displacement (µm), ``(N,)``; the model's with the record's free offset.
    counted
        ``bool[N]``; False where a sample is left out of the error.
    cycles
        The command cut at its reversals.
    offset_um
        The free offset (µm): mean of measured minus simulated over the samples that count.
    ts_s
        Sampling time (s).
    """

    name: str
    role: str
    t_s: Array
    u_V: Array
    rate_V_s: Array
    measured_um: Array
    model_um: Array
    counted: NDArray[np.bool_]
    cycles: HalfCycles
    offset_um: float
    ts_s: float

    @property
    def residual_um(self) -> Array:
        """Measured minus model (µm), ``(N,)``, also where no sample counts."""
        return self.measured_um - self.model_um


def trace(record: Record, model: PlantModel) -> Trace:
    """Simulate a record from its first sample and free its offset.

    A record of which the fit has found the initial memory begins with it.
    """
    extremum_V = fitted_extremum_V(model, record.name)
    left = (
        simulate_record(model, record)
        if extremum_V is None
        else simulate_record(model, record, extremum_V)
    )
    cycles = half_cycles(record.u_V, record.ts_s)
    return Trace(
        name=record.name,
        role=record.role,
        t_s=record.t_s,
        u_V=record.u_V,
        rate_V_s=smooth_rate(record.u_V, record.ts_s, cycles),
        measured_um=record.y_um,
        model_um=left.simulated_um + left.offset_um,
        counted=record.error_mask,
        cycles=cycles,
        offset_um=left.offset_um,
        ts_s=record.ts_s,
    )


def fitted_extremum_V(model: PlantModel, name: str) -> float | None:
    """Give the command (V) at which the plant had turned before a record, where a fit found it."""
    known = model.identification.get("memory_extrema_V")
    value = known.get(name) if isinstance(known, Mapping) else None
    if not isinstance(value, int | float) or not math.isfinite(value) or value == 0.0:
        return None
    return float(value)


def smooth_rate(u_V: Array, ts_s: float, cycles: HalfCycles) -> Array:
    """Rate of a measured command (V/s), ``(N,)``, that its noise does not drown.

    Central differences over a twentieth of a short half-cycle (the tenth percentile of all),
    which is 0.4 % low at the crest of a sine's rate.
    """
    lengths = np.diff(cycles.edges)
    whole = lengths[cycles.whole] if cycles.whole.any() else lengths
    reach = max(1, round(float(np.percentile(whole, 10)) / 40.0))
    sample = np.arange(u_V.size)
    after = np.minimum(sample + reach, u_V.size - 1)
    before = np.maximum(sample - reach, 0)
    rate: Array = (u_V[after] - u_V[before]) / ((after - before) * ts_s)
    return rate


if TYPE_CHECKING:
    from pandas.api.typing import SeriesGroupBy

AMPLITUDE_STEPS = 8
"""Amplitudes are sorted into so many classes of equal width, the largest in the middle of the last."""
COMMAND_STEPS = 20
PLANE_STEPS = 24
_PASSES = 2.0  # half-cycles through a cell, on average
_RATE_SHARE = 99.5  # per cent of the samples that the plane's rate axis reaches


@dataclass(frozen=True, eq=False)
class Plane:
    """Mean residual over the plane of command and rate.

    Parameters
    ----------
    command_edges_V, rate_edges_V_s
        Edges of the cells (V and V/s), ``(I + 1,)`` and ``(J + 1,)``.
    mean_um
        Mean of measured minus model (µm), ``(I, J)``; NaN where no sample fell.
    samples
        ``intp[I, J]``.
    outside
        Samples whose rate is beyond the edges.
    explained_percent
        Share of the residual's variance that the cell means account for, corrected for the
        number of cells; None where there are too few samples, or passes through a cell, to tell.
    """

    command_edges_V: Array
    rate_edges_V_s: Array
    mean_um: Array
    samples: NDArray[np.intp]
    outside: int
    explained_percent: float | None


def record_table(traces: Sequence[Trace], noise_um: float) -> pd.DataFrame:
    """One row a trace: errors (µm, % of the measured peak to peak), offset, what it is made of.

    `systematic_percent` is the share of the squared error that is more than noise. `scatter_um` is
    the residual's change from sample to sample over √2: at most that much of the error is white
    sensor noise. `gain_ratio` is the slope of measured over model: 1 is right.
    """
    rows = []
    for each in traces:
        error = each.residual_um[each.counted]
        measured, model = each.measured_um[each.counted], each.model_um[each.counted]
        span = float(np.ptp(measured))
        deviation = model - model.mean()
        power = float(deviation @ deviation)
        rmse = _rms(error)
        rows.append(
            {
                "name": each.name,
                "role": each.role,
                "rmse_um": rmse,
                "nrmse_percent": 100.0 * rmse / span if span > 0 else np.nan,
                "systematic_percent": _systematic_percent(rmse, noise_um),
                "max_um": float(np.max(np.abs(error))),
                "offset_um": each.offset_um,
                "samples": error.size,
                "ts_s": each.ts_s,
                "scatter_um": _scatter(each),
                "measured_peak_to_peak_um": span,
                "gain_ratio": float(deviation @ measured) / power if power > 0 else np.nan,
            }
        )
    return pd.DataFrame(rows)


def sample_table(traces: Sequence[Trace]) -> pd.DataFrame:
    """Every sample that counts: residual (µm), command, rate, and its half-cycle's properties."""
    parts, first = [], 0
    for each in traces:
        cycles = each.cycles
        ends = each.measured_um[np.maximum(cycles.edges - 1, 0)]
        part = pd.DataFrame(
            {
                "residual_um": each.residual_um,
                "command_V": each.u_V,
                "rate_V_s": each.rate_V_s,
                "rising": cycles.by_sample(cycles.rising),
                "cycle": first + cycles.by_sample(np.arange(cycles.rising.size)),
                "frequency_hz": cycles.by_sample(cycles.frequency_hz),
                "amplitude_V": cycles.by_sample(cycles.amplitude_V),
                "stroke_um": cycles.by_sample(0.5 * np.abs(np.diff(ends))),
            }
        )
        parts.append(part[each.counted])
        first += cycles.rising.size
    return pd.concat(parts, ignore_index=True)


def by_frequency(samples: pd.DataFrame) -> pd.DataFrame:
    """Error in third-octave bands (centres 10^(k/10) Hz), over samples in whole half-cycles."""
    band = (10.0 * np.log10(samples["frequency_hz"])).round()
    table = _grouped(samples, band)
    low, high = 10.0 ** ((table.index - 0.5) / 10.0), 10.0 ** ((table.index + 0.5) / 10.0)
    table.insert(1, "low_hz", low)
    table.insert(2, "high_hz", high)
    return table.reset_index(drop=True)


def by_amplitude(samples: pd.DataFrame) -> pd.DataFrame:
    """Error by amplitude of the command (V), over samples in whole half-cycles."""
    largest = samples["amplitude_V"].max()
    step = largest / AMPLITUDE_STEPS if largest > 0 else 1.0
    table = _grouped(samples, (samples["amplitude_V"] / step).round())
    table = table[["amplitude_V", "frequency_hz", *table.columns[2:]]]
    table.insert(1, "low_V", np.maximum(0.0, (table.index - 0.5) * step))
    table.insert(2, "high_V", (table.index + 0.5) * step)
    return table.reset_index(drop=True)


def by_direction(samples: pd.DataFrame) -> pd.DataFrame:
    """Error while the command rises and while it falls; the two hold every sample that counts."""
    names = samples["rising"].map({True: "rising", False: "falling"}).rename("direction")
    return _errors(samples["residual_um"].groupby(names)).reset_index()


def by_command(samples: pd.DataFrame) -> pd.DataFrame:
    """Mean residual (µm) along the command (V), rising and falling."""
    edges = _edges(samples["command_V"], COMMAND_STEPS)
    names = samples["rising"].map({True: "rising", False: "falling"}).rename("direction")
    bins = pd.Series(_bin(samples["command_V"].to_numpy(), edges), samples.index, name="bin")
    table = _errors(samples["residual_um"].groupby([names, bins])).reset_index()
    table.insert(1, "low_V", edges[table["bin"]])
    table.insert(2, "high_V", edges[table["bin"] + 1])
    return table.drop(columns="bin")


def plane(samples: pd.DataFrame) -> Plane:
    """Mean residual over command and rate."""
    command, rate = samples["command_V"].to_numpy(), samples["rate_V_s"].to_numpy()
    residual = samples["residual_um"].to_numpy()
    command_edges = _edges(samples["command_V"], PLANE_STEPS)
    reach = float(np.percentile(np.abs(rate), _RATE_SHARE)) * 1.02 or 1.0
    rate_edges = np.linspace(-reach, reach, PLANE_STEPS + 1)
    inside = np.abs(rate) <= reach
    cell = _bin(command[inside], command_edges) * PLANE_STEPS + _bin(rate[inside], rate_edges)
    cells = PLANE_STEPS * PLANE_STEPS
    count = np.bincount(cell, minlength=cells)
    total = np.bincount(cell, weights=residual[inside], minlength=cells)
    # a cell that was passed once says nothing of what repeats
    cycle = samples["cycle"].to_numpy()[inside]
    visits = np.unique(cell * (int(samples["cycle"].max()) + 1) + cycle).size
    passes = visits / max(int(np.count_nonzero(count)), 1)
    mean = np.divide(total, count, out=np.full(cells, np.nan), where=count > 0)
    return Plane(
        command_edges,
        rate_edges,
        mean.reshape(PLANE_STEPS, PLANE_STEPS),
        count.reshape(PLANE_STEPS, PLANE_STEPS).astype(np.intp),
        int(np.count_nonzero(~inside)),
        _explained_percent(residual[inside], mean[cell], int(np.count_nonzero(count)))
        if passes >= _PASSES
        else None,
    )


def _explained_percent(residual: Array, means: Array, cells: int) -> float | None:
    freedom = residual.size - cells
    variance = float(np.var(residual))
    if freedom < residual.size // 2 or variance == 0.0:
        return None
    within = float(np.mean((residual - means) ** 2)) * residual.size / freedom
    between = variance * residual.size / (residual.size - 1)
    return float(np.clip(100.0 * (1.0 - within / between), 0.0, 100.0))


def _grouped(samples: pd.DataFrame, key: pd.Series[float]) -> pd.DataFrame:
    groups = samples.groupby(key)
    table = groups[["frequency_hz", "amplitude_V"]].mean()
    table["half_cycles"] = groups["cycle"].nunique()
    errors = _errors(groups["residual_um"])
    table[errors.columns] = errors
    table["relative_percent"] = 100.0 * table["rmse_um"] / groups["stroke_um"].mean()
    return table


def _errors(groups: SeriesGroupBy[Any, Any]) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "samples": groups.size(),
            "rmse_um": groups.agg(lambda e: _rms(e.to_numpy())),
            "mean_um": groups.mean(),
            "max_um": groups.agg(lambda e: float(np.max(np.abs(e)))),
        }
    )


def _edges(values: pd.Series[float], steps: int) -> Array:
    low, high = float(values.min()), float(values.max())
    if not high > low:  # a stretch at rest is all that counts
        low, high = low - 0.5, high + 0.5
    return np.linspace(low, high, steps + 1)


def _bin(values: Array, edges: Array) -> NDArray[np.intp]:
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, edges.size - 2)


def _rms(error: Array) -> float:
    return float(np.sqrt(np.mean(error * error)))


def _systematic_percent(rmse_um: float, noise_um: float) -> float:
    return 100.0 * max(0.0, 1.0 - (noise_um / rmse_um) ** 2) if rmse_um > 0 else 0.0


def _scatter(each: Trace) -> float:
    neighbours = each.counted[1:] & each.counted[:-1]
    steps = np.diff(each.residual_um)[neighbours]
    return _rms(steps) / float(np.sqrt(2.0)) if steps.size else np.nan


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
    samples = sample_table([trace])
    table = by_command(samples)
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
