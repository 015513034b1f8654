"""paper.md: the paper's figures and numbers beside ours, written from the results."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.paper.cases import BOUND_UM, INVERSION_FREE, SECTION_V, SWEEP_LABEL, section_iii
from benchmarks.paper.markdown import number, seconds, table
from benchmarks.paper.readings import READINGS
from benchmarks.paper.run import PLANTS, SECTIONS, PaperResults
from benchmarks.paper.text_figures import (
    claim,
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
from rdpi_gym.support.words import joined


def paper_markdown(results: PaperResults) -> str:
    """Write the page.

    Parameters
    ----------
    results
        All cases of :func:`benchmarks.paper.cases.paper_cases`, run.

    Returns
    -------
    str
        Markdown; the figures are named as :mod:`rdpi_gym.report.paper.figures` writes them.
    """
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
    as_printed = claim(results.verdict(SWEEP_LABEL, "literal", sine))
    holds = [
        reading.name
        for reading in INVERSION_FREE
        if results.verdict(SWEEP_LABEL, reading.name).startswith("holds")
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
    return f"""# The paper's figures and numbers, recomputed

Aljanaideh, Al Janaideh, Rakotondrabe, "Inversion-free feedforward dynamic compensation of hysteresis nonlinearities in piezoelectric micro/nano-positioning actuators". Written by `rdpi reproduce --seed {results.seed} --realisations {results.realisations}`, which computes every number below.

1. **Eq. 6 as printed: "smaller Ts, smaller error".** {as_printed[:1].upper()}{as_printed[1:]} (50 Hz, Ts down to {seconds(smallest)}).
2. **"No condition".** There is one: the loop of Eq. 6 is stable only while Ts is above {limits}, found by simulation on both sides. The paper's {1e6 * SECTION_V.ts_s:g} µs is {limit_s["P10"] / SECTION_V.ts_s:.1f} times below the latter.
3. **Where the claim holds.** With {_readings(holds)}, that is with thresholds that are the same function of time in plant and compensator: the error falls like Ts, to {number(left, 2)} % of the amplitude.
4. **Section V, the model as plant.** Largest error without compensation {number(uncompensated.max_error)} µm; Eq. 6 as printed {span(literal.max_error_um)} µm, with command jumps of {number(literal.jump_V, 2)} V from sample to sample; with given thresholds {number(given.max_error, 2)} µm; classical inverse {number(at_reference.max_error, 2)} µm at the rate of y_r and {number(over_gain.max_error, 2)} µm at that rate over A. The paper measured {BOUND_UM:g} µm for both of its methods.
5. **Why, and what to use.** On its own rate Eq. 6 is a loop whose gain g δ2 / Ts grows as Ts falls, and the model has a right-half-plane zero ({joined([f"{z:.0f} rad/s" for z in results.zeros_rad_s.values()])}). A compensator that takes the rate from the reference is no such loop: {_readings(list(best))} had the smallest errors on the plants tried."""


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
