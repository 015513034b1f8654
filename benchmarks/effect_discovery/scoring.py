"""Scoring of rows: effects named, effects added, and whether statements on the residual are true."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from benchmarks.effect_discovery.forms import TIMED
from rdpi_gym.support.store import Row

LARGEST_RATIO = 1.15
"""Largest ratio of the validation error to the noise of a case that counts as explained."""
MARGIN = 0.1
"""By which the true share may lie outside of the interval."""
EXPLAINED = 1.3
"""Noise floors of clean error that an explained record may have left."""
_NOTHING = 0.5  # noise floors: of less no share is asked
_SAMPLED = 0.5  # noise floors that lie between the samples: from here on sampling matters
_OF_TRUTH = 2.0  # largest ratio of a numerical floor that is believed
_FEW_SAMPLES = 4.0  # of the shortest time of what is hidden: with fewer, sampling matters
_TIMES = ("time_constant_s", "delay_s")
# Kinds of findings that say what was done to a record.
_NOTICED_AS: Mapping[str, tuple[str, ...]] = {
    "spikes": ("spikes",),
    "dropouts": ("dropout", "frozen"),
    "clipped output": ("clipped output",),
    "clipped input": ("clipped input",),
    "one sample apart": ("clock",),
    "clock skew": ("clock",),
}


def _between_samples(truth: Mapping[str, Any]) -> str:
    if "sampling_um" not in truth:
        return ""
    floors = truth["sampling_um"] / truth["noise_um"]
    return "below half" if floors < 0.5 else "half to twice" if floors < 2.0 else "above twice"


_UNKNOWN_PAST = "history that nobody recorded"


def judge(row: Row) -> dict[str, Any]:
    """Judge one row.

    A name counts as right where it is hidden, and ``by class`` where the records of the case cannot
    tell it from what is hidden (``alike`` of the truth). A name that the case excuses (a memory that
    was there, a delay where u and y are apart) is neither right nor wrong.
    """
    truth: Mapping[str, Any] = row.get("truth", {})
    is_outside = row["study"] == "outside" or bool(truth.get("outside"))
    subject: list[str] = [] if is_outside else row["subject"]
    alike, excused = truth.get("alike", {}), truth.get("excused", [])
    ranking = [c["effect"] for c in row.get("ranking", []) if c["effect"] not in excused]
    steps = [c["effect"] for c in row.get("steps", [])]
    done = row["status"] == "done"
    findings = {finding["kind"] for finding in row.get("findings") or ()}
    first = ranking[0] if ranking else ""
    # what the records begin with is unknown: said as a finding, it is that effect by class
    if "in motion" in findings and "initial_memory" in subject and "initial_memory" not in steps:
        steps = [*steps, _UNKNOWN_PAST]
        alike = alike | {"initial_memory": [*alike.get("initial_memory", ()), _UNKNOWN_PAST]}
        first = first if len(steps) > 1 else _UNKNOWN_PAST
    exact = first in subject
    missing, by_class, additions = list(subject), 0, 0
    for name in sorted(steps, key=lambda name: name not in subject):
        stands_for = [s for s in missing if name in alike.get(s, [])]
        if name in missing:
            missing.remove(name)
        elif stands_for:
            missing.remove(stands_for[0])
            by_class += 1
        elif name not in excused:
            additions += 1
    first_by_class = not exact and any(first in alike.get(s, []) for s in subject)
    ratio = row["validation_um"] / row["noise_um"] if done else math.nan
    judged = {
        "study": row["study"],
        "subject": "+".join(row["subject"]) or "nothing",
        "form": "+".join(hidden["form"] for hidden in truth.get("hidden", []) if "form" in hidden),
        "number": row["number"],
        "seed": row["seed"],
        "variant": row.get("variant", ""),
        "status": row["status"],
        "protocol": truth.get("protocol", ""),
        "degraded": truth.get("degraded", "") or "none",
        "noise_um": row.get("noise_um"),
        "between_samples": _between_samples(truth),
        "findings": "+".join(sorted(findings)),
        "noticed": bool(findings & set(_NOTICED_AS.get(truth.get("degraded", ""), ()))),
        "first": first,
        "first_exact": exact,
        "first_by_class": first_by_class,
        "first_right": exact or first_by_class,
        "found_exact": done and not missing and not by_class,
        "found_by_class": done and not missing and by_class > 0,
        "found": done and not missing and not is_outside,
        "additions": additions,
        "steps": "+".join(steps),
        "verdict": row.get("verdict", ""),
        "ratio": ratio,
        "within": ratio <= LARGEST_RATIO,
        "seconds": row.get("seconds"),
    }
    if done and "true_left" in row:
        return judged | judge_statements(row)
    return judged | {"all_true": None}


def judgements(rows: Sequence[Row]) -> pd.DataFrame:
    """Judge all rows but the masked ones: a line each, with the keys of :func:`judge`."""
    return pd.DataFrame([judge(row) for row in rows if row["status"] != "masked"])


def judge_statements(row: Mapping[str, Any]) -> dict[str, Any]:
    """Judge the statements of a result on its residual."""
    truth, true_left = row["truth"], row["true_left"]
    noise = truth["noise_um"]
    # what is stated counts as far as the truth itself moves with what lies between the samples
    floor = min(row.get("numerical_floor_um") or 0.0, _OF_TRUTH * truth["sampling_um"])
    clean = math.nan if true_left["clean_um"] is None else true_left["clean_um"]
    part = math.nan if true_left["by_input_um"] is None else true_left["by_input_um"]
    share = _share(clean, part, floor) if clean > math.hypot(_NOTHING * noise, floor) else None
    left = row.get("left") or {}
    share_true = hidden_true = explained_true = sampling_true = None
    if share is not None and left.get("low") is not None and left.get("high") is not None:
        share_true = bool(left["low"] - MARGIN <= share <= left["high"] + MARGIN)
    if share is not None and left.get("hidden_um") is not None:
        most = (1.0 + MARGIN) * math.hypot(left["hidden_um"], floor, _NOTHING * noise)
        hidden_true = bool(part <= most)
    if row["verdict"] in ("explained", "no missing effect") and not math.isnan(clean):
        explained_true = bool(clean <= EXPLAINED * math.hypot(noise, floor))
    if row.get("sampling"):
        sampling_true = sampling_matters(truth)
    said = [x for x in (share_true, hidden_true, explained_true, sampling_true) if x is not None]
    return {
        "clean_ratio": clean / noise,
        "true_share": share,
        "share_true": share_true,
        "hidden_true": hidden_true,
        "explained_true": explained_true,
        "sampling_true": sampling_true,
        "all_true": all(said),
    }


def _share(clean_um: float, by_input_um: float, floor_um: float) -> float:
    beyond = max(by_input_um**2 - floor_um**2, 0.0)
    return min(beyond / max(clean_um**2 - floor_um**2, 1e-300), 1.0)


def sampling_matters(truth: Mapping[str, Any]) -> bool:
    """Whether faster sampling would show more.

    Either the motion between the samples moves the displacement at them by half a noise floor, or
    something that is hidden has a time of fewer than four samples, or a mode above a fifteenth of
    the rate.
    """
    if truth["sampling_um"] > _SAMPLED * truth["noise_um"]:
        return True
    slowest = min(truth["rates_hz"])
    for effect in truth["hidden"]:
        times = [effect[key] for key in _TIMES if key in effect and effect["effect"] not in TIMED]
        if any(time * slowest < _FEW_SAMPLES for time in times):
            return True
        if effect.get("f0_hz", 0.0) > slowest / 15.0:
            return True
    return False
