"""Run everything that the paper shows: cases, stability, zero, implementations; and judge it."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, fields

import numpy as np

from benchmarks.paper.cases import (
    LOOP_SAMPLES,
    SECTION_V,
    SWEEP,
    Case,
    Claim,
    paper_cases,
    section_iii,
)
from benchmarks.paper.stability import (
    Divergence,
    Implementation,
    Limit,
    Side,
    StaticRun,
    divergence,
    identified_g,
    implementations,
    stability_limit,
    static_runs,
    zero_rad_s,
)
from benchmarks.paper.tracking import PERIODS, READINGS, Reading, Sine, Tracking, track
from benchmarks.paper.verdicts import judge, judge_limit, judge_series, judge_static
from rdpi_gym.plant import PAPER_CONVERTER, PAPER_III_B, PAPER_IV_B, PAPER_SENSOR, RDPI
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress

PLANTS: dict[str, RDPI] = {"P5": PAPER_III_B, "P10": PAPER_IV_B}
"""The paper's two parameter sets, Sections III-B and IV-B."""
SECTIONS = {"P5": "Section III-B", "P10": "Section IV-B"}
DRAWN = ("literal", "given", "closed-form reference-rate/A")
"""Readings whose traces the figures show."""
DIVERGENCE_TS_S = 1e-4

"""Told what is next and the share of the work done, 0 to 1."""


@dataclass(frozen=True)
class PaperResults:
    """Everything computed for the paper's figures and numbers."""

    # what made the ensembles
    seed: int
    realisations: int
    # every simulated case and the verdict on it, in the order of the paper
    cases: tuple[Case, ...]
    verdicts: tuple[str, ...]
    runs: tuple[Tracking, ...]  # the run of each case
    sweep: tuple[Tracking, ...]  # every reading over the sampling time, 50 Hz, Ts falling
    limits: tuple[Limit, ...]  # stability limits of the compensators on their own rate
    # the models' right-half-plane zeros (rad/s) as measured, by plant
    zeros_rad_s: dict[str, float]
    # two runs that differ in the last bits, by reading, at 50 Hz and Ts = 1e-4 s
    divergences: tuple[Divergence, ...]
    implementations: tuple[Implementation, ...]  # readings on plants other than the literal model
    static_runs: tuple[StaticRun, ...] = ()  # Eq. 6 on plants without a rate, by their g.

    def find(self, label: str, reading: str, sine: Sine | None = None) -> Tracking:
        """Return the run of the first case with this label, reading and, if given, reference."""
        return self.runs[self._index(label, reading, sine)]

    def verdict(self, label: str, reading: str, sine: Sine | None = None) -> str:
        """Return the verdict on that case."""
        return self.verdicts[self._index(label, reading, sine)]

    def series(self, label: str, reading: str) -> tuple[Tracking, ...]:
        """Return the runs of a case over the sampling time, Ts falling."""
        case = self.cases[self._index(label, reading, None)]
        return tuple(_series(self.cases, self.runs, case, frequencies=False))

    def series_verdict(self, label: str, reading: str) -> str:
        """Return the verdict on all sampling times of that case together."""
        return judge_series(self.series(label, reading))

    def swept(self, reading: str) -> tuple[Tracking, ...]:
        """Return the runs of one reading over the sampling time, Ts falling."""
        return tuple(run for run in self.sweep if run.reading.name == reading)

    def limit(self, plant: str, reading: str) -> Limit:
        """Return the stability limit of one reading on one plant."""
        return next(x for x in self.limits if (x.plant, x.reading.name) == (plant, reading))

    def _index(self, label: str, reading: str, sine: Sine | None) -> int:
        return next(
            i
            for i, case in enumerate(self.cases)
            if (case.label, case.reading.name) == (label, reading) and sine in (None, case.sine)
        )


class _Runs:
    """Simulates each pair of reading and reference once and reports the share of work done."""

    def __init__(
        self,
        wanted: Sequence[tuple[Reading, Sine]],
        realisations: int,
        seed: int,
        progress: Progress | None,
    ) -> None:
        self._realisations, self._seed, self._progress = realisations, seed, progress
        self._done: dict[tuple[Reading, Sine], Tracking] = {}
        self._work = sum(self._cost(*pair) for pair in set(wanted))
        self._spent = 0

    def _lanes(self, reading: Reading) -> int:
        return self._realisations if reading.runs_on_own_rate else 1

    def _cost(self, reading: Reading, sine: Sine) -> int:
        return PERIODS * sine.samples * self._lanes(reading)

    def get(self, reading: Reading, sine: Sine, keep_trace: bool) -> Tracking:
        pair = (reading, sine)
        run = self._done.get(pair)
        if run is None:
            if self._progress:
                what = f"{reading.name}, {sine.frequency_hz:g} Hz, Ts = {sine.ts_s:.1e} s"
                self._progress(what, self._spent, self._work)
            run = track(reading, sine, self._lanes(reading), self._seed, keep_trace)
            self._done[pair] = run
            self._spent += self._cost(*pair)
        return run


def _series(
    cases: Sequence[Case], runs: Sequence[Tracking], case: Case, frequencies: bool
) -> list[Tracking]:
    """Return the runs that a case is judged among: over Ts, or over the frequency."""
    figure = case.label[:6]
    return [
        run
        for other, run in zip(cases, runs, strict=True)
        if other.label[:6] == figure
        and (other.claim, other.reading) == (case.claim, case.reading)
        and (frequencies or other.sine.frequency_hz == case.sine.frequency_hz)
    ]


def reproduce_paper(
    seed: int = 0,
    realisations: int = 16,
    cases: Sequence[Case] | None = None,
    sweep: Sequence[Sine] = SWEEP,
    progress: Progress | None = None,
) -> PaperResults:
    """Simulate and judge the paper's figures and numbers."""
    if seed < 0:
        raise InputError(f"seed is {seed}; give 0 or above")
    if realisations < 2:
        raise InputError(
            f"realisations is {realisations}; a spread needs 2 or more, 16 is the default"
        )
    chosen = tuple(paper_cases() if cases is None else cases)
    swept = [(reading, sine) for reading in READINGS.values() for sine in sweep]
    pairs = [(case.reading, case.sine) for case in chosen]
    runner = _Runs([*pairs, *swept], realisations, seed, progress)
    runs = [
        runner.get(reading, sine, reading.name in DRAWN or reading.name == "none")
        for reading, sine in pairs
    ]
    verdicts = [
        judge(case.claim, _series(chosen, runs, case, case.claim is Claim.LOOP), run)
        for case, run in zip(chosen, runs, strict=True)
    ]
    own_rate = [READINGS["literal"], READINGS["closed-form own-rate"]]
    return PaperResults(
        seed,
        realisations,
        chosen,
        tuple(verdicts),
        tuple(runs),
        tuple(runner.get(reading, sine, keep_trace=False) for reading, sine in swept),
        tuple(
            stability_limit(plant, model, reading)
            for reading in own_rate
            for plant, model in PLANTS.items()
        ),
        {plant: zero_rad_s(model) for plant, model in PLANTS.items()},
        tuple(
            divergence(READINGS[name], section_iii(50.0, DIVERGENCE_TS_S))
            for name in ("literal", "low-passed", "given", "closed-form reference-rate/A")
        ),
        tuple(implementations(realisations, seed)),
        static_runs(realisations, seed),
    )


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
