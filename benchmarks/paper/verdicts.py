"""Rules that turn figures into verdicts on the paper's claims."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from benchmarks.paper.cases import BOUND_UM, SECTION_V, Claim
from benchmarks.paper.stability import Limit, StaticRun
from benchmarks.paper.tracking import Trace, Tracking
from rdpi_gym.plant import PAPER_SENSOR
from rdpi_gym.support.words import number

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
    said = " and ".join(f"{name} {_change(ratio)}" for name, ratio in ratios.items())
    return f"{head}: {said} than at {before.sine.ts_s:g} s"


def _change(ratio: float) -> str:
    if ratio > 1.0:
        return f"{number(ratio, 3, 'never')} times smaller"
    return f"{number(1.0 / ratio, 3, 'never')} times larger"


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


def judge_limit(limit: Limit) -> tuple[str, str]:
    """Judge "no condition" by both sides of a stability limit: above, below."""
    agrees = abs(limit.found_s / limit.predicted_s - 1.0) < 1e-3
    source = f"limit {1e3 * limit.found_s:.3f} ms" + (", as predicted" if agrees else "")
    verdicts = []
    for side in (limit.above, limit.below):
        decays = side.growth < 1.0
        calm = side.ripple_um < 1e-6
        if decays and calm:
            verdicts.append(f"stable: disturbance shrinks {side.growth:.4f} a sample; {source}")
        else:
            verdicts.append(
                f"a condition: disturbance grows {side.growth:.4f} a sample, error ripples by "
                f"{side.ripple_um:.2g}; {source}"
            )
    return verdicts[0], verdicts[1]


def judge_static(static: StaticRun) -> str:
    """Judge "no condition" on a plant without a rate: whether the loop of Eq. 6 alone decays."""
    rate = f"command {static.spikes:.3g} times as fast as the exact inverse's"
    if static.growth < 1.0:
        return f"stable: g = {static.g:.3g} is below 1; {rate}"
    return f"a condition: g = {static.g:.3g} is above 1; {rate}"


def note_limit(run: Tracking) -> str:
    """Say on which side of its stability limit a run was, where it has one."""
    limit_s = run.reading.stable_from_ts_s(run.sine.hysteresis)
    if limit_s == 0.0:
        return ""
    side = "above" if run.sine.ts_s > limit_s else "below"
    return f"; this Ts is {side} the limit of {1e3 * limit_s:.3f} ms"


def judge(claim: Claim, series: Sequence[Tracking], run: Tracking) -> str:
    """Judge one case."""
    match claim:
        case Claim.LOOP:
            return judge_loop(series[0], run)
        case Claim.SMALLER_TS | Claim.SMALLER_TS_PAIR:
            return judge_step(series, run) + note_limit(run)
        case Claim.COMPLETE:
            return judge_complete(run)
        case Claim.BOUND:
            return judge_bound(run) + note_limit(run)
