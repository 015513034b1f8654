"""Tables of scores in words: where agents stand beside compensators, and whether they dither."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from rdpi_gym.support.words import number

ROUGH = 1.5
"""Command variation over that of the best causal compensator from which on a command is rough."""
UNSTABLE_PERCENT = 100.0
"""A tracking error (% of peak to peak) above which a loop is called unstable."""
_VERDICTS = {
    "ahead": "ahead of every causal compensator",
    "behind": "behind the best compensator",
    "level": "not to be told from the best compensator",
}


def _kind(part: pd.DataFrame, kind: str) -> pd.DataFrame:
    return part[part["kind"] == kind].sort_values("rmse_percent")


def groups_view(groups: pd.DataFrame) -> pd.DataFrame:
    """Return one line a group of plants: the best compensators, and every agent; RMSE (%)."""
    agents = list(groups.loc[groups["kind"] == "agent", "contestant"].sort_values().unique())
    lines = []
    for world, part in groups.groupby("world", sort=False):
        line = {
            "plants": world,
            "best feedforward": _best(part, "feedforward"),
            "best with feedback": _best(part, "feedback"),
            "with feedback, unstable": f"{unstable(part)} of {len(_kind(part, 'feedback'))}",
        }
        errors = part.set_index("contestant")["rmse_percent"]
        lines.append(line | {name: _percent(errors[name]) for name in agents})
    return pd.DataFrame(lines)


def _best(part: pd.DataFrame, kind: str) -> str:
    for own in _kind(part, kind).to_dict("records"):
        return f"{own['contestant']}: {_percent(own['rmse_percent'])}"
    return "–"


def unstable(part: pd.DataFrame) -> int:
    """Return how many controllers with feedback do not track in a group, or fail there."""
    return int((_kind(part, "feedback")["rmse_percent"] > UNSTABLE_PERCENT).sum())


def best_kind(part: pd.DataFrame) -> str:
    """Return whether the best causal compensator of a group has feedback."""
    return str(part.loc[part["contestant"] == part["best"], "kind"].iloc[0])


def _percent(value: float) -> str:
    return number(value) if np.isfinite(value) else "failed"


def leaders(groups: pd.DataFrame) -> Iterator[tuple[str, pd.Series]]:
    """Yield the row of the best agent of each group."""
    for world, part in groups.groupby("world", sort=False):
        yield str(world), _kind(part, "agent").iloc[0]


def _ranged(row: pd.Series, name: str) -> str:
    value, low, high = (row[f"{name}{end}"] for end in ("", "_low", "_high"))
    if not np.isfinite(value):
        return "failed"
    return f"{number(value)} ({number(low)} to {number(high)})"


def verdict(leader: pd.Series) -> str:
    """Say on which side of 1 the interval of the ratio to the best compensator lies."""
    if leader["rmse_ratio_high"] < 1.0:
        return "ahead"
    return "behind" if leader["rmse_ratio_low"] > 1.0 else "level"


def standing(groups: pd.DataFrame) -> str:
    """Say group by group how the best agent compares with the best compensator."""
    lines = []
    for world, leader in leaders(groups):
        lines.append(
            f"- **{world}**: {_VERDICTS[verdict(leader)]}. `{leader['contestant']}` has {_ranged(leader, 'rmse_ratio')} "
            f"times the error of `{leader['best']}`, at {_ranged(leader, 'variation_ratio')} times its "
            "command variation."
        )
    return "\n".join(lines)


def gap_view(gap: pd.DataFrame) -> pd.DataFrame:
    """Return the agents of each domain below its best compensator."""
    parts = []
    for _, part in gap.groupby("domain", sort=False):
        causal = part[part["kind"].isin(("feedforward", "feedback"))].sort_values("rmse_percent")
        parts += [causal.head(1), _kind(part, "agent")]
    shown = pd.concat(parts)
    return pd.DataFrame(
        {
            "domain": shown["domain"],
            "controller": shown["contestant"],
            "RMSE (%)": shown["rmse_percent"].map(_percent),
            "literal over low-passed": shown["literal_ratio"],
            "command variation": shown["variation_ratio"],
            "literal: command variation": shown["literal_variation_ratio"],
        }
    )


def dither(gap: pd.DataFrame) -> str:
    """Say domain by domain whether the agents' commands dither, or exploit the literal rate."""
    lines = []
    for domain, part in gap.groupby("domain", sort=False):
        agents = part[part["kind"] == "agent"]
        rough = agents.loc[agents["variation_ratio"] > ROUGH, "contestant"]
        verdict = "smooth, all of them"
        if len(rough):
            names = ", ".join(f"`{name}`" for name in rough)
            verdict = f"above {ROUGH:g} are {names}: they dither, or pass noise on"
        lines.append(
            f"- **{domain}**: command variation {_span(agents['variation_ratio'])} times that of the best "
            f"compensator, {verdict}. Error on the literal plants {_span(agents['literal_ratio'])} times that "
            "on the low-passed ones."
        )
    smooth = gap[
        gap["kind"].isin(("feedforward", "feedback")) & (gap["rmse_percent"] < UNSTABLE_PERCENT)
    ]
    lines.append(
        f"- Of the compensators that track (RMSE below {UNSTABLE_PERCENT:g} %), over all domains: error on the "
        f"literal plants {_span(smooth['literal_ratio'])} times that on the low-passed ones."
    )
    return "\n".join(lines)


def _span(values: pd.Series) -> str:
    return f"{number(values.min())} to {number(values.max())}"


def times_between(shipped: pd.DataFrame, algorithm: str, other: str) -> str:
    """Return by how much the median policies of an algorithm leave more than those of another."""
    own = shipped.set_index("agent")["rmse_percent"]
    ways = [name.partition("-")[2] for name in own.index if name.startswith(f"{algorithm}-")]
    ratios = sorted(own[f"{algorithm}-{way}"] / own[f"{other}-{way}"] for way in ways)
    return " and ".join(f"{ratio:.2g}" for ratio in ratios)


def shipped_view(shipped: pd.DataFrame) -> pd.DataFrame:
    """Return the median policies, and which of them ship, with the headings that a reader sees."""
    both = zip(shipped["best_percent"], shipped["worst_percent"], strict=True)
    return pd.DataFrame(
        {
            "policy": shipped["agent"],
            "seed": shipped["seed"],
            "RMSE (%)": shipped["rmse_percent"],
            "trainings": shipped["trainings"],
            "best to worst of them (%)": [
                f"{number(best)} to {_percent(worst)}" for best, worst in both
            ],
            "ships": [f"{b:,} bytes" if b else "no" for b in shipped["policy_bytes"]],
        }
    )
