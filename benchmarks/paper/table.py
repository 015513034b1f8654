"""paper.csv: one row for every panel and number of the paper; sweep.csv and implementation.csv."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import astuple, dataclass, fields

import numpy as np

from benchmarks.paper.cases import LOOP_SAMPLES, SECTION_V, Claim, section_iii
from benchmarks.paper.run import DIVERGENCE_TS_S, PLANTS, SECTIONS, PaperResults
from benchmarks.paper.stability import Side
from benchmarks.paper.tracking import Tracking
from benchmarks.paper.variants import identified_g
from benchmarks.paper.verdicts import judge_limit, judge_static
from rdpi_gym.plant import PAPER_CONVERTER, PAPER_SENSOR


@dataclass(frozen=True)
class Row:
    """One row of paper.csv; its fields are the columns."""

    case: str  # figure, section or number of the paper
    reading: str = ""  # how the compensator was read; empty where none ran
    # parameter set, P5 of Section III-B or P10 of Section IV-B; empty where there is none
    plant: str = ""
    # reference's frequency (Hz) and sampling time (s), where there are any
    frequency_hz: float | None = None
    ts_s: float | None = None
    # over the last of three periods (µm), with the exact reference
    max_error_um: float | None = None
    rms_error_um: float | None = None
    max_command_rate_V_s: float | None = None  # there (V/s)
    # the number in the paper's text, where it has one, and its unit
    paper_value: float | None = None
    unit: str = ""
    verdict: str = ""  # whether the paper's claim holds in this row: at this sampling time
    # whether it holds over all sampling times of the row's reading and frequency
    series_verdict: str = ""


COLUMNS = tuple(field.name for field in fields(Row))


def _tracked(
    case: str,
    run: Tracking,
    verdict: str,
    paper_value: float | None = None,
    series_verdict: str = "",
) -> Row:
    return Row(
        case,
        run.reading.name,
        run.sine.plant,
        run.sine.frequency_hz,
        run.sine.ts_s,
        run.max_error,
        run.rms_error,
        run.max_rate,
        paper_value,
        "" if paper_value is None else "µm",
        verdict,
        series_verdict,
    )


def paper_rows(results: PaperResults) -> list[Row]:
    """Return the rows of paper.csv."""
    rows = [
        _tracked(
            case.label,
            run,
            verdict,
            case.paper_value,
            results.series_verdict(case.label, run.reading.name)
            if case.claim is Claim.SMALLER_TS
            else "",
        )
        for case, run, verdict in zip(results.cases, results.runs, results.verdicts, strict=True)
    ]
    for limit in results.limits:
        sides: tuple[tuple[str, Side], ...] = (("above", limit.above), ("below", limit.below))
        for (where, side), verdict in zip(sides, judge_limit(limit), strict=True):
            rows.append(
                Row(
                    f"Section III-A, no condition: ramp, {where} the limit",
                    limit.reading.name,
                    limit.plant,
                    ts_s=side.ts_s,
                    max_error_um=side.max_error_um,
                    rms_error_um=side.rms_error_um,
                    max_command_rate_V_s=side.max_rate_V_s,
                    verdict=verdict,
                )
            )
    rows += [
        _tracked("Section III-A, no condition: no rate", x.run, judge_static(x))
        for x in results.static_runs
    ]
    rows += [
        Row(
            "Section III-A, repeatability: reference changed by 1e-15",
            x.reading.name,
            "P5",
            frequency_hz=50.0,
            ts_s=DIVERGENCE_TS_S,
            verdict=f"command moves by {x.largest_V:.2g} V",
        )
        for x in results.divergences
    ]
    for plant, measured in results.zeros_rad_s.items():
        predicted = PLANTS[plant].zero_rad_s
        rows.append(
            Row(
                f"{SECTIONS[plant]}, right-half-plane zero",
                plant=plant,
                verdict=f"{measured:.0f} rad/s by simulation, A / (S δ2) = {predicted:.0f} rad/s",
            )
        )
    return rows + _parameter_rows()


def _parameter_rows() -> list[Row]:
    printed: list[tuple[str, str, float, str]] = []
    derived: list[tuple[str, str, str]] = []
    for plant, model in PLANTS.items():
        section = SECTIONS[plant]
        printed += [
            (f"{section}, n", plant, model.n, "1"),
            *((f"{section}, a_{i}", plant, a, "µm/V") for i, a in enumerate(model.weights)),
            (f"{section}, δ1", plant, model.thresholds_V[0], "V"),
            (f"{section}, δ2", plant, model.delta2_s, "s"),
        ]
        derived += [
            (f"{section}, S", plant, f"{model.S:.4f} µm/V"),
            (f"{section}, A", plant, f"{model.A:.4f} µm/V"),
            (f"{section}, g = S / a_0", plant, f"{model.g:.4f}"),
        ]
    printed += [
        ("Section III-B, amplitude", "P5", section_iii(50.0, 1e-3).amplitude_um, "µm"),
        ("Section IV-A, refresh time", "", PAPER_CONVERTER.period_s, "s"),
        ("Section IV-A, sensor resolution", "", PAPER_SENSOR.resolution_um, "µm"),
        ("Section IV-B, K", "P10", LOOP_SAMPLES, "1"),
        ("Section V, amplitude", "P10", SECTION_V.amplitude_um, "µm"),
        ("Section V, frequency", "P10", SECTION_V.frequency_hz, "Hz"),
    ]
    derived.append(("Identified PICMA plant, g = S / a_0", "picma", f"{identified_g():.4f}"))
    return [
        *(
            Row(case, plant=plant, paper_value=value, unit=unit, verdict="used as printed")
            for case, plant, value, unit in printed
        ),
        *(Row(case, plant=plant, verdict=f"follows: {value}") for case, plant, value in derived),
    ]


def sweep_rows(results: PaperResults) -> list[Row]:
    """Return the error of every reading over the sampling time, 50 Hz: stability.png's numbers."""
    return [_tracked("sweep", run, _spread(run)) for run in results.sweep]


def implementation_rows(results: PaperResults) -> list[Row]:
    """Return the errors on plants other than the literal model; the case names the plant."""
    return [_tracked(x.plant, x.run, _spread(x.run)) for x in results.implementations]


def _spread(run: Tracking) -> str:
    if run.reproducible:
        return "reproducible"
    low, high = run.max_error_um.min(), run.max_error_um.max()
    return f"max {low:.3g} to {high:.3g} in {len(run.max_error_um)} realisations"


def to_csv(rows: Iterable[Row]) -> str:
    """Write rows as CSV, columns as :class:`Row`; empty where there is no number."""
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
