"""paper.md: the paper's figures and numbers beside ours, written from the results."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np

from baselines.feedforward import limiting_cutoff_hz
from benchmarks.paper.claims import (
    BOUND_UM,
    COMPLETE_PERCENT,
    FIG_7,
    FREQUENCIES_HZ,
    INVERSION_FREE,
    LOOP_SAMPLES,
    SECTION_V,
    SWEEP_LABEL,
    TABLE_TS_S,
    TS_S,
    Claim,
    falls,
    loop_opening_percent,
    order,
    section_iii,
)
from benchmarks.paper.run import DIVERGENCE_TS_S, PLANTS, SECTIONS, PaperResults
from benchmarks.paper.stability import MARGIN, SLIDE_V_S, identified_g
from benchmarks.paper.tracking import READINGS, Reading, Sine, Tracking
from rdpi_gym.support import markdown, words
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.words import joined


def table(head: Sequence[str], rows: Iterable[Sequence[str]], right: bool = True) -> str:
    """Write a table, its first column to the left and the others to the right, if `right`."""
    return markdown.table(head, rows, range(1, len(head)) if right else ())


def number(value: float, digits: int = 3) -> str:
    """Write a number with a few significant digits."""
    return words.number(value, digits, "short")


def seconds(value: float) -> str:
    """Write a sampling time in s as a power of ten."""
    mantissa, _, exponent = f"{value:.3e}".partition("e")
    return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)} s"


def why(results: PaperResults) -> str:
    """Explain the loop of Eq. 6 and show its limits, measured beside predicted."""
    rows = []
    for limit in results.limits:
        for where, side in (("above", limit.above), ("below", limit.below)):
            rows.append(
                [
                    f"*{limit.reading.name}*, {limit.plant}, {100 * MARGIN:g} % {where}",
                    f"{1e3 * limit.predicted_s:.4f}",
                    f"{1e3 * limit.found_s:.4f}",
                    f"{side.growth:.4f}",
                    f"{side.max_error_um:.3f}",
                    number(side.ripple_um, 2),
                    f"{side.max_rate_V_s / SLIDE_V_S:.3f}",
                ]
            )
    head = [
        "run", "predicted limit (ms)", "found (ms)", "growth a sample", "max error (µm)",
        "ripple of the error (µm)", "max rate × smooth",
    ]  # fmt: skip
    worst = max(
        max(abs(loop.b - by_hand.b), abs(loop.c - by_hand.c))
        for limit in results.limits
        for loop, by_hand in zip(limit.loops, limit.predicted_loops, strict=True)
    )
    parted = [[f"*{x.reading.name}*", f"{number(x.largest_V, 2)} V"] for x in results.divergences]
    return f"""## Why: Eq. 6 on its own rate is a loop

While all plays slide upwards, ξ_i = u - r_i with r_i = δ1 i + δ2 v. Eq. 6 feeds Ω, one sample old, back into u, and with it the rate. With S = a_1 + ... + a_n, g = S / a_0 and q = δ2 / Ts a disturbance of u obeys

    z² + g (1 - q) z + g q = 0,

stable, for g < 1, only while g q < 1, that is **Ts > g δ2**: the smaller Ts, the larger the gain of the differentiated part. The classical inverse on its own rate obeys z² - h z + h = 0 with h = S δ2 / (A Ts), and has a condition too: Ts > S δ2 / A.

Both were tried on a ramp of {SLIDE_V_S:g} V/s on which all plays slide, kicked once by 1e-8 µm. The polynomial fitted to what follows the kick agrees with the one above to {number(worst, 1)} in both coefficients at every Ts tried. Beside it, long slides {100 * MARGIN:g} % above and below the limit found:

{table(head, rows)}

![Growth of a disturbance against the sampling time](limit.png)

{_static(results)}

Below its limit the disturbance grows until plays stick, and the command chatters: the error's RMS falls with Ts because the chatter is fast, its maximum does not. Such runs cannot be repeated. At 50 Hz and Ts = {seconds(DIVERGENCE_TS_S)}, a reference larger by a relative 1e-15 moves the command by at most

{table(["reading", "over the last period"], parted)}

