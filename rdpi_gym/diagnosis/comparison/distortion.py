"""The error under periodic commands: gain, width of the loop, odd and even harmonics, the rest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from rdpi_gym.diagnosis.comparison.traces import Trace
from rdpi_gym.diagnosis.features.periods import Periods, counted_periods, harmonics, steady_periods
from rdpi_gym.measurement import Record
from rdpi_gym.measurement.quantities import in_output
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.words import digits

PARTS = ("gain_um", "width_um", "odd_um", "even_um", "other_um")
"""Columns whose squares add up to the squared error of the periods."""
_EXCITED = 0.02  # of the command's strongest line
_MARKED = 2.0  # times the noise
EVEN_PERCENT = 0.15
"""Even harmonics count from this share of the displacement on (%), of a command that has none."""
_MEANING = {
    "gain_um": "at the command's frequencies and in step with the model: a gain that is off",
    "width_um": "at the command's frequencies and a quarter of a period out of step: the loop's "
    "width, a lag, a delay or the rate law",
    "odd_um": "in odd harmonics: the loop's shape, that is thresholds and weights, saturation or a "
    "slew limit",
    "even_um": "in even harmonics, which no play operator gives: asymmetry",
    "other_um": "not periodic: noise, drift or a disturbance",
}


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


def distortion_finding(table: pd.DataFrame, noise_um: float) -> str:
    """Say what the periodic error mostly is."""
    if not len(table):
        return "No record holds three steady periods, so the error cannot be split into harmonics."
    square = (table[list(PARTS)] ** 2).sum(axis=1).to_numpy()
    row = table.iloc[int(np.argmax(square))]
    total = float(square.max())
    if total <= (_MARKED * noise_um) ** 2:
        return "Under steady periods the error is not much more than noise in any record."
    part = max(PARTS, key=lambda name: float(row[name]))
    share = 100.0 * float(row[part]) ** 2 / total
    meaning = _MEANING[part]
    if part == "even_um" and not row["odd_command"]:
        meaning = "in even harmonics, which the command has too: that need not be asymmetry"
    elif part == "even_um" and row["even_um"] < EVEN_PERCENT / 100.0 * row["measured_um"]:
        meaning = (
            f"in even harmonics, less than {EVEN_PERCENT:g} % of the {{output}}: too little to "
            "lay it to the actuator"
        )
    return (
        f"In {row['name']} ({digits(float(row['frequency_hz']), 3)} Hz) {share:.0f} % of the squared "
        f"error ({in_output(float(row[part]))} rms) is {meaning}."
    )
