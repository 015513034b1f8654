"""What a comparison's numbers suggest, in sentences that say no more than the numbers do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from rdpi_gym.diagnosis.comparison.breakdown import Plane
from rdpi_gym.diagnosis.comparison.traces import Trace
from rdpi_gym.measurement.quantities import in_output
from rdpi_gym.support.words import digits

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


def far_away(records: pd.DataFrame) -> str | None:
    """Say that model and measurement are different things, where they are."""
    rows = _rows(records)
    still = [row["name"] for row in rows if row["measured_peak_to_peak_um"] == 0]
    if still:
        return (
            f"The measured {{output}} of {still[0]} never changes; check its column and the sensor."
        )
    # where little more than noise is off, a held-out rest for one, model and data do not disagree
    rows = [row for row in rows if row["systematic_percent"] > _FAR_SYSTEMATIC_PERCENT]
    if not rows:
        return None
    worst = max(rows, key=lambda row: row["nrmse_percent"])
    gain = worst["gain_ratio"]
    wrong_gain = gain < 0 or not 1 / _FAR_GAIN < abs(gain) < _FAR_GAIN
    if not worst["nrmse_percent"] > (_NEAR_PERCENT if wrong_gain else _FAR_PERCENT):
        return None
    start = (
        f"The model is far away from {worst['name']}: its RMS error is "
        f"{worst['nrmse_percent']:.3g} % of the measured peak to peak"
    )
    if gain < 0:
        return (
            f"{start}, and it moves the other way; check the sign of y, the columns, or whether "
            "this model belongs to this actuator."
        )
    if wrong_gain and gain > 0:
        power = round(math.log10(gain))
        exact = power % 3 == 0 and power != 0 and abs(math.log10(gain) - power) < 0.35
        unit = f" (close to 10^{power}, as between m, mm, µm and nm, or V and mV)" if exact else ""
        return (
            f"{start}, and the measured stroke is about {gain:.4g} times the model's{unit}; check "
            "--units, or whether this model belongs to this actuator. The figures below mostly "
            "show this."
        )
    return (
        f"{start}; check the columns, or whether this model belongs to this actuator. "
        "The figures below mostly show this."
    )


def out_of_range(
    samples: pd.DataFrame, command_range_V: tuple[float, float], name: str
) -> str | None:
    """Say that commands were used for which the model was not made."""
    low, high = command_range_V
    least, most = float(samples["command_V"].min()), float(samples["command_V"].max())
    slack = 0.01 * (high - low)
    if least >= low - slack and most <= high + slack:
        return None
    return (
        f"Commands from {least:.4g} to {most:.4g} {{input_unit}} go beyond the range of {low:.4g} to "
        f"{high:.4g} {{input_unit}} that {name} states: what the model says there is extrapolated."
    )


def errors(
    records: pd.DataFrame, train_um: float | None, validation_um: float | None, noise: str
) -> str:
    """Say how large the error is, and how much of it is more than noise."""
    parts = []
    if train_um is not None:
        parts.append(f"{in_output(train_um)} on the training records")
    if validation_um is not None:
        parts.append(f"{in_output(validation_um)} on the validation records")
    if not parts:
        parts.append(f"{in_output(rms_over(records))} on the test records")
    text = f"Error {' and '.join(parts)}, rms with one offset free in each record; {noise}."
    share = systematic_share(records)
    if share < _ALL_NOISE:
        return f"{text} The error is hardly more than noise."
    if share > 0.99:
        return (
            f"{text} Nearly all of the squared error is systematic: a better model could take it."
        )
    return f"{text} About {100 * share:.0f} % of the squared error is systematic: a better model could take it."


def systematic_share(records: pd.DataFrame) -> float:
    """Share of the squared error that is more than noise, over all records (0 to 1)."""
    squares = float((records["samples"] * records["rmse_um"] ** 2).sum())
    systematic = records["samples"] * records["rmse_um"] ** 2 * records["systematic_percent"]
    return float(systematic.sum()) / (100.0 * squares) if squares > 0 else 0.0


def record_spread(records: pd.DataFrame) -> str:
    """Say which record is worst."""
    rows = _rows(records)
    if len(rows) == 1:
        return "There is one record only, so nothing can be said about how the error differs between records."
    worst, best = (pick(rows, key=lambda row: row["rmse_um"]) for pick in (max, min))
    twice = records["name"].duplicated().any()

    def label(row: Row) -> str:
        return f"{row['name']} ({row['role']})" if twice else str(row["name"])

    text = (
        f"The error is largest on {label(worst)} ({in_output(worst['rmse_um'])}) and smallest on "
        f"{label(best)} ({in_output(best['rmse_um'])})"
    )
    ratio = worst["rmse_um"] / best["rmse_um"] if best["rmse_um"] > 0 else math.inf
    return f"{text}; the records are alike." if ratio < 1.1 else f"{text}."


def gain(records: pd.DataFrame) -> str:
    """Say whether the measured stroke is larger than the model's."""
    rows = [row for row in _rows(records) if math.isfinite(row["gain_ratio"])]
    if not rows:
        return "The model does not move where samples count, so there is no gain to compare."
    worst = max(rows, key=lambda row: abs(row["gain_ratio"] - 1.0))
    ratio = worst["gain_ratio"]
    if not 1 / _FAR_GAIN < ratio < _FAR_GAIN:
        return f"On {worst['name']} the measured stroke is {ratio:.4g} times the model's (slope of measured over model)."
    percent = 100.0 * (ratio - 1.0)
    if abs(percent) < _GAIN_PERCENT:
        return f"The mean gain fits: measured and modelled stroke agree within {_GAIN_PERCENT:g} % in every record."
    more = "larger" if percent > 0 else "smaller"
    return (
        f"On {worst['name']} the measured stroke is {abs(percent):.2g} % {more} than the model's "
        "(slope of measured over model)."
    )


