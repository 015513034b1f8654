"""Run everything that the paper shows: cases, stability, zero, implementations; and judge it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.paper.cases import SWEEP, Case, Claim, paper_cases, section_iii
from benchmarks.paper.readings import READINGS, Reading
from benchmarks.paper.stability import (
    Divergence,
    Limit,
    divergence,
    stability_limit,
    zero_rad_s,
)
from benchmarks.paper.tracking import PERIODS, Sine, Tracking, track
from benchmarks.paper.variants import Implementation, StaticRun, implementations, static_runs
from benchmarks.paper.verdicts import judge, judge_series
from rdpi_gym.plant import PAPER_III_B, PAPER_IV_B, RDPI
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
