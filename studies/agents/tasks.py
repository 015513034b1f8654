"""Where the policies that ship stand on the registered tasks, beside controllers without learning."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from baselines import GUARDED, LEARNED
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import joined, number

TABLE = Path(__file__).parents[1] / "results" / "stages" / "tasks.csv"
"""The ranking of every task, as ``rdpi bench --full`` leaves it."""
_MISSING = {
    "learned": f"no {LEARNED} policy",
    "guarded": f"no {GUARDED} policy",
    "other": "no controller without learning",
}
_FIGURES = ["failed", "p90_percent", "iqm_percent"]


def read_rankings(path: Path = TABLE) -> pd.DataFrame:
    """Return the rivals of every task, in the order of their ranks: what was shown the preview alone, without the bound."""
    if not path.exists():
        raise InputError(f"{path} is missing; run rdpi bench --full")
    table = pd.read_csv(path)
    return table[(table["sees"] == "preview") & (table["rank"] != "bound")]


def leaders(rankings: pd.DataFrame) -> pd.DataFrame:
    """Return a line for each task: the best policy, the best with a monitor, the best without learning."""
    lines = []
    for task, part in rankings.groupby("task", sort=False):
        names = part["controller"]
        learned, guarded = names.str.startswith(LEARNED), names.str.startswith(GUARDED)
        line: dict[str, Any] = {"task": task}
        for role, rows in (
            ("learned", part[learned]),
            ("guarded", part[guarded]),
            ("other", part[~learned & ~guarded]),
        ):
            if rows.empty:
                raise InputError(f"{task} has {_MISSING[role]}; score those that ship, too")
            first: dict[str, Any] = rows.to_dict("records")[0]  # type: ignore[assignment]
            line[role] = first["controller"]
            line |= {f"{role}_{name}": first[name] for name in _FIGURES}
        line["ratio"] = line["learned_iqm_percent"] / line["other_iqm_percent"]
        lines.append(line)
    return pd.DataFrame(lines)


def standing(found: pd.DataFrame) -> dict[str, Any]:
    """Return what prose says of the leaders."""
    runs = found["learned_failed"] < 1.0
    ahead = found.loc[runs & (found["ratio"] < 1.0), "task"].tolist()
    behind = found.loc[runs & (found["ratio"] >= 1.0), "ratio"]
    return {
        "ahead": joined(ahead) if ahead else "no task",
        "tasks_ahead": len(ahead),
        "behind": f"{number(behind.min())} to {number(behind.max())}" if len(behind) else "none",
        "ratios": dict(zip(found["task"], found["ratio"], strict=True)),
    }


def standing_view(found: pd.DataFrame) -> pd.DataFrame:
    """Return the leaders with the headings that a reader sees."""
    ratio = [
        number(ratio) if failed < 1.0 else "–"
        for ratio, failed in zip(found["ratio"], found["learned_failed"], strict=True)
    ]
    return pd.DataFrame(
        {
            "task": found["task"],
            **_shown(found, "learned", "best policy", LEARNED),
            **_shown(found, "guarded", "best with its monitor", GUARDED),
            **_shown(found, "other", "best without learning", ""),
            "policy's IQM over that": ratio,
        }
    )


def _shown(found: pd.DataFrame, role: str, title: str, prefix: str) -> dict[str, list[str]]:
    return {
        title: [
            f"`{name.removeprefix(prefix)}`: {number(iqm)} ({number(100.0 * failed)} % fail)"
            for name, iqm, failed in zip(
                found[role],
                found[f"{role}_iqm_percent"],
                found[f"{role}_failed"],
                strict=True,
            )
        ]
    }