def drift(traces: Sequence[Trace], rmse_um: float) -> str:
    """Say whether the residual moves from the first to the last quarter of a record's loops."""
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
    if not moves:
        return "The records have too few periods to tell a slow drift."
    move, name, same_command = max(moves, key=lambda found: abs(found[0]))
    facts = (
        f"From the first to the last quarter of {name} the mean of measured minus model moves by "
        f"{in_output(move)}"
    )
    if abs(move) < MARKED * rmse_um:
        return f"{facts}: no marked slow drift."
    if not same_command:
        return f"{facts}; the command differs between the two, so this need not be creep or drift."
    return f"{facts}, which suggests creep, drift, or a memory from before the record."


def largest(traces: Sequence[Trace]) -> str:
    """Say where the largest difference stands."""
    peaks = [np.where(each.counted, np.abs(each.residual_um), -1.0) for each in traces]
    which = max(range(len(traces)), key=lambda i: float(peaks[i].max()))
    each, sample = traces[which], int(np.argmax(peaks[which]))
    way = "rising" if each.cycles.by_sample(each.cycles.rising)[sample] else "falling"
    text = (
        f"The largest difference is {in_output(float(peaks[which][sample]))}, in {each.name} "
        f"at t = {each.t_s[sample]:.6g} s ({each.u_V[sample]:.3g} {{input_unit}}, {way})"
    )
    if sample < each.cycles.edges[1]:
        return (
            f"{text}, before the first reversal: there the model does not know the actuator's past."
        )
    return f"{text}."


def direction(table: pd.DataFrame, by_command: pd.DataFrame, rmse_um: float) -> str:
    """Say whether rising and falling commands are wrong in opposite ways, and where most."""
    mean = {row["direction"]: row["mean_um"] for row in _rows(table)}
    if len(mean) < 2:
        only = "rises" if "rising" in mean else "falls"
        return f"The command only {only}: the width of the loop cannot be compared."
    facts = (
        f"Measured minus model is {in_output(mean['rising'])} on average while the command "
        f"rises and {in_output(mean['falling'])} while it falls"
    )
    gap = mean["rising"] - mean["falling"]
    if abs(gap) < MARKED * rmse_um:
        text = f"{facts}: the mean width of the loop is about right."
    else:
        text = (
            f"{facts}: the measured loop is on average about {in_output(abs(gap))} "
            f"{_width(gap)} than the model's, which suggests weights or thresholds that are off "
            "(or, where it changes with frequency, a lag or the rate law)."
        )
    place, widest = _widest_gap(by_command)
    if abs(widest) < max(rmse_um, 1.5 * abs(gap)):
        return text
    return (
        f"{text} Near {place:.3g} {{input_unit}} it is {in_output(abs(widest))} {_width(widest)}: the loop's "
        "shape differs along the command."
    )


