"""The part of paper.md that stands beside the paper's figures: tables, ours beside the paper's."""

from __future__ import annotations

import numpy as np

from benchmarks.paper.cases import (
    BOUND_UM,
    FIG_7,
    FREQUENCIES_HZ,
    INVERSION_FREE,
    LOOP_SAMPLES,
    SECTION_V,
    SWEEP_LABEL,
    TABLE_TS_S,
    TS_S,
    Claim,
    section_iii,
)
from benchmarks.paper.markdown import number, seconds, table
from benchmarks.paper.readings import READINGS
from benchmarks.paper.run import PaperResults
from benchmarks.paper.tracking import Tracking
from benchmarks.paper.verdicts import COMPLETE_PERCENT, loop_opening_percent
from rdpi_gym.support.arrays import Array


def errors(run: Tracking) -> str:
    """Write largest / RMS error of the exact reference, starred where it is not reproducible."""
    star = "" if run.reproducible else " *"
    return f"{number(run.max_error, 4)} / {number(run.rms_error, 4)}{star}"


def span(values: Array) -> str:
    """Write lowest and highest value."""
    return f"{number(float(values.min()), 2)} to {number(float(values.max()), 2)}"


def claim(verdict: str) -> str:
    """Return what a verdict says of the claim, without its note on the stability limit."""
    return verdict.partition("; this Ts")[0]


def _loop_table(unit: str, loops: list[tuple[str, Tracking]]) -> str:
    rows = []
    for name, run in loops:
        assert run.trace is not None
        opening = loop_opening_percent(run.trace)
        rows.append([name, seconds(run.sine.ts_s), errors(run), f"{opening:.3g} %"])
    return table(["loop", "Ts", f"max / RMS of {unit}", "opening, % of the stroke"], rows)


def figure_3(results: PaperResults) -> str:
    """Write the section on Fig. 3."""
    loops = [
        (f"3{panel}, {hz:g} Hz", results.find(f"Fig. 3{panel}", "none"))
        for panel, hz in zip("abc", FREQUENCIES_HZ, strict=True)
    ]
    rows = [
        [
            f"3{panel}, {hz:g} Hz, *{reading.name}*",
            *(
                errors(results.find(f"Fig. 3{panel}", reading.name, section_iii(hz, ts)))
                for ts in TS_S
            ),
            results.series_verdict(f"Fig. 3{panel}", reading.name),
        ]
        for panel, hz in zip("def", FREQUENCIES_HZ, strict=True)
        for reading in INVERSION_FREE
    ]
    captions = ", ".join(
        f"{hz:g} Hz with {seconds(ts)}" for hz, ts in zip(FREQUENCIES_HZ, TS_S, strict=True)
    )
    head = ["panel", *(f"Ts = {seconds(ts)}" for ts in TS_S), "the claim"]
    return f"""## Figure 3: loops without compensation, and the error at three sampling times

The paper: {Claim.SMALLER_TS.value}. It prints no error values for this figure.

![Figure 3](fig3.png)

(a) to (c), without compensation, {Claim.LOOP.value}: {results.verdict("Fig. 3c", "none")}.

{_loop_table("y_r - y", loops)}

(d) to (f), Eq. 6 at each Ts (the paper's captions pair {captions}; its text applies all three to each):

{table(head, rows)}"""


def figure_4(results: PaperResults) -> str:
    """Write the section on Fig. 4."""
    rows = [
        [
            f"*{reading.name}*",
            *(errors(results.find(f"Fig. 4{panel}", reading.name)) for panel in "ab"),
            claim(results.verdict("Fig. 4b", reading.name)),
        ]
        for reading in INVERSION_FREE
    ]
    head = ["50 Hz", *(f"4{p}, Ts = {seconds(ts)}" for p, ts in zip("ab", TS_S[:2], strict=True))]
    return f"""## Figure 4: output against reference at 50 Hz

The paper: {Claim.SMALLER_TS_PAIR.value}.

![Figure 4](fig4.png)

{table([*head, "the claim"], rows)}"""


def figure_5(results: PaperResults) -> str:
    """Write the section on Fig. 5."""
    panels = tuple(zip("abc", FREQUENCIES_HZ, strict=True))
    rows = []
    for reading in INVERSION_FREE:
        runs = [results.find(f"Fig. 5{panel}", reading.name) for panel, _ in panels]
        left = [
            "complete" if run.percent <= COMPLETE_PERCENT else f"{number(run.percent, 2)} %"
            for run in runs
        ]
        rows.append(
            [
                f"*{reading.name}*",
                *(f"{errors(run)} ({word})" for run, word in zip(runs, left, strict=True)),
                claim(results.verdict("Fig. 5c", reading.name)),
            ]
        )
    head = [f"Ts = {seconds(TS_S[-1])}", *(f"5{panel}, {hz:g} Hz" for panel, hz in panels)]
    return f"""## Figure 5: output against reference at Ts = {seconds(TS_S[-1])}

The paper: {Claim.COMPLETE.value}, at all three frequencies. Here compensation counts as complete where the largest error is at most {COMPLETE_PERCENT:g} % of the amplitude: what the paper's sensor resolves of its stroke.

![Figure 5](fig5.png)

{table([*head, "the claim at 50 Hz"], rows)}"""