![Two runs that differ in the last bits](irreproducible.png)"""


def _static(results: PaperResults) -> str:
    """Show the loop of a plant without a rate."""
    rows = [
        [
            f"g = {x.g:.3g}",
            f"{x.growth:.3g}",
            f"{number(x.run.max_error, 4)} / {number(x.run.rms_error, 4)}",
            f"{x.spikes:.3g}",
        ]
        for x in results.static_runs
    ]
    head = ["S / a_0", "growth a sample", "max / RMS (µm)", "max rate × the exact inverse's"]
    sine = SECTION_V
    return f"""Without a rate, δ2 = 0, the polynomial is z (z + g): Ω, a sample old, is fed back with the gain -g, so Eq. 6 needs **g < 1** at any Ts. The plant of Section IV-B without its rate, its plays scaled to another g, at {sine.frequency_hz:g} Hz, {sine.amplitude_um:g} µm, {1e6 * sine.ts_s:g} µs; the plant identified from the measured PICMA record has g = {identified_g():.2f}:

{table(head, rows)}

Above g = 1 the command has spikes at every Ts."""


def no_condition(results: PaperResults) -> str:
    """Compare the conditions of Eq. 6 and of the classical inverse."""
    exact = {
        "P5": results.find(SWEEP_LABEL, "closed-form same thresholds"),
        "P10": results.find("Fig. 8b", "closed-form same thresholds"),
    }
    rows = []
    for plant, model in PLANTS.items():
        gaps = {
            round(b - a, 9)
            for a, b in zip(model.thresholds_V, model.thresholds_V[1:], strict=False)
        }
        run = exact[plant]
        rows.append(
            [
                plant,
                joined([f"{gap:g} V" for gap in sorted(gaps)]),
                number(run.max_error / run.sine.amplitude_um, 1),
                f"{1e3 * results.limit(plant, 'literal').found_s:.3f} ms",
            ]
        )
    head = [
        "set",
        "gap r_(i+1) - r_i, at any rate",
        "classical inverse, max error / amplitude",
        "Eq. 6 as printed needs Ts above",
    ]
    return f"""## "No condition on invertibility"

The classical inverse exists while the gaps between thresholds do not shrink with time. Under Eq. 8 the rate enters every threshold alike, so the gaps are constant and the inverse always exists: with the same thresholds in plant and compensator it is exact to rounding. So the absence of a condition is no advantage of Eq. 6, and Eq. 6 as printed has one of its own.

{table(head, rows)}"""


def right_half_plane_zero(results: PaperResults) -> str:
    """Show the zero as measured and as predicted."""
    rows = [
        [
            plant,
            f"{measured:.0f}",
            f"{PLANTS[plant].zero_rad_s:.0f}",
            f"{1e3 / PLANTS[plant].zero_rad_s:.3f}",
        ]
        for plant, measured in results.zeros_rad_s.items()
    ]
    head = ["set", "zero by simulation (rad/s)", "A / (S δ2) (rad/s)", "S δ2 / A (ms)"]
    return f"""## The zero behind it

While all plays slide, y = A u - S δ2 u̇ - c: raising the rate of the command lowers the output before the command itself raises it. That is a zero in the right half plane: an exact causal inverse is unstable whatever its structure, and no smaller Ts helps.

{table(head, rows)}"""


def best_by_plant(results: PaperResults) -> dict[str, str]:
    """Return the realisable reading with the smallest RMS error on each plant."""
    best: dict[str, Tracking] = {}
    for each in results.implementations:
        known = best.setdefault(each.plant, each.run)
        if each.run.median_rms_error < known.median_rms_error:
            best[each.plant] = each.run
    return {plant: run.reading.name for plant, run in best.items()}


def implementation(results: PaperResults) -> str:
    """Write the section on plants other than the literal model, and on what to use instead."""
    best = best_by_plant(results)
    found = {(each.plant, each.run.reading.name): each.run for each in results.implementations}

    def medians(plant: str, reading: Reading) -> str:
        run = found[plant, reading.name]
        return f"{number(run.median_max_error, 2)} / {number(run.median_rms_error, 2)}"

    rows = by_reading(
        ["reading", *best, "largest jump of u in a sample"],
        (READINGS[name] for name in dict.fromkeys(name for _, name in found)),
        *(partial(medians, plant) for plant in best),
        lambda r: f"{number(found[next(iter(best)), r.name].jump_V, 2)} V",
    )
    winners = "; ".join(f"{plant}: *{reading}*" for plant, reading in best.items())
    cut_offs = joined([f"{limiting_cutoff_hz(m):.0f} Hz for {p}" for p, m in PLANTS.items()])
    sine = SECTION_V
    return f"""## What an implementation meets, and what to use instead

