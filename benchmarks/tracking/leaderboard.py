"""From rows to the table of scores and the ranking, with confidence intervals over seeds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from baselines import FULL_PREVIEW
from benchmarks.rows import TRACKING
from benchmarks.tracking.scoring import tally
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.store import Row
from rdpi_gym.support.words import number

COLUMNS = (
    "controller", "plant", "belief", "reference", "frequency_hz", "ts_s", "seed",
    "rmse_um", "rmse_percent", "max_um", "max_percent",
    "command_total_variation", "max_command_step_V", "saturated_percent",
    "optimality_gap", "microseconds_per_sample", "status",
)  # fmt: skip
RANKING = (
    "rank", "controller", "rmse_percent", "rmse_percent_low", "rmse_percent_high", "rmse_um",
    "status", "optimality_gap", "optimality_gap_low", "optimality_gap_high",
    "seed_0_rmse_percent", "mean_rank", "mean_rank_half_width", "places",
    "command_total_variation", "microseconds_per_sample", "rows", "errors",
)  # fmt: skip
CASE = ["plant", "reference", "frequency_hz", "ts_s"]
CONFIDENCE = 0.95


def score_table(rows: Sequence[Row]) -> pd.DataFrame:
    """Relate every row to the bound's on the same truth."""
    bound = {TRACKING.key(row)[1:]: row for row in rows if row["controller"] == FULL_PREVIEW}
    table = []
    for row in rows:
        best = bound.get(TRACKING.key(row)[1:], {})
        table.append(
            row
            | {
                "command_total_variation": _ratio(row, best, "command_variation_V_s"),
                "optimality_gap": _ratio(row, best, "rmse_um"),
            }
        )
    return pd.DataFrame(table, columns=list(COLUMNS))


def _ratio(row: Row, best: Row, name: str) -> float:
    value, least = row.get(name), best.get(name)
    return float(value / least) if value is not None and least else float("nan")


def interval(draws: Array) -> tuple[float, float]:
    """Mean and half-width of its confidence interval by Student's t, NaN below two draws."""
    n = len(draws)
    if n < 2:
        return float(np.mean(draws)), float("nan")
    t = stdtrit(n - 1, 0.5 + 0.5 * CONFIDENCE)
    return float(np.mean(draws)), float(t * np.std(draws, ddof=1) / np.sqrt(n))


def ranged(frame: pd.DataFrame, middle: str, low: str, high: str, digits: int = 3) -> list[str]:
    """Write a column of means, each with its interval in brackets where it has one."""
    return [
        f"{number(mean)} ({number(least, digits)} to {number(most, digits)})"
        if np.isfinite(least)
        else number(mean)
        for mean, least, most in zip(frame[middle], frame[low], frame[high], strict=True)
    ]


