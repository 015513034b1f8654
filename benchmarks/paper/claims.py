"""Figures and numbers of the paper as cases to simulate, and the rules for a verdict on each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

import numpy as np

from benchmarks.paper.tracking import READINGS, Reading, Sine, Trace, Tracking
from rdpi_gym.plant import PAPER_III_B, PAPER_IV_B, PAPER_SENSOR
from rdpi_gym.support.words import number

TS_S = (1e-3, 1e-4, 1e-6)
"""Sampling times of Section III-B (s)."""
FREQUENCIES_HZ = (1.0, 25.0, 50.0)
"""Frequencies of Section III-B (Hz)."""
BOUND_UM = 3.0
"""Section V: the error is "bounded within 3 µm"."""
TABLE_TS_S = (1e-3, 1e-4, 1e-5, 1e-6)
LOOP_SAMPLES = 400
"""Section IV-B: data points K of a loop."""

SWEEP_LABEL = "Section III-A, error against Ts"

COMPENSATORS = tuple(r for r in READINGS.values() if r.structure != "none")
INVERSION_FREE = tuple(r for r in COMPENSATORS if r.structure == "inversion-free")


class Claim(Enum):
    """Claim of the paper on a case."""

    LOOP = "the hysteresis loop widens with the frequency"
    SMALLER_TS = "reducing the sampling time improves the compensation: e(k) → 0"
    SMALLER_TS_PAIR = "the output at Ts = 1e-4 s follows the reference better than at 1e-3 s"
    COMPLETE = "complete compensation at Ts = 1e-6 s"
    BOUND = "the error is bounded within 3 µm"


@dataclass(frozen=True)
class Case:
    """One simulation that stands for a panel or a number of the paper."""

    label: str  # figure or section
    claim: Claim  # what the paper says of it
    # what is simulated
    reading: Reading
    sine: Sine
    paper_value: float | None = None  # the number in the paper's text, where it has one


def section_iii(frequency_hz: float, ts_s: float) -> Sine:
    """Return the reference of Section III-B: amplitude 10 on the five-play model."""
    return Sine("P5", PAPER_III_B, 10.0, frequency_hz, ts_s)


SECTION_V = Sine("P10", PAPER_IV_B, 40.0, 80.0, 5e-5)
"""Reference of Section V: 40 µm, 80 Hz, 50 µs."""

# Fig. 7 prints no drive; its loops are those of a 40 V sine, K = 400 samples each.
FIG_7 = tuple(Sine("P10", PAPER_IV_B, 40.0, hz, 1.0 / (LOOP_SAMPLES * hz)) for hz in (10.0, 100.0))

SWEEP = tuple(
    section_iii(50.0, 1.0 / (50.0 * m)) for m in np.rint(np.geomspace(20, 20_000, 22)).tolist()
)
"""Sampling times between those of the paper, 50 Hz."""


def paper_cases() -> tuple[Case, ...]:
    """Return every simulated case, in the order of the paper."""
    none = (READINGS["none"],)
    fine = TS_S[-1]
    # label, claim, readings, references
    panels: list[tuple[str, Claim, Sequence[Reading], Sequence[Sine]]] = [
        *(
            (f"Fig. 3{panel}", Claim.LOOP, none, [section_iii(hz, TS_S[0])])
            for panel, hz in zip("abc", FREQUENCIES_HZ, strict=True)
        ),
        *(
            (
                f"Fig. 3{panel}",
                Claim.SMALLER_TS,
                INVERSION_FREE,
                [section_iii(hz, ts) for ts in TS_S],
            )
            for panel, hz in zip("def", FREQUENCIES_HZ, strict=True)
        ),
        *(
            (f"Fig. 4{panel}", Claim.SMALLER_TS_PAIR, (reading,), [section_iii(50.0, ts_s)])
            for reading in INVERSION_FREE
            for panel, ts_s in zip("ab", TS_S[:2], strict=True)
        ),
        *(
            (f"Fig. 5{panel}", Claim.COMPLETE, INVERSION_FREE, [section_iii(hz, fine)])
            for panel, hz in zip("abc", FREQUENCIES_HZ, strict=True)
        ),
        (
            SWEEP_LABEL,
            Claim.SMALLER_TS,
            tuple(READINGS.values()),
            [section_iii(50.0, ts_s) for ts_s in TABLE_TS_S],
        ),
        ("Fig. 7", Claim.LOOP, none, FIG_7),
        ("Section V, no compensation", Claim.BOUND, none, [SECTION_V]),
    ]
    cases = [
        Case(label, claim, reading, sine)
        for label, claim, readings, sines in panels
        for reading in readings
        for sine in sines
    ]
    panel_of = {"inversion-free": "Fig. 8a", "closed-form": "Fig. 8b"}
    bounds = (
        Case(panel_of[reading.structure], Claim.BOUND, reading, SECTION_V, BOUND_UM)
        for reading in COMPENSATORS
    )
    return (*cases, *bounds)


COMPLETE_PERCENT = 100.0 * PAPER_SENSOR.resolution_um / SECTION_V.amplitude_um
"""Compensation is called complete where the paper's sensor could not see the error (%)."""
_EXACT_PERCENT = 1e-9
_LINEAR = 0.9
"""From this order in Ts on an error is said to fall like Ts."""
_FLAT = 0.3
"""Below this order an error is said to level off."""


