"""Sections on why the claims fail, and on what to use; numbers and tables as the page writes them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from baselines.feedforward import limiting_cutoff_hz
from benchmarks.paper.cases import SECTION_V, SWEEP_LABEL
from benchmarks.paper.run import DIVERGENCE_TS_S, PLANTS, PaperResults
from benchmarks.paper.stability import MARGIN, SLIDE_V_S
from benchmarks.paper.variants import Implementation, identified_g
from rdpi_gym.support import markdown, words
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

Above g = 1 the error still falls with Ts, since a spike is no higher than a few of the command's own steps, but the command has spikes at every Ts."""


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

The classical inverse exists while the gaps between thresholds do not shrink with time. Under Eq. 8 the rate enters every threshold alike, so the gaps are constant and the inverse always exists: with the same thresholds in plant and compensator it is exact to rounding. For this threshold law, then, the absence of a condition is no advantage of Eq. 6, and Eq. 6 as printed has one of its own. The difficulty that both share is to know the rate of u before u.

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

While all plays slide, y = A u - S δ2 u̇ - c: raising the rate of the command lowers the output before the command itself raises it. That is a zero in the right half plane, so an exact causal inverse is unstable whatever its structure, and no smaller Ts helps. At the paper's {1e6 * SECTION_V.ts_s:g} µs the exact sample-by-sample solution of Eq. 3 for u(k) is not even unique: that takes Ts above S δ2 / A.

{table(head, rows)}"""


def best_by_plant(results: PaperResults) -> dict[str, Implementation]:
    """Return the realisable reading with the smallest RMS error on each plant."""
    plants = dict.fromkeys(x.plant for x in results.implementations)
    return {
        plant: min(
            (x for x in results.implementations if x.plant == plant),
            key=lambda x: x.run.median_rms_error,
        )
        for plant in plants
    }


def implementation(results: PaperResults) -> str:
    """Write the section on plants other than the literal model, and on what to use instead."""
    best = best_by_plant(results)
    found = {(x.plant, x.run.reading.name): x.run for x in results.implementations}
    rows = [
        [
            f"*{reading}*",
            *(
                f"{number(run.median_max_error, 2)} / {number(run.median_rms_error, 2)}"
                for run in (found[plant, reading] for plant in best)
            ),
            f"{number(found[next(iter(best)), reading].jump_V, 2)} V",
        ]
        for reading in dict.fromkeys(name for _, name in found)
    ]
    winners = "; ".join(f"{plant}: *{x.run.reading.name}*" for plant, x in best.items())
    cut_offs = joined([f"{limiting_cutoff_hz(m):.0f} Hz for {p}" for p, m in PLANTS.items()])
    sine = SECTION_V
    return f"""## What an implementation meets, and what to use instead

A plant does not follow the rate of Eq. 5 to any frequency, the converter holds its output, the sensor rounds and is noisy. The realisable readings at {sine.frequency_hz:g} Hz, {sine.amplitude_um:g} µm, {1e6 * sine.ts_s:g} µs, median of {results.realisations} realisations, max / RMS (µm). The test bench is the plant with the lowest cut-off behind a 50 µs converter, seen by a sensor of 10 nm resolution with noise; its error is taken against the reference between the converter's samples too, so that it holds the converter's half sample of delay:

{table(["reading", *best, "largest jump of u in a sample"], rows)}

Smallest RMS error, by plant: {winners}.

- Where Eq. 6 is wanted, take the rate for its thresholds from the reference (*reference-rate/A*), or low-pass its own rate (*low-passed*; as Ts → 0 that loop is stable only while g < 1 and the cut-off is below A / (2π S δ2): {cut_offs}).
- The classical inverse at the reference's rate over A is no loop, meets no condition under Eq. 8, and is not a sample late.
- Given thresholds make the claim true on paper only: a plant sets its thresholds by its own rate.
- The zero bars an exact causal inverse. Where the reference is known ahead, an inverse with preview is the way to a smaller error."""
