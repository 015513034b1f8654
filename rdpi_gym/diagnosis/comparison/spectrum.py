"""The error by its own frequency, and under periodic commands by harmonics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from rdpi_gym.diagnosis.comparison.traces import Trace
from rdpi_gym.diagnosis.features.cycles import (
    Complexes,
    Periods,
    counted_periods,
    harmonics,
    steady_periods,
)
from rdpi_gym.diagnosis.features.samples import longest_run
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


PARTS = ("gain_um", "width_um", "odd_um", "even_um", "other_um")
"""Columns whose squares add up to the squared error of the periods."""
_EXCITED = 0.02  # of the command's strongest line
_MARKED = 2.0  # times the noise
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
    if total <= (_MARKED * noise_um) ** 2:
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
