"""Run of everything that the paper shows, its verdicts, and the rows of its tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from benchmarks.paper.claims import (
    LOOP_SAMPLES,
    SECTION_V,
    SWEEP,
    Case,
    Claim,
    judge,
    judge_series,
    paper_cases,
    section_iii,
)
from benchmarks.paper.stability import (
    Divergence,
    Implementation,
    Limit,
    StaticRun,
    divergence,
    identified_g,
    implementations,
    stability_limit,
    static_runs,
    zero_rad_s,
)
from benchmarks.paper.tracking import PERIODS, READINGS, Reading, Sine, Tracking, track
from rdpi_gym.plant import PAPER_CONVERTER, PAPER_III_B, PAPER_IV_B, PAPER_SENSOR, RDPI
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress

PLANTS: dict[str, RDPI] = {"P5": PAPER_III_B, "P10": PAPER_IV_B}
"""The paper's two parameter sets, Sections III-B and IV-B."""
SECTIONS = {"P5": "Section III-B", "P10": "Section IV-B"}
DRAWN = ("literal", "given", "closed-form reference-rate/A")
"""Readings whose traces the figures show."""
DIVERGENCE_TS_S = 1e-4


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
    pairs = [(case.reading, case.sine) for case in chosen]
    swept = [(reading, sine) for reading in READINGS.values() for sine in sweep]
    lanes = {r: realisations if r.runs_on_own_rate else 1 for r in READINGS.values()}
    costs = {pair: PERIODS * pair[1].samples * lanes[pair[0]] for pair in [*pairs, *swept]}
    drawn = {pair for pair in pairs if pair[0].name in ("none", *DRAWN)}
    done: dict[tuple[Reading, Sine], Tracking] = {}
    spent = 0
    for (reading, sine), cost in costs.items():
        if progress:
            what = f"{reading.name}, {sine.frequency_hz:g} Hz, Ts = {sine.ts_s:.1e} s"
            progress(what, spent, sum(costs.values()))
        traced = (reading, sine) in drawn
        done[reading, sine] = track(reading, sine, lanes[reading], seed, traced)
        spent += cost
    runs = [done[pair] for pair in pairs]
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
        tuple(done[pair] for pair in swept),
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
        implementations(realisations, seed),
        static_runs(realisations, seed),
    )


COLUMNS = (
    # figure, section or number of the paper; how the compensator was read; parameter set
    "case", "reading", "plant",
    # reference's frequency (Hz) and sampling time (s)
    "frequency_hz", "ts_s",
    # errors (µm) and command rate (V/s) over the last of three periods, with the exact reference
    "max_error_um", "rms_error_um", "max_command_rate_V_s",
    # the number in the paper's text, where it has one, and its unit
    "paper_value", "unit",
    # whether the claim holds at this sampling time, and over all of the reading and frequency
    "verdict", "series_verdict",
)  # fmt: skip
_TEXTS = dict.fromkeys(("reading", "plant", "unit", "verdict", "series_verdict"), "")


def _table(rows: Iterable[dict[str, Any]]) -> pd.DataFrame:
    return pd.DataFrame([_TEXTS | row for row in rows], columns=list(COLUMNS))


def _tracked(case: str, run: Tracking, verdict: str) -> dict[str, Any]:
    return {
        "case": case, "reading": run.reading.name, "plant": run.sine.plant,
        "frequency_hz": run.sine.frequency_hz, "ts_s": run.sine.ts_s, "max_error_um": run.max_error,
        "rms_error_um": run.rms_error, "max_command_rate_V_s": run.max_rate, "verdict": verdict,
    }  # fmt: skip


def paper_rows(results: PaperResults) -> pd.DataFrame:
    """Return the rows of paper.csv: one for every panel and number of the paper."""
    rows: list[dict[str, Any]] = []
    for case, run, verdict in zip(results.cases, results.runs, results.verdicts, strict=True):
        row = _tracked(case.label, run, verdict)
        if case.paper_value is not None:
            row |= {"paper_value": case.paper_value, "unit": "µm"}
        if case.claim is Claim.SMALLER_TS:
            row["series_verdict"] = results.series_verdict(case.label, run.reading.name)
        rows.append(row)
    rows += [
        {
            "case": f"Section III-A, no condition: ramp, {where} the limit",
            "reading": limit.reading.name, "plant": limit.plant, "ts_s": side.ts_s,
            "max_error_um": side.max_error_um, "rms_error_um": side.rms_error_um,
            "max_command_rate_V_s": side.max_rate_V_s, "verdict": limit.verdict(side),
        }
        for limit in results.limits
        for where, side in limit.sides.items()
    ]  # fmt: skip
    rows += [
        _tracked("Section III-A, no condition: no rate", x.run, x.verdict)
        for x in results.static_runs
    ]
    rows += [
        {
            "case": "Section III-A, repeatability: reference changed by 1e-15",
            "reading": x.reading.name, "plant": "P5", "frequency_hz": 50.0,
            "ts_s": DIVERGENCE_TS_S, "verdict": f"command moves by {x.largest_V:.2g} V",
        }
        for x in results.divergences
    ]  # fmt: skip
    rows += [
        {
            "case": f"{SECTIONS[plant]}, right-half-plane zero", "plant": plant,
            "verdict": f"{measured:.0f} rad/s by simulation, "
            f"A / (S δ2) = {PLANTS[plant].zero_rad_s:.0f} rad/s",
        }
        for plant, measured in results.zeros_rad_s.items()
    ]  # fmt: skip
    return _table(rows + _parameter_rows())


def _parameter_rows() -> list[dict[str, Any]]:
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
    names = ("case", "plant", "paper_value", "unit", "verdict")
    return [
        *(dict(zip(names, (*each, "used as printed"), strict=True)) for each in printed),
        *({"case": c, "plant": p, "verdict": f"follows: {value}"} for c, p, value in derived),
    ]


def sweep_rows(results: PaperResults) -> pd.DataFrame:
    """Return the error of every reading over the sampling time, 50 Hz: stability.png's numbers."""
    return _table(_tracked("sweep", run, _spread(run)) for run in results.sweep)


def implementation_rows(results: PaperResults) -> pd.DataFrame:
    """Return the errors on plants other than the literal model; the case names the plant."""
    return _table(
        _tracked(each.plant, each.run, _spread(each.run)) for each in results.implementations
    )


def _spread(run: Tracking) -> str:
    if run.reproducible:
        return "reproducible"
    low, high = run.max_error_um.min(), run.max_error_um.max()
    return f"max {low:.3g} to {high:.3g} in {len(run.max_error_um)} realisations"


def to_csv(rows: pd.DataFrame) -> str:
    """Write rows as CSV; empty where there is no number."""
    return rows.to_csv(index=False, float_format="%.7g", lineterminator="\n")
