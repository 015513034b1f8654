"""From rows to judgements: which name came first, what was added, what is truly left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from benchmarks.foreign_effects.sentences import judge_sentences
from rdpi_gym.support.store import Row

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
    if not truth:
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
    subject: list[str] = row["subject"] if row["study"] != "outside" else []
    truth: Mapping[str, Any] = row.get("truth", {})
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
    judged = {
        "study": row["study"],
        "subject": "+".join(row["subject"]) or "nothing",
        "form": "+".join(hidden["form"] for hidden in truth.get("hidden", []) if "form" in hidden),
        "number": row["number"],
        "seed": row["seed"],
        "status": row["status"],
        "protocol": truth.get("protocol", ""),
        "degraded": truth.get("degraded", "") or "none",
        "noise_um": row.get("noise_um"),
        "between_samples": _between_samples(truth),
        "findings": "+".join(sorted(findings)),
        "noticed": bool(findings & set(_NOTICED_AS.get(truth.get("degraded", ""), ()))),
        "first": first,
        "first_exact": exact,
        "first_by_class": not exact and any(first in alike.get(s, []) for s in subject),
        "found_exact": done and not missing and not by_class,
        "found_by_class": done and not missing and by_class > 0,
        "additions": additions,
        "steps": "+".join(steps),
        "verdict": row.get("verdict", ""),
        "ratio": row["validation_um"] / row["noise_um"] if done else float("nan"),
        "seconds": row.get("seconds"),
    }
    return judged | (judge_sentences(row) if done else {"all_true": None})


def judgements(rows: Sequence[Row]) -> pd.DataFrame:
    """Judge all rows but the masked ones: a line each, with the keys of :func:`judge`."""
    return pd.DataFrame([judge(row) for row in rows if row["status"] != "masked"])
