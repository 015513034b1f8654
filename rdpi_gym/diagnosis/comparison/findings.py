"""Findings of a comparison: no more than its numbers show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
import pandas as pd

from rdpi_gym.diagnosis.comparison.traces import Plane, Trace
from rdpi_gym.diagnosis.notices import Statement, statement
from rdpi_gym.identification import residuals

Row: TypeAlias = dict[Any, Any]

MARKED = 0.25
"""A bias is worth a sentence from this share of the RMS error on."""
GROWTH = 1.5
"""An error grows, or falls, where it changes by this factor or more."""
_NEAR_PERCENT, _FAR_PERCENT = 5.0, 20.0
_FAR_GAIN = 1.5
_FAR_SYSTEMATIC_PERCENT = 50.0
_GAIN_PERCENT = 0.5
_ALL_NOISE = 0.1  # of the squared error
_ALIKE = 0.03  # share of its peak to peak within which a command is the same
FEW_HALF_CYCLES = 4
"""A frequency or amplitude of fewer half-cycles is in the tables, but no sentence rests on it."""
_FEW_SAMPLES = 20
_BETWEEN_QUARTERS = 0.75  # of a record: between the middles of its first and last quarter


def far_away(records: pd.DataFrame) -> Statement | None:
    """Say that model and measurement are different things, where they are."""
    rows = _rows(records)
    still = [row["name"] for row in rows if row["measured_peak_to_peak_um"] == 0]
    if still:
        return statement("far/still", record=still[0])
    # where little more than noise is off, a held-out rest for one, model and data do not disagree
    rows = [row for row in rows if row["systematic_percent"] > _FAR_SYSTEMATIC_PERCENT]
    if not rows:
        return None
    worst = max(rows, key=lambda row: row["nrmse_percent"])
    gain = worst["gain_ratio"]
    wrong_gain = gain < 0 or not 1 / _FAR_GAIN < abs(gain) < _FAR_GAIN
    if not worst["nrmse_percent"] > (_NEAR_PERCENT if wrong_gain else _FAR_PERCENT):
        return None
    values = {"record": worst["name"], "percent": worst["nrmse_percent"], "gain": gain}
    if gain < 0:
        return statement("far/turned", **values)
    if not (wrong_gain and gain > 0):
        return statement("far/other", **values)
    power = round(math.log10(gain))
    exact = power % 3 == 0 and power != 0 and abs(math.log10(gain) - power) < 0.35
    return (
        statement("far/unit", power=power, **values) if exact else statement("far/gain", **values)
    )


def out_of_range(
    samples: pd.DataFrame, command_range_V: tuple[float, float], name: str
) -> Statement | None:
    """Say that commands were used for which the model was not made."""
    low, high = command_range_V
    least, most = float(samples["command_V"].min()), float(samples["command_V"].max())
    slack = 0.01 * (high - low)
    if least >= low - slack and most <= high + slack:
        return None
    return statement("range", least=least, most=most, low=low, high=high, model=name)


def errors(
    records: pd.DataFrame, train_um: float | None, validation_um: float | None, noise: Statement
) -> Statement:
    """Say how large the error is, and how much of it is more than noise."""
    roles = {"train": train_um, "validation": validation_um}
    kinds = [role for role, error_um in roles.items() if error_um is not None] or ["test"]
    sizes = statement(
        f"error/{'+'.join(kinds)}", train=train_um, validation=validation_um,
        test=rms_over(records), noise=noise,
    )  # fmt: skip
    share = systematic_share(records)
    kind = "noise" if share < _ALL_NOISE else "systematic" if share > 0.99 else "mixed"
    return statement(f"overall/{kind}", sizes=sizes, percent=100 * share)


def systematic_share(records: pd.DataFrame) -> float:
    """Share of the squared error that is more than noise, over all records (0 to 1)."""
    squares = float((records["samples"] * records["rmse_um"] ** 2).sum())
    systematic = records["samples"] * records["rmse_um"] ** 2 * records["systematic_percent"]
    return float(systematic.sum()) / (100.0 * squares) if squares > 0 else 0.0


def record_spread(records: pd.DataFrame) -> Statement:
    """Say which record is worst."""
    rows = _rows(records)
    if len(rows) == 1:
        return statement("records/one")
    worst, best = (pick(rows, key=lambda row: row["rmse_um"]) for pick in (max, min))
    twice = records["name"].duplicated().any()

    def label(row: Row) -> str:
        return f"{row['name']} ({row['role']})" if twice else str(row["name"])

    ratio = worst["rmse_um"] / best["rmse_um"] if best["rmse_um"] > 0 else math.inf
    return statement(
        "records/alike" if ratio < 1.1 else "records/differ", worst=label(worst),
        largest=worst["rmse_um"], best=label(best), smallest=best["rmse_um"],
    )  # fmt: skip


def gain(records: pd.DataFrame) -> Statement:
    """Say whether the measured stroke is larger than the model's."""
    rows = [row for row in _rows(records) if math.isfinite(row["gain_ratio"])]
    if not rows:
        return statement("gain/still")
    worst = max(rows, key=lambda row: abs(row["gain_ratio"] - 1.0))
    ratio = worst["gain_ratio"]
    percent = 100.0 * (ratio - 1.0)
    if not 1 / _FAR_GAIN < ratio < _FAR_GAIN:
        kind = "far"
    elif abs(percent) < _GAIN_PERCENT:
        kind = "fits"
    else:
        kind = "larger" if percent > 0 else "smaller"
    return statement(
        f"gain/{kind}", record=worst["name"], ratio=ratio, percent=abs(percent), least=_GAIN_PERCENT
    )


