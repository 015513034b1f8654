"""paper.md: the paper's figures and numbers beside ours, written from the results."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.paper.cases import (
    BOUND_UM,
    FREQUENCIES_HZ,
    INVERSION_FREE,
    SECTION_V,
    SWEEP_LABEL,
    TS_S,
    section_iii,
)
from benchmarks.paper.gain import identified_g
from benchmarks.paper.markdown import number, seconds, table
from benchmarks.paper.readings import READINGS
from benchmarks.paper.run import PLANTS, SECTIONS, PaperResults
from benchmarks.paper.text_figures import (
    error_against_ts,
    figure_3,
    figure_4,
    figure_5,
    figure_7,
    figure_8,
    span,
)
from benchmarks.paper.text_theory import (
    best_by_plant,
    implementation,
    no_condition,
    right_half_plane_zero,
    why,
)
from benchmarks.paper.tracking import Sine
from benchmarks.paper.verdicts import falls, order
from rdpi_gym.support.words import joined


def paper_markdown(results: PaperResults) -> str:
    """Write the page."""
    sections: tuple[Callable[[PaperResults], str], ...] = (
        _verdict,
        _how_to_read,
        figure_3,
        figure_4,
        figure_5,
        error_against_ts,
        why,
        no_condition,
        right_half_plane_zero,
        figure_7,
        figure_8,
        implementation,
        _parameters,
    )
    return "\n\n".join(section(results) for section in sections) + "\n"


def _verdict(results: PaperResults) -> str:
    smallest = min(run.sine.ts_s for run in results.swept("literal"))
    sine = section_iii(50.0, smallest)
    holds = [
        reading.name
        for reading in INVERSION_FREE
        if results.series_verdict(SWEEP_LABEL, reading.name).startswith("holds:")
    ]
    left = max(results.find(SWEEP_LABEL, name, sine).percent for name in holds)
    limit_s = {plant: results.limit(plant, "literal").found_s for plant in PLANTS}
    limits = joined([f"{1e3 * limit_s[plant]:.3f} ms ({SECTIONS[plant]})" for plant in PLANTS])
    literal, given = (results.find("Fig. 8a", reading) for reading in ("literal", "given"))
    at_reference, over_gain = (
        results.find("Fig. 8b", f"closed-form {rate}")
        for rate in ("reference-rate", "reference-rate/A")
    )
    uncompensated = results.find("Section V, no compensation", "none")
    best = dict.fromkeys(x.run.reading.name for x in best_by_plant(results).values())
    finest = {
        name: results.find(SWEEP_LABEL, name, sine) for name in ("literal", "reference-rate/A")
    }
    return f"""# The paper's figures and numbers, recomputed

Aljanaideh, Al Janaideh, Rakotondrabe, "Inversion-free feedforward dynamic compensation of hysteresis nonlinearities in piezoelectric micro/nano-positioning actuators". Written by `rdpi reproduce --seed {results.seed} --realisations {results.realisations}`, which computes every number below.