The realisable readings at {sine.frequency_hz:g} Hz, {sine.amplitude_um:g} µm, {1e6 * sine.ts_s:g} µs, median of {results.realisations} realisations, max / RMS (µm). The test bench has the lowest cut-off, a 50 µs converter and a noisy sensor of 10 nm resolution; its error counts between the converter's samples too:

{rows}

Smallest RMS error, by plant: {winners}.

- Where Eq. 6 is wanted, take the rate for its thresholds from the reference (*reference-rate/A*), or low-pass its own rate (*low-passed*; as Ts → 0 that loop is stable only while g < 1 and the cut-off is below A / (2π S δ2): {cut_offs}).
- The classical inverse at the reference's rate over A is no loop and is not a sample late.
- Given thresholds make the claim true on paper only: a plant sets its thresholds by its own rate.
- Where the reference is known ahead, an inverse with preview leaves a smaller error."""


def by_reading(
    head: Sequence[str], readings: Iterable[Reading], *cells: Callable[[Reading], str]
) -> str:
    """Write a table with a row for each reading, its cells computed from the reading."""
    return table(head, ([f"*{r.name}*", *(cell(r) for cell in cells)] for r in readings))


def errors(run: Tracking) -> str:
    """Write largest / RMS error of the exact reference, starred where it is not reproducible."""
    star = "" if run.reproducible else " *"
    return f"{number(run.max_error, 4)} / {number(run.rms_error, 4)}{star}"


def span(values: Array) -> str:
    """Write lowest and highest value."""
    return f"{number(float(values.min()), 2)} to {number(float(values.max()), 2)}"


def claim(verdict: str) -> str:
    """Return whether the claim holds; ``paper.csv`` has the whole verdict."""
    return re.split("[:;]", verdict, maxsplit=1)[0]


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
            claim(results.series_verdict(f"Fig. 3{panel}", reading.name)),
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

(d) to (f), Eq. 6 at each Ts (the captions pair {captions}; the text applies all three to each):

{table(head, rows)}"""


def figure_4(results: PaperResults) -> str:
    """Write the section on Fig. 4."""
    head = ["50 Hz", *(f"4{p}, Ts = {seconds(ts)}" for p, ts in zip("ab", TS_S[:2], strict=True))]
    rows = by_reading(
        [*head, "the claim"],
        INVERSION_FREE,
        lambda r: errors(results.find("Fig. 4a", r.name)),
        lambda r: errors(results.find("Fig. 4b", r.name)),
        lambda r: claim(results.verdict("Fig. 4b", r.name)),
    )
    return f"""## Figure 4: output against reference at 50 Hz

The paper: {Claim.SMALLER_TS_PAIR.value}.

![Figure 4](fig4.png)

{rows}"""


def figure_5(results: PaperResults) -> str:
    """Write the section on Fig. 5."""

    def completeness(panel: str, reading: Reading) -> str:
        run = results.find(f"Fig. 5{panel}", reading.name)
        complete = run.percent <= COMPLETE_PERCENT
        return f"{errors(run)} ({'complete' if complete else f'{number(run.percent, 2)} %'})"

    panels = (f"5{panel}, {hz:g} Hz" for panel, hz in zip("abc", FREQUENCIES_HZ, strict=True))
    rows = by_reading(
        [f"Ts = {seconds(TS_S[-1])}", *panels, "the claim at 50 Hz"],
        INVERSION_FREE,
        *(partial(completeness, panel) for panel in "abc"),
        lambda r: claim(results.verdict("Fig. 5c", r.name)),
    )
    return f"""## Figure 5: output against reference at Ts = {seconds(TS_S[-1])}

The paper: {Claim.COMPLETE.value}, at all three frequencies. Here compensation counts as complete where the largest error is at most {COMPLETE_PERCENT:g} % of the amplitude: what the paper's sensor resolves of its stroke.

![Figure 5](fig5.png)

{rows}"""