def _largest_drift(traces: Sequence[Trace]) -> tuple[float, str, bool] | None:
    """Move of a residual between the outer quarters of a record's loops (µm), under the same command or not."""
    moves = []
    for each in traces:
        kept = each.cycles.by_sample(each.cycles.whole) & each.counted
        stretch = each.cycles.by_sample(np.arange(each.cycles.rising.size))[kept]
        stretches = np.unique(stretch)
        loops = stretches.size // 8
        if loops < FEW_HALF_CYCLES // 2:
            continue
        first = kept.nonzero()[0][np.isin(stretch, stretches[: 2 * loops])]
        last = kept.nonzero()[0][np.isin(stretch, stretches[-2 * loops :])]
        command = each.u_V
        change = max(
            abs(command[last].mean() - command[first].mean()),
            abs(command[last].std() - command[first].std()),
        )
        residual = each.residual_um
        move = float(residual[last].mean() - residual[first].mean())
        moves.append((move, each.name, bool(change < _ALIKE * np.ptp(command))))
    return max(moves, key=lambda found: abs(found[0]), default=None)


def drift(traces: Sequence[Trace], rmse_um: float) -> Statement:
    """Say whether the residual moves from the first to the last quarter of a record's loops."""
    found = _largest_drift(traces)
    if found is None:
        return statement("drift/few")
    move, name, same_command = found
    kind = "same" if same_command else "other"
    if abs(move) < MARKED * rmse_um:
        kind = "little"
    return statement(f"drift/{kind}", record=name, move=move)


def largest(traces: Sequence[Trace]) -> Statement:
    """Say where the largest difference stands."""
    peaks = [np.where(each.counted, np.abs(each.residual_um), -1.0) for each in traces]
    which = max(range(len(traces)), key=lambda i: float(peaks[i].max()))
    each, sample = traces[which], int(np.argmax(peaks[which]))
    way = "rising" if each.cycles.by_sample(each.cycles.rising)[sample] else "falling"
    early = sample < each.cycles.edges[1]
    return statement(
        f"largest/{way}/{'early' if early else 'later'}", size=float(peaks[which][sample]),
        record=each.name, time=each.t_s[sample], command=each.u_V[sample],
    )  # fmt: skip