def drawn(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of drawn truths: seed 0, the nominal plant, only where it is alone."""
    rows = table[table["seed"] != 0]
    return table if rows.empty else rows


def ranking(table: pd.DataFrame) -> pd.DataFrame:
    """Rank the controllers by the geometric mean of their RMSE (%) over all cases.

    The mean is taken for each seed, as are those of the RMSE (µm) and of the optimality gaps, and
    the mean rank (by RMSE within each case, the bound aside; a row with an error is last). Each is
    given as the mean over the drawn seeds, with its confidence interval.

    Two controllers are tied where the confidence interval of their paired difference includes zero:
    that of the mean, over the drawn seeds, of the difference of the logarithms of their geometric
    means, by Student's t. The bound has no rank.
    """
    rivals = table[table["controller"] != FULL_PREVIEW]
    errors = rivals["rmse_um"].fillna(np.inf)
    ranks = errors.groupby([rivals[name] for name in [*CASE, "seed"]]).rank(method="average")
    table = table.assign(case_rank=ranks)
    lines = [_line(str(name), rows) for name, rows in table.groupby("controller", sort=False)]
    ranked = pd.DataFrame(lines, columns=list(RANKING)).sort_values(
        ["rmse_percent", "mean_rank"], na_position="last", ignore_index=True
    )
    labels = _labels(rivals, [str(name) for name in ranked["controller"]])
    for column in ("rank", "places"):
        ranked[column] = [labels[name][column] for name in ranked["controller"]]
    return ranked


def _line(controller: str, rows: pd.DataFrame) -> dict[str, object]:
    draws = drawn(rows)
    nominal = rows[rows["seed"] == 0]
    rank, rank_half = interval(draws.groupby("seed")["case_rank"].mean().to_numpy())
    statuses = rows["status"].tolist()
    said = tally(statuses)
    if controller == FULL_PREVIEW:
        said = "bound" if said == "ok" else f"bound, {said}"
    return {
        "controller": controller,
        **_geometric_mean(draws, "rmse_percent"),
        "rmse_um": _geometric_mean(draws, "rmse_um")["rmse_um"],
        "status": said,
        **_geometric_mean(draws, "optimality_gap"),
        "seed_0_rmse_percent": _geometric_mean(nominal, "rmse_percent")["rmse_percent"],
        "mean_rank": rank,
        "mean_rank_half_width": rank_half,
        "command_total_variation": _geometric_mean(draws, "command_total_variation")[
            "command_total_variation"
        ],
        "microseconds_per_sample": float(rows["microseconds_per_sample"].median()),
        "rows": len(rows),
        "errors": int(rows["rmse_um"].isna().sum()),
    }


def _labels(rivals: pd.DataFrame, order: Sequence[str]) -> dict[str, dict[str, str]]:
    """Rank and places of every controller, from paired differences over the drawn seeds."""
    logs = _log_means(drawn(rivals), "rmse_percent", ["seed", "controller"]).unstack()
    names = [name for name in order if name in logs.columns and logs[name].notna().all()]
    n = len(names)
    worse = np.array([[exceeds(logs[a] - logs[b]) for b in names] for a in names])
    tied = ~(worse | worse.T) if n else worse
    labels = {name: {"rank": "–", "places": "–"} for name in order}
    labels[FULL_PREVIEW] = {"rank": "bound", "places": "–"}
    first = 0
    for i, name in enumerate(names):
        if not tied[:i, i:].any():
            first = i
        last = next((k for k in range(i + 1, n) if not tied[:k, k:].any()), n)
        best, worst = 1 + int(worse[i].sum()), n - int(worse[:, i].sum())
        labels[name] = {
            "rank": f"{first + 1}{'=' if last - first > 1 else ''}",
            "places": f"{best} to {worst}" if best < worst else f"{best}",
        }
    return labels


def exceeds(differences: ArrayLike) -> bool:
    """Whether paired differences, one a seed, are above zero with all of their confidence interval.

    One seed tells nothing of chance: there the difference itself counts.
    """
    mean, half = interval(np.asarray(differences, dtype=np.float64))
    return mean > (half if np.isfinite(half) else 0.0)


def _log_means(rows: pd.DataFrame, column: str, by: Sequence[str]) -> pd.Series[float]:
    """Mean logarithm over the cases; a row without numbers must not make it better: it is missing."""
    with np.errstate(divide="ignore"):
        logs = np.log(rows[column])
    groups = logs.groupby([rows[name] for name in by])
    means: pd.Series[float] = groups.agg(lambda values: values.mean(skipna=False))
    return means


def _geometric_mean(rows: pd.DataFrame, column: str) -> dict[str, float]:
    by_seed = _log_means(rows, column, ["seed"])
    mean, half = (
        interval(np.asarray(by_seed, dtype=np.float64)) if len(by_seed) else (np.nan, np.nan)
    )
    return {
        column: float(np.exp(mean)),
        f"{column}_low": float(np.exp(mean - half)),
        f"{column}_high": float(np.exp(mean + half)),
    }


def by_case(table: pd.DataFrame) -> pd.DataFrame:
    """Summarise every controller and case: geometric means over the drawn seeds."""
    names = ["controller", *CASE]
    means = _summary(table, names, with_interval=True)
    um = _summary(table, names, with_interval=False, error="rmse_um")
    said = table.groupby(names, sort=False)["status"].agg(lambda rows: tally(rows.tolist()))
    means["rmse_um"] = um["rmse_um"]
    return means.merge(said.reset_index(), on=names)


def by_sampling_time(table: pd.DataFrame) -> pd.DataFrame:
    """Summarise every controller, plant and sampling time: geometric means over the drawn seeds."""
    return _summary(table, ["controller", "plant", "ts_s"], with_interval=False)


def _summary(
    table: pd.DataFrame, names: list[str], *, with_interval: bool, error: str = "rmse_percent"
) -> pd.DataFrame:
    effort = "command_total_variation"
    lines = []
    for values, rows in drawn(table).groupby(names, sort=False):
        means = _geometric_mean(rows, error)
        lines.append(
            dict(zip(names, values, strict=True))
            | (means if with_interval else {error: means[error]})
            | {effort: _geometric_mean(rows, effort)[effort]}
        )
    return pd.DataFrame(lines)
