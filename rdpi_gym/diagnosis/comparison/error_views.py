"""The error by its own frequency, by harmonics, in rests and over the clock of the experiment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from rdpi_gym.diagnosis.comparison.traces import Trace
from rdpi_gym.diagnosis.features.cycles import (
    Complexes,
    Periods,
    counted_periods,
    harmonics,
    longest_run,
    steady_periods,
)
from rdpi_gym.diagnosis.features.recurrence import Rest, find_rests
from rdpi_gym.diagnosis.notices import Statement, statement
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array

_SEGMENTS = 8  # of a record, half of each shared with its neighbour
_SHORTEST = 32
_SILENT = 1e-5  # of the command's strongest line: what does not come from it
_OCTAVE_THIRDS = 10.0  # bands a decade
_ABOVE = 2.0  # times the noise: the error is marked in a band
_MUCH, _LITTLE = 50.0, 15.0  # per cent


def spectrum_table(traces: Sequence[Trace], noise_um: float) -> pd.DataFrame:
    """Error in third-octave bands (centres 10^(k/10) Hz), all records together.

    Columns `residual_um` (rms in the band, over all samples), `noise_um` (what white noise of the
    noise floor has there), `coherent_percent` (share of the squared residual that a linear filter
    of the command gives). The squares of `residual_um` add up to the squared error, but for what is
    slower than an eighth of a record.
    """
    parts = [part for each in traces if (part := _part(each, noise_um)) is not None]
    if not parts:
        return pd.DataFrame(
            columns=[
                "frequency_hz",
                "low_hz",
                "high_hz",
                "residual_um",
                "noise_um",
                "coherent_percent",
            ]
        )
    total = sum(part.samples for part in parts)
    lines = pd.concat(
        [
            pd.DataFrame(
                {
                    "band": np.round(_OCTAVE_THIRDS * np.log10(part.frequency_hz)),
                    "residual": part.power * part.samples / total,
                    "noise": part.noise * part.samples / total,
                    "coherent": part.coherent * part.samples / total,
                }
            )
            for part in parts
        ]
    )
    sums = lines.groupby("band").sum()
    centre = 10.0 ** (sums.index.to_numpy() / _OCTAVE_THIRDS)
    half = 10.0 ** (0.5 / _OCTAVE_THIRDS)
    with np.errstate(invalid="ignore", divide="ignore"):
        coherent = 100.0 * sums["coherent"].to_numpy() / sums["residual"].to_numpy()
    return pd.DataFrame(
        {
            "frequency_hz": centre,
            "low_hz": centre / half,
            "high_hz": centre * half,
            "residual_um": np.sqrt(sums["residual"].to_numpy()),
            "noise_um": np.sqrt(sums["noise"].to_numpy()),
            "coherent_percent": np.nan_to_num(coherent),
        }
    )


@dataclass(frozen=True, eq=False)
class _Part:
    """Lines of one record: power of the residual, of noise, and what is coherent (µm²)."""

    frequency_hz: Array
    power: Array
    noise: Array
    coherent: Array
    samples: int


def _part(each: Trace, noise_um: float) -> _Part | None:
    run = slice(*longest_run(each.counted))
    length = 2 ** int(np.log2(max((run.stop - run.start) / (0.5 * (_SEGMENTS + 1)), 1.0)))
    if length < _SHORTEST:
        return None
    e, u = (_spectra(x[run], length) for x in (each.residual_um, each.u_V))
    count = len(e)
    power, of_u = np.mean(np.abs(e) ** 2, axis=0), np.mean(np.abs(u) ** 2, axis=0)
    cross = np.mean(e * u.conj(), axis=0)
    shown = (power > 0.0) & (of_u > _SILENT * of_u.max())
    share = np.divide(np.abs(cross) ** 2, power * of_u, out=np.zeros_like(power), where=shown)
    # a few segments are coherent by chance: one over their number
    share = np.clip((share - 1.0 / count) / (1.0 - 1.0 / count), 0.0, 1.0)
    lines = slice(1, None)
    frequency = np.arange(1, power.size) / (length * each.ts_s)
    noise = np.full(frequency.size, noise_um**2 / frequency.size)
    return _Part(frequency, power[lines], noise, (share * power)[lines], run.stop - run.start)


def _spectra(x: Array, length: int) -> Complexes:
    """Windowed spectra of the segments; their squared moduli add up to the variance."""
    starts = np.arange(0, x.size - length + 1, length // 2)
    window = np.hanning(length)
    segments = np.stack([x[start : start + length] for start in starts])
    segments = (segments - x.mean()) * window
    scale = np.sqrt(2.0 / (length * np.sum(window**2)))
    return np.asarray(np.fft.rfft(segments, axis=1) * scale, dtype=np.complex128)


def spectrum_finding(table: pd.DataFrame) -> Statement:
    """Say where in frequency the error is more than noise, and whether it follows linearly."""
    power = table["residual_um"].to_numpy() ** 2
    if not len(table) or power.sum() == 0.0:
        return statement("spectrum/short")
    excess = np.clip(power - table["noise_um"].to_numpy() ** 2, 0.0, None)
    above = table["residual_um"].to_numpy() > _ABOVE * table["noise_um"].to_numpy()
    if not above.any():
        return statement("spectrum/noise")
    middle = np.cumsum(excess) / max(float(excess.sum()), 1e-300)
    low = float(table["low_hz"].iloc[int(np.argmax(middle >= 0.1))])
    high = float(table["high_hz"].iloc[int(np.argmax(middle >= 0.9))])
    share = float((table["coherent_percent"].to_numpy() * power).sum() / power.sum())
    worst = int(np.argmax(power))
    if worst == 0:
        return statement("spectrum/slow", edge_hz=float(table["high_hz"].iloc[0]))
    kind = "most" if share >= _MUCH else "part" if share >= _LITTLE else "little"
    return statement(
        f"spectrum/coherent/{kind}", low=low, high=high, percent=share, size=float(np.sqrt(power[worst])),
        frequency_hz=float(table["frequency_hz"].iloc[worst]),
    )  # fmt: skip


def share_of_peak(table: pd.DataFrame) -> tuple[float, float]:
    """Share of the squared error in the third of an octave with most of it, and its frequency (Hz)."""
    power = table["residual_um"].to_numpy() ** 2
    if not len(table) or power.sum() == 0.0:
        return 0.0, 0.0
    worst = int(np.argmax(power))
    return float(power[worst] / power.sum()), float(table["frequency_hz"].iloc[worst])


PARTS = ("gain_um", "width_um", "odd_um", "even_um", "other_um")
"""Columns whose squares add up to the squared error of the periods."""
_EXCITED = 0.02  # of the command's strongest line
_MARKED_FLOORS = 2.0  # times the noise
EVEN_PERCENT = 0.15
"""Even harmonics count from this share of the displacement on (%), of a command that has none."""


def distortion_table(traces: Sequence[Trace]) -> pd.DataFrame:
    """Take the error under steady periods apart; one row a record with three that count.

    `gain_um` and `width_um` are at the frequencies of the command, in step with the model's
    displacement and a quarter of a period from it; `odd_um` and `even_um` are at other odd and
    even multiples of the period's frequency; `other_um` differs from period to period (all rms).
    `odd_command` says whether the command has no even harmonics, `measured_um` is the displacement
    (rms).
    """
    rows = []
    for each in traces:
        record = Record(each.name, each.t_s, each.u_V, each.measured_um, ts_s=each.ts_s)
        periods = steady_periods(record, each.cycles)
        if periods is not None:
            periods = counted_periods(periods, each.counted)
        if periods is not None:
            rows.append(_row(each, periods))
    columns = ["name", "role", "frequency_hz", "periods", *PARTS, "odd_command", "measured_um"]
    return pd.DataFrame(rows, columns=columns)


def _row(each: Trace, periods: Periods) -> dict[str, Any]:
    residual, model, command = (
        harmonics(periods, x).mean for x in (each.residual_um, each.model_um, each.u_V)
    )
    order = np.arange(residual.size)
    size = np.abs(command)
    excited = (size > _EXCITED * size[1:].max()) & (order > 0)
    turned = np.where(
        np.abs(model) > 0, residual * np.conj(model) / np.maximum(np.abs(model), 1e-300), 0.0
    )
    rest = (order > 0) & ~excited
    even = order % 2 == 0
    size[0] = 0.0
    total = float(np.var(periods.folded(each.residual_um)[1:]))
    parts = {
        "gain_um": _rms(turned[excited].real),
        "width_um": _rms(turned[excited].imag),
        "odd_um": _rms(np.abs(residual[rest & (order % 2 == 1)])),
        "even_um": _rms(np.abs(residual[rest & (order % 2 == 0)])),
    }
    known = sum(value**2 for value in parts.values())
    return {
        "name": each.name,
        "role": each.role,
        "frequency_hz": periods.frequency_hz,
        "periods": periods.count,
        **parts,
        "odd_command": bool(_rms(size[even]) < EVEN_PERCENT / 100.0 * _rms(size[~even])),
        "measured_um": float(np.std(each.measured_um[periods.part])),
        "other_um": float(np.sqrt(max(total - known, 0.0))),
    }


def _rms(coefficients: Array) -> float:
    return float(np.sqrt(2.0 * np.sum(coefficients**2)))


def distortion_finding(table: pd.DataFrame, noise_um: float) -> Statement:
    """Say what the periodic error mostly is."""
    if not len(table):
        return statement("distortion/none")
    square = (table[list(PARTS)] ** 2).sum(axis=1).to_numpy()
    row = table.iloc[int(np.argmax(square))]
    total = float(square.max())
    if total <= (_MARKED_FLOORS * noise_um) ** 2:
        return statement("distortion/noise")
    part = max(PARTS, key=lambda name: float(row[name]))
    kind = part.removesuffix("_um")
    if part == "even_um" and not row["odd_command"]:
        kind = "even command"
    elif part == "even_um" and row["even_um"] < EVEN_PERCENT / 100.0 * row["measured_um"]:
        kind = "little even"
    return statement(
        f"distortion/{kind}", record=row["name"], frequency_hz=float(row["frequency_hz"]),
        percent=100.0 * float(row[part]) ** 2 / total, size=float(row[part]), least=EVEN_PERCENT,
    )  # fmt: skip


_BINS_A_DECADE = 4.0
_NET = 0.02  # of the widest swing: a move that has a direction
_AT_START = 5  # samples of a rest that its further course is measured from
_AFTER_CORNER = 3  # samples that a corner may disturb
_FEW = 20  # samples
_PIECES = 8  # of a record
_GOES_ON = 0.5  # of the error in rests: a course that is worth a sentence
_MARKED = 0.25  # of the error: a drift that is worth a sentence
_STEADY = 0.3  # of the mean slope over lg(t): what creep has at least in its later half
_SURE = 4.0  # standard errors that a drift within one record is away from nothing
_STRAIGHT = 0.5  # share of the moves that a straight line accounts for


def since_rest_table(traces: Sequence[Trace]) -> pd.DataFrame:
    """Error by the time since the command came to rest, and since it last rested.

    Rows have the `state` ``resting`` or ``moving`` and the middle of a bin of the logarithm of the
    time since that state began (`time_s`). `moved_um` is how far measured minus model has gone on
    since the rest began, positive in the direction of the last move; mean over all rests.
    """
    span_V = max(float(np.ptp(each.u_V)) for each in traces)
    parts: list[pd.DataFrame] = []
    for each in traces:
        rests = find_rests(_record(each), span_V)
        parts += [
            _resting(each, rest, _before(rests, rest), _NET * span_V)
            for rest in rests
            if rest.first > 0
        ]
        ends = [*(rest.first for rest in rests if rest.first > 0), each.u_V.size]
        starts = [rest.last for rest in rests]
        for start in starts:
            end = next((end for end in ends if end > start), start)
            parts.append(_moving(each, start, end))
    columns = ["state", "time_s", "samples", "rmse_um", "moved_um"]
    parts = [part for part in parts if len(part)]
    if not parts:
        return pd.DataFrame(columns=columns)
    samples = pd.concat(parts)
    band = np.floor(_BINS_A_DECADE * np.log10(samples["time_s"]) + 1e-9)
    groups = samples.groupby(["state", band.rename("band")])
    table = pd.DataFrame(
        {
            "samples": groups.size(),
            "rmse_um": np.sqrt(groups["square"].mean()),
            "moved_um": groups["moved"].mean(),
        }
    ).reset_index()
    table["time_s"] = 10.0 ** ((table["band"] + 0.5) / _BINS_A_DECADE)
    table = table.sort_values(["state", "time_s"], ascending=[False, True], ignore_index=True)
    return table[columns]


def _record(each: Trace) -> Record:
    return Record(each.name, each.t_s, each.u_V, each.measured_um, ts_s=each.ts_s)


def _before(rests: Sequence[Rest], rest: Rest) -> int:
    """Last sample of the rest before; the first of the record without one."""
    ends = [other.last - 1 for other in rests if other.last <= rest.first]
    return max(ends, default=0)


def _resting(each: Trace, rest: Rest, before: int, least_V: float) -> pd.DataFrame:
    first = rest.first + _AFTER_CORNER
    at = np.arange(first, rest.last)[each.counted[first : rest.last]]
    if at.size < _AT_START + 1:
        return pd.DataFrame()
    residual = each.residual_um
    net = each.u_V[rest.first] - each.u_V[before]
    way = each.measured_um[rest.first] - each.measured_um[before]
    # what came back to where it began has moved in no direction
    direction = np.sign(way) if abs(net) > least_V else np.nan
    moved = direction * (residual[at] - residual[at[:_AT_START]].mean())
    return _rows("resting", each.ts_s * (at - rest.first).astype(np.float64), residual[at], moved)


def _moving(each: Trace, start: int, end: int) -> pd.DataFrame:
    at = np.arange(start, end)[each.counted[start:end]]
    if not at.size:
        return pd.DataFrame()
    nothing = np.full(at.size, np.nan)
    return _rows(
        "moving", each.ts_s * (at - start + 1).astype(np.float64), each.residual_um[at], nothing
    )


def _rows(state: str, time_s: Array, residual_um: Array, moved_um: Array) -> pd.DataFrame:
    return pd.DataFrame(
        {"state": state, "time_s": time_s, "square": residual_um**2, "moved": moved_um}
    )


def since_rest_finding(table: pd.DataFrame, noise_um: float, creeps: bool) -> Statement:
    """Say whether the error goes on while the command rests; `creeps`: the model does."""
    rows = resting(table)
    if len(rows) < 3:
        return statement("since_rest/none")
    decades = np.log10(rows["time_s"].to_numpy())
    moved = rows["moved_um"].to_numpy()
    slope = float(np.polyfit(decades, moved, 1)[0])
    way = slope * float(np.ptp(decades))
    error_um = float(np.sqrt(np.average(rows["rmse_um"] ** 2, weights=rows["samples"])))
    half = len(moved) // 2
    later = (
        float(np.polyfit(decades[half:], moved[half:], 1)[0]) if len(moved) - half > 1 else slope
    )
    kind = "on" if way > 0 else "back"
    if abs(way) < max(_GOES_ON * error_um, noise_um):
        kind += " little"
    elif later / slope < _STEADY:
        kind += " lag"
    else:
        kind += " creep" if creeps and way < 0 else " far"
    return statement(
        f"since_rest/{kind}", first=float(rows["time_s"].iloc[0]),
        last=float(rows["time_s"].iloc[-1]), move=abs(way), slope=abs(slope),
    )  # fmt: skip


def resting(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of rests after a move with enough samples."""
    return table[
        (table["state"] == "resting") & (table["samples"] >= _FEW) & table["moved_um"].notna()
    ]


