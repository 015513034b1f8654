"""From rows to judgements: was the hidden effect named, was anything else, what is left."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd

from rdpi_gym.support.store import Row

CONFOUNDED: frozenset[frozenset[str]] = frozenset()
"""Pairs that the documentation names as confounded on the standard protocol: one of the two counts
as the other where the result calls them indistinguishable."""

LARGEST_RATIO = 1.15
"""Of the validation error to the noise, for a case that counts as explained."""


def judge(row: Row, confounded: frozenset[frozenset[str]] = CONFOUNDED) -> dict[str, Any]:
    """Judge one row."""
    subject: list[str] = row["subject"]
    ranking, steps = row.get("ranking", []), row.get("steps", [])
    exact = bool(ranking) and ranking[0]["effect"] in subject
    by_class = bool(ranking) and not exact and _stands_for(ranking[0], subject, confounded) != ""
    missing, additions = list(subject), 0
    for step in sorted(steps, key=lambda step: step["effect"] not in subject):
        name = (
            step["effect"] if step["effect"] in missing else _stands_for(step, missing, confounded)
        )
        if name:
            missing.remove(name)
        else:
            additions += 1
    ratio = row["validation_um"] / row["noise_um"] if row["status"] == "done" else float("nan")
    return {
        "study": row["study"],
        "subject": "+".join(subject) or "nothing",
        "number": row["number"],
        "seed": row["seed"],
        "variant": row["variant"],
        "status": row["status"],
        "noise_um": row.get("noise_um"),
        "first": ranking[0]["effect"] if ranking else "",
        "first_right": exact or by_class,
        "by_class": by_class,
        "found": row["status"] == "done" and not missing,
        "additions": additions,
        "ratio": ratio,
        "within": ratio <= LARGEST_RATIO,
        "verdict": row.get("verdict", ""),
        "steps": "+".join(step["effect"] for step in steps),
        "seconds": row.get("seconds"),
    }


def _stands_for(
    finding: dict[str, Any], subject: Sequence[str], confounded: frozenset[frozenset[str]]
) -> str:
    """Return the effect of the subject that a finding is confounded with, empty if none."""
    for name in subject:
        is_pair = frozenset({name, finding["effect"]}) in confounded
        if is_pair and name in finding["indistinguishable"]:
            return name
    return ""


def judgements(
    rows: Sequence[Row], confounded: frozenset[frozenset[str]] = CONFOUNDED
) -> pd.DataFrame:
    """Judge all rows but the masked ones: a line each, with the keys of :func:`judge`."""
    return pd.DataFrame([judge(row, confounded) for row in rows if row["status"] != "masked"])
