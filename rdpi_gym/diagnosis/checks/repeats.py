"""The same command twice: what has changed in between is drift, or drift of the gain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rdpi_gym.diagnosis.checks.check import Check, cannot_tell, zone_of
from rdpi_gym.diagnosis.checks.rest_fit import zero_um
from rdpi_gym.diagnosis.features.periods import Periods
from rdpi_gym.diagnosis.features.recurrence import same_command, wiped_from
from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.words import digits, pm

GAIN_PERCENT = 0.1
"""Change of the gain (%)."""
OFFSET_PERCENT = 0.05
"""Shift of the displacement (% of its peak to peak)."""
_BLOCKS = 40
_FEWEST_PERIODS = 6
_AGAIN = "Repeat the first record at the end of the experiment."


@dataclass(frozen=True)
class Repeat:
    """What a second run of a command shows that the first did not; with standard errors.

    Parameters
    ----------
    first, second
        What was compared, in words.
    apart_s
        Time between the two (s).
    gain
        Relative change of the gain (1).
    offset_um
        Shift at zero displacement (µm).
    span_um
        Peak to peak of the displacement (µm).
    """

    first: str
    second: str
    apart_s: float
    gain: tuple[float, float]
    offset_um: tuple[float, float]
    span_um: float


def repeats(records: Sequence[Record], stretches: Sequence[Periods]) -> tuple[Check, Check]:
    """Drift and gain drift from records with the same command, or from the periods of one."""
    found = _between_records(records) or _between_periods(stretches)
    if found is None:
        nothing = "No command was run twice with time in between, so a change of offset or gain over the experiment cannot be seen."
        return (
            cannot_tell("drift between repeats", nothing, _AGAIN),
            cannot_tell("gain drift between repeats", nothing, _AGAIN),
        )
    value, error = (100.0 * number / found.span_um for number in found.offset_um)
    return _offset(found, value, error), _gain(found)


def _offset(found: Repeat, value: float, error: float) -> Check:
    zone = zone_of(value, error, OFFSET_PERCENT)
    where = f"From {found.first} to {found.second}, {digits(found.apart_s, 3)} s later,"
    if zone == "yes":
        text = f"{where} the {{output}} has shifted by {digits(value)} % of its peak to peak ({digits(found.offset_um[0])} {{output_unit}}): drift, or creep that still goes on."
    elif zone == "no":
        text = f"{where} the {{output}} has come back to within {OFFSET_PERCENT:g} % of its peak to peak: no drift."
    else:
        text = f"{where} the {{output}} has shifted by {pm(value, error)} % of its peak to peak: too uncertain."
    step = _AGAIN if zone == "cannot tell" else ""
    return Check(
        "drift between repeats",
        value,
        OFFSET_PERCENT,
        "%",
        zone,
        text,
        step,
        ("thermal_drift", "creep"),
    )


def _gain(found: Repeat) -> Check:
    value, error = (100.0 * number for number in found.gain)
    zone = zone_of(value, error, GAIN_PERCENT)
    where = f"From {found.first} to {found.second}, {digits(found.apart_s, 3)} s later,"
    if zone == "yes":
        text = f"{where} the stroke has changed by {digits(value)} %: the gain drifts."
    elif zone == "no":
        text = f"{where} the stroke is the same within {GAIN_PERCENT:g} %: the gain does not drift."
    else:
        text = f"{where} the stroke has changed by {pm(value, error)} %: too uncertain."
    step = _AGAIN if zone == "cannot tell" else ""
    return Check(
        "gain drift between repeats", value, GAIN_PERCENT, "%", zone, text, step, ("gain_drift",)
    )


def _between_records(records: Sequence[Record]) -> Repeat | None:
    pairs = [(a, b) for a, b in same_command(records) if b.t_s[0] >= a.t_s[-1]]
    if not pairs:
        return None
    a, b = max(pairs, key=lambda pair: float(pair[1].t_s[0] - pair[0].t_s[0]))
    size = min(a.u_V.size, b.u_V.size)
    known = slice(wiped_from(a.u_V), size)
    return _compare(
        a.name, b.name, float(b.t_s[0] - a.t_s[0]), a.y_um[known], b.y_um[known], zero_um(a)
    )


def _between_periods(stretches: Sequence[Periods]) -> Repeat | None:
    long = [p for p in stretches if p.count >= _FEWEST_PERIODS]
    if not long:
        return None
    periods = max(long, key=lambda p: p.count * p.length * p.record.ts_s)
    rows = periods.folded(periods.record.y_um)
    few = max(1, (periods.count - 1) // 6)
    first, last = rows[1 : 1 + few].ravel(), rows[-few:].ravel()
    name = periods.record.name
    return _compare(
        f"the first periods of {name}", "the last", (periods.count - 1 - few) / periods.frequency_hz,
        first, last, float(first.mean()),
    )  # fmt: skip


def _compare(
    first: str, second: str, apart_s: float, a: Array, b: Array, zero: float
) -> Repeat | None:
    if a.size < 2 * _BLOCKS or np.ptp(a) == 0.0:
        return None
    rows = np.column_stack([np.ones(a.size), a - zero, np.linspace(-0.5, 0.5, a.size)])
    inverse = np.linalg.pinv(rows.T @ rows)
    solution = inverse @ (rows.T @ (b - a))
    misfit = (b - a) - rows @ solution
    # what is left is no white noise: errors from how blocks of samples pull at the result
    scores = np.stack(
        [part.sum(axis=0) for part in np.array_split(rows * misfit[:, None], _BLOCKS)]
    )
    error = np.sqrt(np.diag(inverse @ (scores.T @ scores) @ inverse))
    return Repeat(
        first, second, apart_s, (float(solution[1]), float(error[1])),
        (float(solution[0]), float(error[0])), float(np.ptp(a)),
    )  # fmt: skip