def direction(table: pd.DataFrame, by_command: pd.DataFrame, rmse_um: float) -> Statement:
    """Say whether rising and falling commands are wrong in opposite ways, and where most."""
    mean = {row["direction"]: row["mean_um"] for row in _rows(table)}
    if len(mean) < 2:
        return statement("direction/rises" if "rising" in mean else "direction/falls")
    gap = mean["rising"] - mean["falling"]
    side = "right" if abs(gap) < MARKED * rmse_um else "narrower" if gap > 0 else "wider"
    width = statement(
        f"direction/{side}", rising=mean["rising"], falling=mean["falling"], gap=abs(gap)
    )
    place, widest = _widest_gap(by_command)
    if abs(widest) < max(rmse_um, 1.5 * abs(gap)):
        return width
    way = "narrower" if widest > 0 else "wider"
    return statement(f"direction/near/{way}", width=width, place=place, gap=abs(widest))


def _widest_gap(by_command: pd.DataFrame) -> tuple[float, float]:
    """Command (V) where rising and falling residuals differ most, and by how much (µm)."""
    rows = [row for row in _rows(by_command) if row["samples"] >= _FEW_SAMPLES]
    falling = {row["low_V"]: row["mean_um"] for row in rows if row["direction"] == "falling"}
    gaps = [
        (0.5 * (row["low_V"] + row["high_V"]), row["mean_um"] - falling[row["low_V"]])
        for row in rows
        if row["direction"] == "rising" and row["low_V"] in falling
    ]
    return max(gaps, key=lambda found: abs(found[1]), default=(0.0, 0.0))


def trend(table: pd.DataFrame, column: Literal["frequency_hz", "amplitude_V"]) -> Statement:
    """Say how the error changes from the lowest to the highest frequency or amplitude."""
    rows = [
        row
        for row in _rows(table)
        if row["samples"] >= _FEW_SAMPLES and row["half_cycles"] >= FEW_HALF_CYCLES
    ]
    by = column.partition("_")[0]
    unit = statement(f"trend/unit/{by}")
    if not rows:
        return statement(f"trend/{by}/none", count=FEW_HALF_CYCLES)
    low, high = rows[0], rows[-1]
    if len(rows) == 1:
        return statement(f"trend/{by}/one", value=low[column], unit=unit)
    factor = high["rmse_um"] / low["rmse_um"] if low["rmse_um"] > 0 else math.inf
    peak = max(rows, key=lambda row: row["rmse_um"])
    kind = "grows" if factor >= GROWTH else "falls" if factor <= 1 / GROWTH else "stays"
    relative = high["relative_percent"] / max(low["relative_percent"], 1e-300)
    if kind == "stays" and (relative >= GROWTH or relative <= 1 / GROWTH):
        kind = "grows relatively" if relative > 1.0 else "falls relatively"
    if peak["rmse_um"] > GROWTH * max(low["rmse_um"], high["rmse_um"]):
        kind = "peaks"
    return statement(
        f"trend/{by}/{kind}/{'confounded' if _confounded(rows, column) else 'alone'}", unit=unit,
        low=low[column], high=high[column], first=low["rmse_um"], last=high["rmse_um"],
        peak=peak["rmse_um"], place=peak[column], first_percent=low["relative_percent"],
        last_percent=high["relative_percent"],
    )  # fmt: skip


def _confounded(rows: list[Row], column: str) -> bool:
    """Whether amplitude changes with frequency in the rows, or frequency with amplitude."""
    other = "amplitude_V" if column == "frequency_hz" else "frequency_hz"
    low, high = min(row[other] for row in rows), max(row[other] for row in rows)
    return not high < GROWTH * low