1. **Eq. 6 as printed: "smaller Ts, smaller error", "e(k) → 0".** {_as_printed(results, sine)}
2. **"No condition".** There is one: the loop of Eq. 6 is stable only while Ts is above {limits}, found by simulation on both sides. The paper's {1e6 * SECTION_V.ts_s:g} µs is {limit_s["P10"] / SECTION_V.ts_s:.1f} times below the latter. {_without_rate(results)}
3. **Where the claim holds.** With {_readings(holds)}, that is with thresholds that are the same function of time in plant and compensator: the error falls like Ts, to {number(left, 2)} % of the amplitude.
4. **Section V, the model as plant.** Largest error without compensation {number(uncompensated.max_error)} µm; Eq. 6 as printed {span(literal.max_error_um)} µm, with command jumps of {number(literal.jump_V, 2)} V from sample to sample; with given thresholds {number(given.max_error, 2)} µm; classical inverse {number(at_reference.max_error, 2)} µm at the rate of y_r and {number(over_gain.max_error, 2)} µm at that rate over A. The paper measured {BOUND_UM:g} µm for both of its methods.
5. **Why, and what to use.** On its own rate Eq. 6 is a loop whose gain g δ2 / Ts grows as Ts falls, and the model has a right-half-plane zero ({joined([f"{z:.0f} rad/s" for z in results.zeros_rad_s.values()])}). A compensator that takes the rate from the reference is no such loop: {_readings(list(best))} had the smallest RMS errors on the plants tried at {SECTION_V.frequency_hz:g} Hz and {1e6 * SECTION_V.ts_s:g} µs. At a far smaller Ts the chatter is fast, and its RMS error small: at 50 Hz and {seconds(smallest)} *literal* leaves {number(finest["literal"].median_rms_error, 2)} µm rms and *reference-rate/A* {number(finest["reference-rate/A"].median_rms_error, 2)} µm, with largest errors of {number(finest["literal"].median_max_error, 2)} and {number(finest["reference-rate/A"].median_max_error, 2)} µm and command rates of {number(finest["literal"].median_max_rate, 2)} and {number(finest["reference-rate/A"].median_max_rate, 2)} V/s."""


def _as_printed(results: PaperResults, sine: Sine) -> str:
    """Say what of the claim holds for Eq. 6 as printed, and what does not."""
    fell: list[str] = []
    grew: list[str] = []
    for panel, hz in zip("def", FREQUENCIES_HZ, strict=True):
        smaller = falls(results.series(f"Fig. 3{panel}", "literal"))
        (fell if smaller else grew).append(f"{hz:g} Hz")
    ts = ", ".join(seconds(ts) for ts in TS_S)
    run = results.find(SWEEP_LABEL, "literal", sine)
    _, p_rms = order(*results.series(SWEEP_LABEL, "literal")[-2:])
    fall = "√Ts" if abs(p_rms - 0.5) < 0.1 else f"Ts^{p_rms:.2f}"
    first = (
        f"The first holds at {joined(fell)}: largest and RMS error fall from each of the paper's "
        f"sampling times ({ts}) to the next. "
        if fell
        else ""
    )
    if grew:
        first += f"At {joined(grew)} the largest error grows again. "
    tried = results.series(SWEEP_LABEL, "literal")
    if fell and not falls(tried):
        first += "Nor does it fall at every step once other times stand between them (50 Hz). "
    return (
        f"{first}The second does not: at 50 Hz and Ts = {seconds(sine.ts_s)} a largest error of "
        f"{number(run.median_max_error, 2)} µm is left, {run.percent:.2g} % of the amplitude. Below its "
        f"stability limit Eq. 6 chatters; its RMS error falls like {fall}, its largest error levels off."
    )


def _without_rate(results: PaperResults) -> str:
    """Say that the loop needs g below 1 even where the plant has no rate."""
    if not results.static_runs:
        return ""
    worst = max(results.static_runs, key=lambda x: x.g)
    return (
        f"Even without a rate it needs g = S / a_0 below 1: on a static plant with g = {worst.g:g} the "
        f"command is up to {worst.spikes:.2g} times as fast as the exact inverse's. P5 and P10 have g = "
        f"{PLANTS['P5'].g:.2f} and {PLANTS['P10'].g:.2f}; the plant identified from the measured PICMA "
        f"record has {identified_g():.2f}."
    )


def _readings(found: list[str]) -> str:
    return joined([f"*{name}*" for name in found])


def _how_to_read(results: PaperResults) -> str:
    rows = [[f"*{reading.name}*", reading.says] for reading in READINGS.values()]
    return f"""## How to read the tables

Errors are e = y_r - y over the last of three periods (samples 2M to 3M - 1, M samples a period), largest / RMS, in the unit of the amplitude; v(0) = 0, ξ(0) = 0. The readings of Eq. 6 and of the classical inverse:

{table(["reading", "what it is"], rows, right=False)}

A star marks a run that is not reproducible: {results.realisations} realisations whose references differ by a relative 1e-12 disagree. There only statistics mean anything, never a trace. The starred number is the one realisation of the exact reference, as in `paper.csv`; medians and ranges stand under "Error against Ts". Section III-B prints no threshold law; Eq. 8 is used with its δ1 and δ2."""


def _parameters(_: PaperResults) -> str:
    rows = [
        [
            f"{plant}, {SECTIONS[plant]}",
            str(model.n),
            ", ".join(f"{a:g}" for a in model.weights),
            f"{model.thresholds_V[0]:g}",
            number(model.delta2_s, 4),
            f"{model.S:.4f}",
            f"{model.A:.4f}",
            f"{model.g:.3f}",
        ]
        for plant, model in PLANTS.items()
    ]
    head = ["set", "n", "a_0, a_1, ... (µm/V)", "δ1 (V)", "δ2 (s)", "S", "A", "g = S / a_0"]
    return f"""## Parameters

As printed in the paper, and what follows from them (S = a_1 + ... + a_n and A = a_0 + S in µm/V):

{table(head, rows)}

`paper.csv` has a row for each of these numbers and for each case above, `sweep.csv` the numbers behind stability.png, `implementation.csv` those of the section on implementations."""
