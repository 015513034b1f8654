"""From rows to a ranking: failures first, then the worst tenth, then the middle half of the plants."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.stats import spearmanr

from baselines import HORIZON_BOUND
from benchmarks.stages.unit import PREVIEW, WORST_PERCENT
from benchmarks.tracking.leaderboard import CONFIDENCE
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.store import Row

COLUMNS = (
    "rank", "controller", "failed", "p90_percent", "p90_low", "p90_high", "iqm_percent", "iqm_low",
    "iqm_high", "iqm_noise", "command_variation_V_s", "microseconds_per_sample", "tuning_samples",
    "sees", "certificate", "places", "failure",
)  # fmt: skip
"""Of a ranking. ``failed``: share of the plants; ``iqm_noise``: in units of the sensor's noise;
``failure``: the first reason."""
RESAMPLES = 2000
BOUND = "bound"


def interquartile_mean(values: Array) -> Array:
    """Mean of the middle half along the last axis, plants at its edges in part."""
    ordered = np.sort(values, axis=-1)
    n = ordered.shape[-1]
    edges = np.arange(n + 1)
    inside = np.clip(np.minimum(edges[1:], 0.75 * n) - np.maximum(edges[:-1], 0.25 * n), 0.0, None)
    return np.asarray(ordered @ inside / inside.sum())


def ninetieth(values: Array) -> Array:
    """90th percentile along the last axis, linear between plants."""
    return np.asarray(np.percentile(values, 90.0, axis=-1))


def ranking(rows: Sequence[Row]) -> pd.DataFrame:
    """Rank the controllers on one task.

    A plant on which a controller failed counts with its RMSE or :data:`~benchmarks.stages.unit.WORST_PERCENT`,
    whichever is more. Of two controllers the one that failed on fewer plants is ahead; then that with
    the smaller 90th percentile, where the paired bootstrap of the difference over the plants excludes
    zero; then that with the smaller interquartile mean, where it does; else they tie. The rank is one
    more than the number of those that are ahead. Controllers that are given the whole reference, and
    the bound, have no rank.
    """
    table = pd.DataFrame(list(rows))
    numbers = sorted(table["plant"].unique())
    names = list(dict.fromkeys(table["controller"]))
    errors, fails = np.swapaxes([_errors_and_fails(table, name, numbers) for name in names], 0, 1)
    rng = np.random.default_rng(0)
    picked = rng.integers(len(numbers), size=(RESAMPLES, len(numbers)))
    drawn = {
        "p90": ninetieth(errors[:, picked]),
        "iqm": interquartile_mean(errors[:, picked]),
    }
    lines = []
    for i, name in enumerate(names):
        own = table[table["controller"] == name]
        lines.append(
            {
                "controller": name,
                "failed": float(fails[i].mean()),
                "p90_percent": float(ninetieth(errors[i])),
                **_interval("p90", drawn["p90"][i]),
                "iqm_percent": float(interquartile_mean(errors[i])),
                **_interval("iqm", drawn["iqm"][i]),
                **_rest(own, errors[i]),
            }
        )
    ranked = pd.DataFrame(lines)
    is_rival = (ranked["controller"] != HORIZON_BOUND) & (ranked["sees"] == PREVIEW)
    rivals: list[int] = np.flatnonzero(is_rival).tolist()
    behind = np.array(
        [[_is_behind(fails, drawn, a, b) for b in rivals] for a in rivals], dtype=np.bool_
    ).reshape(len(rivals), len(rivals))
    ahead = behind.sum(axis=1)
    last = len(rivals) - behind.sum(axis=0)
    ranked["rank"] = np.where(ranked["controller"] == HORIZON_BOUND, BOUND, ranked["sees"])
    ranked["places"] = "–"
    for i, best, worst in zip(rivals, (ahead + 1).tolist(), last.tolist(), strict=True):
        ranked.loc[i, "rank"] = f"{best}{'=' if best < worst else ''}"
        ranked.loc[i, "places"] = f"{best} to {worst}" if best < worst else f"{best}"
    # what has no rank stands where its figures put it
    ranked["order"] = 0.0
    ranked.loc[rivals, "order"] = ahead
    figures = ["failed", "p90_percent", "iqm_percent"]
    ranked = ranked.sort_values(["failed", "order", *figures[1:]], kind="stable", ignore_index=True)
    return ranked[list(COLUMNS)]


def _errors_and_fails(
    table: pd.DataFrame, name: str, numbers: Sequence[int]
) -> tuple[Array, Array]:
    """Return the score of each plant (%), and 1 where the controller failed on it."""
    own = table[table["controller"] == name].set_index("plant").loc[list(numbers)]
    rmse = own["rmse_percent"] if "rmse_percent" in own else pd.Series(np.nan, index=own.index)
    failed = own["failure"].to_numpy() != ""
    values = rmse.fillna(WORST_PERCENT).to_numpy(dtype=np.float64)
    counted = np.where(failed, np.maximum(values, WORST_PERCENT), values)
    return counted, np.asarray(failed, dtype=np.float64)


def _interval(name: str, drawn: Array) -> dict[str, float]:
    low, high = _range(drawn)
    return {f"{name}_low": low, f"{name}_high": high}


def _range(drawn: Array) -> tuple[float, float]:
    low, high = np.quantile(drawn, [0.5 * (1.0 - CONFIDENCE), 0.5 * (1.0 + CONFIDENCE)])
    return float(low), float(high)


def _is_behind(fails: Array, drawn: dict[str, Array], a: int, b: int) -> bool:
    """Whether one controller is behind another by the first figure that tells them apart."""
    more = float(fails[a].sum() - fails[b].sum())
    if more:
        return more > 0.0
    for each in drawn.values():
        low, high = _range(each[a] - each[b])
        if low > 0.0 or high < 0.0:
            return low > 0.0
    return False


def _rest(own: pd.DataFrame, errors: Array) -> dict[str, object]:
    def median(column: str) -> float:
        return float(own[column].median()) if column in own else float("nan")

    def first(column: str) -> object:
        known = own[column].dropna().tolist() if column in own else []
        return known[0] if known else None

    reasons = own.loc[own["failure"] != "", "failure"]
    per_percent = median("rmse_noise") / (median("rmse_percent") or math.nan)
    return {
        "iqm_noise": float(interquartile_mean(errors)) * per_percent,
        "command_variation_V_s": median("command_variation_V_s"),
        "microseconds_per_sample": median("microseconds_per_sample"),
        "tuning_samples": first("tuning_samples"),
        "sees": first("sees") or PREVIEW,
        "certificate": first("certificate"),
        "failure": reasons.iloc[0] if len(reasons) else "",
    }


def rivals_of(ranked: pd.DataFrame) -> pd.DataFrame:
    """Return the controllers of a ranking that have a rank: those that see a preview and no more."""
    return ranked[ranked["rank"].str.rstrip("=").str.isdigit()]


def rank_correlation(rows: Sequence[Row]) -> float:
    """Return :func:`agreement` of the even and of the odd plants of one task, two disjoint draws."""
    even, odd = ([row for row in rows if row["plant"] % 2 == parity] for parity in (0, 1))
    return agreement(even, odd)


def agreement(first: Sequence[Row], second: Sequence[Row]) -> float:
    """Return Spearman's correlation of the ranks on two sets of plants of one task.

    The bound, and what sees more than the preview, do not count; NaN below three controllers.
    """
    one, other = (
        rivals_of(ranking(rows)).set_index("controller")["rank"].str.rstrip("=").astype(int)
        for rows in (first, second)
    )
    if len(one) < 3:
        return float("nan")
    return float(spearmanr(one, other.loc[one.index]).statistic)