def command_and_rate(found: Plane) -> Statement:
    """Say how much of the error follows from command and rate alone."""
    share = found.explained_percent
    if share is None:
        return statement("plane/few")
    kind = "most" if share >= 50 else "part" if share >= 15 else "little"
    return statement(f"plane/{kind}", percent=share)


def share_above_rest(table: pd.DataFrame) -> float:
    """Share of the squared error that goes if the worst row is no worse than the others together."""
    weights, squares = table["samples"].to_numpy(np.float64), table["rmse_um"].to_numpy() ** 2
    total = float(weights @ squares)
    if len(table) < 2 or total <= 0.0:
        return 0.0
    worst = int(np.argmax(squares))
    rest = (total - weights[worst] * squares[worst]) / float(weights.sum() - weights[worst])
    excess = float(weights[worst] * (squares[worst] - rest))
    return max(excess / total, 0.0)


def share_of_gain(traces: Sequence[Trace], records: pd.DataFrame) -> float:
    """Share of the squared error that a gain of its own in each record removes."""
    rows = records[np.isfinite(records["gain_ratio"])]
    power = {(t.name, t.role): float(np.var(t.model_um[t.counted])) for t in traces}
    own = [
        row["samples"] * (row["gain_ratio"] - 1.0) ** 2 * power[row["name"], row["role"]]
        for row in _rows(rows)
    ]
    return _share(sum(own), records)


def share_of_largest(traces: Sequence[Trace], records: pd.DataFrame) -> float:
    """Share of the squared error in the half-cycle of the largest difference."""
    each = max(traces, key=lambda t: float(np.max(np.abs(t.residual_um[t.counted]))))
    sample = int(np.argmax(np.where(each.counted, np.abs(each.residual_um), -1.0)))
    cycle = each.cycles.by_sample(np.arange(each.cycles.rising.size))
    return _share(
        float(np.sum(each.residual_um[each.counted & (cycle == cycle[sample])] ** 2)), records
    )


def share_of_width(by_command: pd.DataFrame, records: pd.DataFrame) -> float:
    """Share of the squared error in the difference of rising and falling means along the command."""
    sides = [by_command[by_command["direction"] == way] for way in ("rising", "falling")]
    both = sides[0].merge(sides[1], on="low_V", suffixes=("_up", "_down"))
    half = 0.5 * (both["mean_um_up"] - both["mean_um_down"])
    return _share(float(((both["samples_up"] + both["samples_down"]) * half**2).sum()), records)


def share_of_drift(traces: Sequence[Trace], records: pd.DataFrame) -> float:
    """Share of the squared error of a straight line through the largest drift within a record."""
    found = _largest_drift(traces)
    if found is None:
        return 0.0
    move, name, _ = found
    samples = max(np.count_nonzero(each.counted) for each in traces if each.name == name)
    return _share(samples * (move / _BETWEEN_QUARTERS) ** 2 / 12.0, records)


def share_of_periodic(
    distortion: pd.DataFrame, parts: Sequence[str], records: pd.DataFrame
) -> float:
    """Share of the squared error of the largest part of the record with most of it."""
    if not len(distortion):
        return 0.0
    squares = distortion[list(parts)] ** 2
    row = int(np.argmax(squares.sum(axis=1)))
    name, role = distortion["name"].iloc[row], distortion["role"].iloc[row]
    own = records[(records["name"] == name) & (records["role"] == role)]
    return _share(float(own["samples"].sum()) * float(squares.iloc[row].max()), records)


def _share(squares: float, records: pd.DataFrame) -> float:
    total = float((records["samples"] * records["rmse_um"] ** 2).sum())
    return min(squares / total, 1.0) if total > 0.0 else 0.0


def rms_over(records: pd.DataFrame) -> float:
    """RMS over the rows of a table of errors, each weighted by its samples (µm)."""
    return residuals.rms_over(records["rmse_um"].tolist(), records["samples"].tolist())


def _rows(table: pd.DataFrame) -> list[Row]:
    return table.to_dict(orient="records")
