"""The error over time: since the command came to rest, since it last rested, by the experiment's clock."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pandas as pd

from rdpi_gym.diagnosis.comparison.traces import Trace
from rdpi_gym.diagnosis.features.rests import Rest, find_rests
from rdpi_gym.diagnosis.notices import Statement, statement
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array

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


def since_rest_finding(table: pd.DataFrame, noise_um: float) -> Statement:
    """Say whether the error goes on while the command rests."""
    rows = table[
        (table["state"] == "resting") & (table["samples"] >= _FEW) & table["moved_um"].notna()
    ]
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
    elif way > 0 and later < _STEADY * slope:
        kind += " lag"
    else:
        kind += " far"
    return statement(
        f"since_rest/{kind}", first=float(rows["time_s"].iloc[0]),
        last=float(rows["time_s"].iloc[-1]), move=abs(way), slope=abs(slope),
    )  # fmt: skip


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
    line = slope * t
    centred, fitted = (x - np.average(x, weights=weight**2) for x in (mean, line))
    power = float(np.sum((weight * centred) ** 2))
    share = float(np.sum((weight * fitted) ** 2)) / power if power > 0.0 else 0.0
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
