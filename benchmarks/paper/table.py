"""paper.csv: one row for every panel and number of the paper; sweep.csv and implementation.csv."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import astuple, dataclass, fields

import numpy as np

from benchmarks.paper.cases import LOOP_SAMPLES, SECTION_V, section_iii
from benchmarks.paper.run import DIVERGENCE_TS_S, PLANTS, SECTIONS, PaperResults
from benchmarks.paper.stability import Side
from benchmarks.paper.tracking import Tracking
from benchmarks.paper.verdicts import judge_limit
from rdpi_gym.plant import PAPER_CONVERTER, PAPER_SENSOR


@dataclass(frozen=True)
class Row:
    """One row of paper.csv; its fields are the columns.

    Parameters
    ----------
    case
        Figure, section or number of the paper.
    reading
        How the compensator was read; empty where none ran.
    frequency_hz, ts_s
        Reference's frequency (Hz) and sampling time (s), where there are any.
    max_error, rms_error
        Over the last of three periods (µm), with the exact reference.
    max_command_rate
        There (V/s).
    paper_value
        The number in the paper's text, where it has one.
    verdict
        Whether the paper's claim holds in this case.
    """

    case: str
    reading: str = ""
    frequency_hz: float | None = None
    ts_s: float | None = None
    max_error: float | None = None
    rms_error: float | None = None
    max_command_rate: float | None = None
    paper_value: float | None = None
    verdict: str = ""


COLUMNS = tuple(field.name for field in fields(Row))


def _tracked(case: str, run: Tracking, paper_value: float | None, verdict: str) -> Row:
    return Row(
        case,
        run.reading.name,
        run.sine.frequency_hz,
        run.sine.ts_s,
        run.max_error,
        run.rms_error,
        run.max_rate,
        paper_value,
        verdict,
    )


def paper_rows(results: PaperResults) -> list[Row]:
    """Return the rows of paper.csv."""
    rows = [
        _tracked(case.label, run, case.paper_value, verdict)
        for case, run, verdict in zip(results.cases, results.runs, results.verdicts, strict=True)
    ]
    for limit in results.limits:
        sides: tuple[tuple[str, Side], ...] = (("above", limit.above), ("below", limit.below))
        for (where, side), verdict in zip(sides, judge_limit(limit), strict=True):
            rows.append(
                Row(
                    f"Section III-A, no condition: {limit.plant}, ramp, {where} the limit",
                    limit.reading.name,
                    ts_s=side.ts_s,
                    max_error=side.max_error_um,
                    rms_error=side.rms_error_um,
                    max_command_rate=side.max_rate_V_s,
                    verdict=verdict,
                )
            )
    rows += [
        Row(
            "Section III-A, repeatability: reference changed by 1e-15",
            x.reading.name,
            ts_s=DIVERGENCE_TS_S,
            verdict=f"command moves by {x.largest_V:.2g} V",
        )
        for x in results.divergences
    ]
    for plant, measured in results.zeros_rad_s.items():
        predicted = PLANTS[plant].zero_rad_s
        rows.append(
            Row(
                f"{SECTIONS[plant]}, right-half-plane zero of {plant}",
                verdict=f"{measured:.0f} rad/s by simulation, A / (S δ2) = {predicted:.0f} rad/s",
            )
        )
    return rows + _parameter_rows()


def _parameter_rows() -> list[Row]:
    printed: dict[str, float] = {}
    derived: dict[str, str] = {}
    for plant, model in PLANTS.items():
        section = SECTIONS[plant]
        printed |= {f"{section}, n": model.n}
        printed |= {f"{section}, a_{i} (µm/V)": a for i, a in enumerate(model.weights)}
        printed |= {
            f"{section}, δ1 (V)": model.thresholds_V[0],
            f"{section}, δ2 (s)": model.delta2_s,
        }
        derived |= {
            f"{section}, S of {plant}": f"{model.S:.4f} µm/V",
            f"{section}, A of {plant}": f"{model.A:.4f} µm/V",
            f"{section}, g = S / a_0 of {plant}": f"{model.g:.4f}",
        }
    printed |= {
        "Section III-B, amplitude (µm)": section_iii(50.0, 1e-3).amplitude_um,
        "Section IV-A, refresh time (s)": PAPER_CONVERTER.period_s,
        "Section IV-A, sensor resolution (µm)": PAPER_SENSOR.resolution_um,
        "Section IV-B, K": LOOP_SAMPLES,
        "Section V, amplitude (µm)": SECTION_V.amplitude_um,
        "Section V, frequency (Hz)": SECTION_V.frequency_hz,
    }
    return [
        *(
            Row(case, paper_value=value, verdict="used as printed")
            for case, value in printed.items()
        ),
        *(Row(case, verdict=f"follows: {value}") for case, value in derived.items()),
    ]


def sweep_rows(results: PaperResults) -> list[Row]:
    """Return the error of every reading over the sampling time, 50 Hz: stability.png's numbers."""
    return [_tracked("sweep", run, None, _spread(run)) for run in results.sweep]


def implementation_rows(results: PaperResults) -> list[Row]:
    """Return the errors on plants other than the literal model; the case names the plant."""
    return [_tracked(x.plant, x.run, None, _spread(x.run)) for x in results.implementations]


def _spread(run: Tracking) -> str:
    if run.reproducible:
        return "reproducible"
    low, high = run.max_error_um.min(), run.max_error_um.max()
    return f"max {low:.3g} to {high:.3g} in {len(run.max_error_um)} realisations"


def to_csv(rows: Iterable[Row]) -> str:
    """Write rows as CSV, columns as :class:`Row`; empty where there is no number.

    Examples
    --------
    >>> to_csv([Row("Fig. 8a", "given", ts_s=5e-5, paper_value=3.0)]).splitlines()[1]
    'Fig. 8a,given,,5e-05,,,,3,'
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        writer.writerow([_cell(value) for value in astuple(row)])
    return text.getvalue()


def _cell(value: str | float | None) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else f"{np.float64(value):.7g}"