def _width(gap_um: float) -> str:
    return "narrower" if gap_um > 0 else "wider"


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


def trend(table: pd.DataFrame, column: str, unit: str, name: str) -> str:
    """Say how the error changes from the lowest to the highest frequency or amplitude."""
    rows = [
        row
        for row in _rows(table)
        if row["samples"] >= _FEW_SAMPLES and row["half_cycles"] >= FEW_HALF_CYCLES
    ]
    if not rows:
        return (
            f"Fewer than {FEW_HALF_CYCLES} stretches of one {name} run from reversal to "
            f"reversal: these records cannot tell how the error depends on {name}."
        )
    low, high = rows[0], rows[-1]
    if len(rows) == 1:
        return (
            f"All stretches have about the same {name} ({digits(low[column], 3)} {unit}): these records "
            f"cannot tell how the error depends on {name}."
        )
    facts = f"from {digits(low[column], 3)} to {digits(high[column], 3)} {unit} the RMS error"
    ends = f"{in_output(low['rmse_um'])} to {in_output(high['rmse_um'])}"
    factor = high["rmse_um"] / low["rmse_um"] if low["rmse_um"] > 0 else math.inf
    peak = max(rows, key=lambda row: row["rmse_um"])
    if peak["rmse_um"] > GROWTH * max(low["rmse_um"], high["rmse_um"]):
        text = (
            f"The error is largest in between, {in_output(peak['rmse_um'])} near "
            f"{digits(peak[column], 3)} {unit}; {facts} goes from {ends}"
        )
    elif factor >= GROWTH:
        text = f"The error grows with {name}: {facts} goes from {ends}"
    elif factor <= 1 / GROWTH:
        text = f"The error falls with {name}: {facts} goes from {ends}"
    else:
        text = f"The error changes little with {name}: {facts} goes from {ends}"
    relative = f" ({digits(low['relative_percent'])} and {digits(high['relative_percent'])} % of the stroke there)"
    return f"{text}{relative}.{_confounded(rows, column)}"


def _confounded(rows: list[Row], column: str) -> str:
    other = "amplitude_V" if column == "frequency_hz" else "frequency_hz"
    word = "amplitude" if other == "amplitude_V" else "frequency"
    low, high = min(row[other] for row in rows), max(row[other] for row in rows)
    if high < GROWTH * low:
        return ""
    return f" The {word} changes too between these rows, so part of this may be its doing."


def command_and_rate(found: Plane) -> str:
    """Say how much of the error follows from command and rate alone."""
    share = found.explained_percent
    if share is None:
        return "There are too few samples, or passes through the same command at the same rate, to tell how much of the error follows from command and rate alone."
    text = (
        f"Command and rate alone account for {share:.0f} % of the residual's variance (cell means)"
    )
    if share >= 50:
        return f"{text}: most of the error is a repeatable function of the two."
    if share >= 15:
        return f"{text}; the rest depends on the past of the command, on time, or is noise."
    return f"{text}: what is left depends on the past of the command, on time, or is noise."


def rms_over(records: pd.DataFrame, column: str = "rmse_um") -> float:
    """RMS over records, each weighted by its samples (µm)."""
    known = records[records[column].notna()]
    total = float(known["samples"].sum())
    if total == 0:
        return math.nan
    return math.sqrt(float((known["samples"] * known[column] ** 2).sum()) / total)


def _rows(table: pd.DataFrame) -> list[Row]:
    return table.to_dict(orient="records")