def error_against_ts(results: PaperResults) -> str:
    """Write the section on the claim "smaller Ts, smaller error", with the ensembles' statistics."""

    def over_ts(ts_s: float, reading: Reading) -> str:
        return errors(results.find(SWEEP_LABEL, reading.name, section_iii(50.0, ts_s)))

    rows = by_reading(
        ["reading", *(f"Ts = {seconds(ts)}" for ts in TABLE_TS_S), "the claim"],
        READINGS.values(),
        *(partial(over_ts, ts) for ts in TABLE_TS_S),
        lambda r: results.series_verdict(SWEEP_LABEL, r.name),
    )
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

The paper (Section III-A): "y(k) ≅ y_r(k), and ... e(k) → 0", with no condition. 50 Hz, amplitude {section_iii(50.0, TS_S[0]).amplitude_um:g}:

{rows}

![Error against the sampling time](stability.png)

The starred runs as statistics over {results.realisations} realisations. × smooth: the command's largest rate over that with given thresholds.

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

The paper measured {BOUND_UM:g} µm with Eq. 6 at {1e6 * sine.ts_s:g} µs, where Eq. 6 as printed chatters. Either its implementation differs from the print, or actuator and sensor filtered the chatter."""
    )
    return f"""## Figure 8 and Section V: {sine.frequency_hz:g} Hz, {sine.amplitude_um:g} µm, {1e6 * sine.ts_s:g} µs

The paper: {Claim.BOUND.value}, for the proposed (8a) and for the classical compensator (8b), measured on its actuator. Here the identified model is the plant: staying within the bound is necessary, not sufficient.

![Figure 8](fig8.png)

{table(head, rows)}{remark}"""


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
    best = dict.fromkeys(best_by_plant(results).values())
    return f"""# The paper's figures and numbers, recomputed

Aljanaideh, Al Janaideh, Rakotondrabe, "Inversion-free feedforward dynamic compensation of hysteresis nonlinearities in piezoelectric micro/nano-positioning actuators". Written by `rdpi reproduce --seed {results.seed} --realisations {results.realisations}`, which computes every number below.

1. **Eq. 6 as printed: "smaller Ts, smaller error", "e(k) → 0".** {_as_printed(results, sine)}
2. **"No condition".** There is one: the loop of Eq. 6 is stable only while Ts is above {limits}, found by simulation on both sides. The paper's {1e6 * SECTION_V.ts_s:g} µs is {limit_s["P10"] / SECTION_V.ts_s:.1f} times below the latter. {_without_rate(results)}
3. **Where the claim holds.** With {_readings(holds)}, that is with thresholds that are the same function of time in plant and compensator: the error falls like Ts, to {number(left, 2)} % of the amplitude.
4. **Section V, the model as plant.** Largest error without compensation {number(uncompensated.max_error)} µm; Eq. 6 as printed {span(literal.max_error_um)} µm, with command jumps of {number(literal.jump_V, 2)} V from sample to sample; with given thresholds {number(given.max_error, 2)} µm; classical inverse {number(at_reference.max_error, 2)} µm at the rate of y_r and {number(over_gain.max_error, 2)} µm at that rate over A. The paper measured {BOUND_UM:g} µm for both of its methods.
5. **Why, and what to use.** On its own rate Eq. 6 is a loop whose gain g δ2 / Ts grows as Ts falls, and the model has a right-half-plane zero ({joined([f"{z:.0f} rad/s" for z in results.zeros_rad_s.values()])}). A compensator that takes the rate from the reference is no such loop: {_readings(list(best))} had the smallest RMS errors on the plants tried at {SECTION_V.frequency_hz:g} Hz and {1e6 * SECTION_V.ts_s:g} µs."""


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

A star marks a run that is not reproducible: {results.realisations} realisations whose references differ by a relative 1e-12 disagree. The starred number is the realisation of the exact reference; medians and ranges stand under "Error against Ts". `paper.csv` has the whole verdict on every claim. Section III-B prints no threshold law; Eq. 8 is used with its δ1 and δ2."""


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