def share_of_rests(table: pd.DataFrame) -> float:
    """Share of the squared error, in rests and motion, of what goes on in rests after a move."""
    rows, total = resting(table), float((table["samples"] * table["rmse_um"] ** 2).sum())
    moved = np.minimum(rows["moved_um"].abs(), rows["rmse_um"]) ** 2
    return float((rows["samples"] * moved).sum()) / total if total > 0.0 else 0.0


def clock_table(traces: Sequence[Trace]) -> pd.DataFrame:
    """Mean error by the experiment's clock: up to eight pieces of each record.

    `mean_um` is the mean of measured minus model, the model with one offset for all records where
    their times do not overlap, with one for each where they do (`common_clock` False).
    """
    common = has_common_clock(traces)
    rows = []
    for each in traces:
        at = np.flatnonzero(each.counted)
        for piece in np.array_split(at, min(_PIECES, max(1, at.size // _FEW))):
            offset = each.offset_um if common else 0.0
            rows.append(
                {
                    "name": each.name,
                    "role": each.role,
                    "t_s": float(each.t_s[piece].mean()),
                    "command_V": float(each.u_V[piece].mean()),
                    "mean_um": float(each.residual_um[piece].mean()) + offset,
                    "samples": piece.size,
                    "common_clock": common,
                }
            )
    table = pd.DataFrame(rows)
    if common:
        table["mean_um"] -= np.average(table["mean_um"], weights=table["samples"])
    return table.sort_values("t_s", ignore_index=True)


def has_common_clock(traces: Sequence[Trace]) -> bool:
    """Whether records follow one another in time."""
    spans = {each.name: (float(each.t_s[0]), float(each.t_s[-1])) for each in traces}
    order = sorted(spans.values())
    return all(later[0] > earlier[1] for earlier, later in pairwise(order))


def clock_finding(table: pd.DataFrame, rmse_um: float) -> Statement:
    """Say whether the error drifts with the experiment's clock."""
    several = table["name"].nunique() > 1
    if several and not bool(table["common_clock"].iloc[0]):
        return statement("clock/overlap")
    if len(table) < 4:
        return statement("clock/few")
    t, mean = table["t_s"].to_numpy(), table["mean_um"].to_numpy()
    weight = np.sqrt(table["samples"].to_numpy())
    slope, _ = np.polyfit(t, mean, 1, w=weight)
    way = float(slope) * float(np.ptp(t))
    power = squares_about_mean(mean, weight)
    share = squares_about_mean(slope * t, weight) / power if power > 0.0 else 0.0
    sure = _sureness(t, mean, table["command_V"].to_numpy(), weight)
    kind = "several" if several else "one"
    if abs(way) < _MARKED * rmse_um:
        kind = "little"
    elif not several and (sure < _SURE or share < _STRAIGHT):
        kind = "unsure"
    elif share < _STRAIGHT:
        kind = "jumps"
    return statement(
        f"clock/{'rises' if way > 0 else 'falls'}/{kind}", seconds=float(np.ptp(t)), move=abs(way),
        percent=100 * share,
    )  # fmt: skip


def squares_about_mean(values: Array, weight: Array) -> float:
    """Weighted sum of squares about the weighted mean."""
    return float(np.sum((weight * (values - np.average(values, weights=weight**2))) ** 2))


def squares_of_clock(table: pd.DataFrame) -> float:
    """Sum of squares (µm²) of the straight line through the error over the experiment's clock."""
    if len(table) < 4:
        return 0.0
    t, weight = table["t_s"].to_numpy(), np.sqrt(table["samples"].to_numpy())
    slope, _ = np.polyfit(t, table["mean_um"].to_numpy(), 1, w=weight)
    return squares_about_mean(slope * t, weight)


def _sureness(t: Array, mean: Array, command: Array, weight: Array) -> float:
    """Slope of a mean over time beside that over the command, in times of its standard error."""
    columns = [np.ones_like(t), (t - t.mean()) / max(float(np.ptp(t)), 1e-300)]
    if float(np.ptp(command)) > 0.0:
        columns.append((command - command.mean()) / float(np.ptp(command)))
    rows = np.column_stack(columns) * weight[:, None]
    freedom = len(t) - len(columns)
    if freedom < 1:
        return 0.0
    solution = np.linalg.lstsq(rows, mean * weight, rcond=None)[0]
    left = mean * weight - rows @ solution
    spread = np.linalg.pinv(rows.T @ rows) * float(left @ left) / freedom
    return float(abs(solution[1]) / max(np.sqrt(spread[1, 1]), 1e-300))