def error_against_ts(results: PaperResults) -> str:
    """Write the section on the claim "smaller Ts, smaller error", with the ensembles' statistics."""
    sines = [section_iii(50.0, ts) for ts in TABLE_TS_S]
    rows = [
        [
            f"*{reading.name}*",
            *(errors(results.find(SWEEP_LABEL, reading.name, sine)) for sine in sines),
            results.series_verdict(SWEEP_LABEL, reading.name),
        ]
        for reading in READINGS.values()
    ]
    starred = {(run.reading.name, run.sine): run for run in results.runs if not run.reproducible}
    ensembles = sorted(
        starred.values(),
        key=lambda r: (r.sine.plant, r.reading.name, r.sine.frequency_hz, -r.sine.ts_s),
        reverse=True,
    )
    statistics = [
        [
            f"*{run.reading.name}*, {run.sine.plant}, {run.sine.frequency_hz:g} Hz",
            seconds(run.sine.ts_s),
            number(run.max_error),
            f"{number(run.median_max_error)} ({span(run.max_error_um)})",
            f"{number(run.median_rms_error)} ({span(run.rms_error_um)})",
            number(run.median_max_rate),
            f"{run.median_max_rate / _smooth_rate(results, run):.3g}",
        ]
        for run in ensembles
    ]
    head = [
        "run", "Ts", "max, exact reference", "max, median (range)", "RMS, median (range)",
        "max rate (V/s)", "× smooth",
    ]  # fmt: skip
    return f"""## Error against Ts

The paper (Section III-A): "y(k) ≅ y_r(k), and ... e(k) → 0", with no condition. 50 Hz, amplitude {sines[0].amplitude_um:g}:

{table(["reading", *(f"Ts = {seconds(ts)}" for ts in TABLE_TS_S), "the claim"], rows)}

![Error against the sampling time](stability.png)

The starred runs as statistics over {results.realisations} realisations. The last column is the median of the command's largest rate over that of the smooth command with given thresholds: one-sample spikes.

{table(head, statistics)}"""


def _smooth_rate(results: PaperResults, run: Tracking) -> float:
    given = (r for r in results.runs if r.reading.name == "given")
    return next(r for r in given if r.sine == run.sine).max_rate


def figure_7(results: PaperResults) -> str:
    """Write the section on Fig. 7."""
    slow, fast = FIG_7
    loops = [(f"{sine.frequency_hz:g} Hz", results.find("Fig. 7", "none", sine)) for sine in FIG_7]
    return f"""## Figure 7: loops of the identified actuator

The paper plots measured loops at {slow.frequency_hz:g} and {fast.frequency_hz:g} Hz, K = {LOOP_SAMPLES} points each, and prints neither the data nor the drive. Shown are the loops of the model that it identified from them, for a sine of {slow.amplitude_um:g} V. {Claim.LOOP.value.capitalize()}: {results.verdict("Fig. 7", "none", fast)}.

![Figure 7](fig7.png)

{_loop_table("u - y", loops)}"""


def figure_8(results: PaperResults) -> str:
    """Write the section on Fig. 8 and Section V."""
    rows = [
        [
            f"{case.label}, *{run.reading.name}*".replace("Fig. ", ""),
            errors(run) + ("" if run.reproducible else f" ({span(run.max_error_um)})"),
            f"{number(run.jump_V, 2)} V",
            f"{case.paper_value:g} µm" if case.paper_value else "–",
            claim(verdict),
        ]
        for case, run, verdict in zip(results.cases, results.runs, results.verdicts, strict=True)
        if case.claim is Claim.BOUND
    ]
    sine = SECTION_V
    head = ["reading", "max / RMS (µm)", "largest jump of u in a sample", "paper", "the claim"]
    literal = results.find("Fig. 8a", "literal")
    stays = float(np.max(literal.max_error_um)) <= BOUND_UM
    remark = (
        ""
        if stays
        else f"""

The paper measured {BOUND_UM:g} µm with Eq. 6 at {1e6 * sine.ts_s:g} µs, where Eq. 6 as printed chatters. Either its implementation differs from the print (thresholds from the reference's rate, a filtered rate), or actuator and sensor filtered the chatter; the text does not say."""
    )
    return f"""## Figure 8 and Section V: {sine.frequency_hz:g} Hz, {sine.amplitude_um:g} µm, {1e6 * sine.ts_s:g} µs

The paper: {Claim.BOUND.value}, for the proposed (8a) and for the classical compensator (8b), measured on its actuator. Here the identified model is the plant, so whatever the model does not describe is missing: staying within the bound is necessary, not sufficient.

![Figure 8](fig8.png)

{table(head, rows)}{remark}"""