def order(coarse: Tracking, fine: Tracking) -> tuple[float, float]:
    """Order p of error ~ Ts^p between two sampling times: of the maximum and of the RMS."""
    step = math.log(coarse.sine.ts_s / fine.sine.ts_s)
    return (
        math.log(coarse.median_max_error / fine.median_max_error) / step,
        math.log(coarse.median_rms_error / fine.median_rms_error) / step,
    )


def loop_opening_percent(trace: Trace) -> float:
    """Opening of a loop at u = 0, in percent of the stroke; the trace begins there, rising."""
    half = len(trace.y) // 2
    return float(100.0 * abs(trace.y[half] - trace.y[0]) / np.ptp(trace.y))


def falls(series: Sequence[Tracking]) -> bool:
    """Whether largest and RMS error are smaller at each sampling time than at the one before."""
    return all(
        fine.median_max_error < coarse.median_max_error
        and fine.median_rms_error < coarse.median_rms_error
        for coarse, fine in pairwise(series)
    )


def judge_series(series: Sequence[Tracking]) -> str:
    """Judge "smaller Ts, smaller error" and "e(k) → 0" on all sampling times of one reading.

    What the error tends to is judged by the two smallest.
    """
    coarse, fine = series[-2:]
    left = f"{fine.percent:.2g} % of the amplitude"
    if fine.reading.structure == "none":
        return f"no compensation: {left}"
    if fine.percent < _EXACT_PERCENT:
        return "exact to rounding at every Ts"
    p_max, p_rms = order(coarse, fine)
    if min(p_max, p_rms) >= _LINEAR:
        return "holds: error falls like Ts"
    if fine.reading.structure != "inversion-free":
        head = "not exact: "
    elif falls(series):
        head = "holds in part: both errors fall at each Ts, but not to zero; "
    else:
        head = "does not hold: "
    if not fine.reproducible:
        fall = "√Ts" if abs(p_rms - 0.5) < 0.1 else f"Ts^{p_rms:.2f}"
        end = "stays at" if p_max < _FLAT else "falls only to"
        return f"{head}chatters, RMS error falls like {fall}, the largest error {end} {left}"
    if p_max < _FLAT:
        return f"{head}error levels off at {left}"
    return f"{head}error falls only like Ts^{p_max:.2f}"


def judge_step(series: Sequence[Tracking], run: Tracking) -> str:
    """Judge one sampling time of a series by the next larger one."""
    if run.reading.structure == "none":
        return f"no compensation: {run.percent:.2g} % of the amplitude"
    if run.percent < _EXACT_PERCENT:
        return "exact to rounding"
    at = series.index(run)
    if at == 0:
        return f"the largest Ts: {run.percent:.2g} % of the amplitude, nothing to compare it with"
    before = series[at - 1]
    ratios = {
        "largest error": before.median_max_error / run.median_max_error,
        "RMS error": before.median_rms_error / run.median_rms_error,
    }
    fell = sum(ratio > 1.0 for ratio in ratios.values())
    head = ("does not hold", "holds in part", "holds")[fell]
    changes = " and ".join(
        f"{name} {number(max(ratio, 1.0 / ratio), 3, 'never')} times "
        f"{'smaller' if ratio > 1.0 else 'larger'}"
        for name, ratio in ratios.items()
    )
    return f"{head}: {changes} than at {before.sine.ts_s:g} s"


def judge_complete(run: Tracking) -> str:
    """Judge Fig. 5: whether anything is left that the paper's sensor could see."""
    left = f"{run.percent:.2g} % of the amplitude left"
    if run.percent <= COMPLETE_PERCENT:
        return f"holds: {left}"
    return f"does not hold: {left}" + ("" if run.reproducible else ", chatters")


def judge_bound(run: Tracking) -> str:
    """Judge Fig. 8: whether every realisation stays within 3 µm, with the model as the plant."""
    low, high = float(run.max_error_um.min()), float(run.max_error_um.max())
    if run.reading.structure == "none":
        return f"no compensation: {high:.3g} µm"
    if high <= BOUND_UM:
        return f"holds: within {BOUND_UM:g} µm, the model as plant"
    return (
        f"does not hold: {low:.2g} to {high:.2g} µm, command jumps by {run.jump_V:.2g} V a sample"
    )


def judge_loop(slow: Tracking, run: Tracking) -> str:
    """Judge Fig. 3a to 3c and Fig. 7: the loop against the one at the lowest frequency."""
    assert slow.trace is not None
    assert run.trace is not None
    opening, rest = loop_opening_percent(run.trace), loop_opening_percent(slow.trace)
    opens = f"loop opens {opening:.3g} % of the stroke"
    if run is slow:
        return opens
    sense = "holds" if opening > rest else "does not hold"
    return f"{sense}: {opens}, {rest:.3g} % at {slow.sine.frequency_hz:g} Hz"


def judge(claim: Claim, series: Sequence[Tracking], run: Tracking) -> str:
    """Judge one case, and note the side of its stability limit where the run has one."""
    if claim is Claim.LOOP:
        return judge_loop(series[0], run)
    if claim is Claim.COMPLETE:
        return judge_complete(run)
    verdict = judge_bound(run) if claim is Claim.BOUND else judge_step(series, run)
    limit_s = run.reading.stable_from_ts_s(run.sine.hysteresis)
    if limit_s == 0.0:
        return verdict
    side = "above" if run.sine.ts_s > limit_s else "below"
    return f"{verdict}; this Ts is {side} the limit of {1e3 * limit_s:.3f} ms"
