"""From rows to the table of scores and the ranking, with confidence intervals over seeds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from baselines import ORACLE
from benchmarks.tracking.rows import key
from benchmarks.tracking.scoring import words
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.store import Row

COLUMNS = (
    "controller", "plant", "belief", "reference", "frequency_hz", "ts_s", "seed",
    "rmse_um", "rmse_percent", "max_um", "max_percent",
    "command_total_variation", "max_command_step_V", "saturated_percent",
    "optimality_gap", "microseconds_per_sample", "status",
)  # fmt: skip
CASE = ["plant", "reference", "frequency_hz", "ts_s"]
CONFIDENCE = 0.95


def score_table(rows: Sequence[Row]) -> pd.DataFrame:
    """Relate every row to the oracle's on the same truth.

    Parameters
    ----------
    rows
        As the store holds them, the oracle's among them.

    Returns
    -------
    DataFrame
        Columns :data:`COLUMNS`, one row a row; a failed row has no numbers. The command's total
        variation is divided by that of the oracle's command, the smallest that tracks.
    """
    oracle = {key(row)[1:]: row for row in rows if row["controller"] == ORACLE}
    table = []
    for row in rows:
        best = oracle.get(key(row)[1:], {})
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
    """Mean and half-width of its confidence interval by Student's t, NaN below two draws.

    Parameters
    ----------
    draws
        ``(N,)`` independent values, here one a seed.

    Examples
    --------
    >>> mean, half = interval(np.array([1.0, 2.0, 3.0]))
    >>> mean, round(half, 3)
    (2.0, 2.484)
    """
    n = len(draws)
    if n < 2:
        return float(np.mean(draws)), float("nan")
    t = stdtrit(n - 1, 0.5 + 0.5 * CONFIDENCE)
    return float(np.mean(draws)), float(t * np.std(draws, ddof=1) / np.sqrt(n))


def drawn(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of drawn truths: seed 0, the nominal plant, only where it is alone."""
    rows = table[table["seed"] != 0]
    return table if rows.empty else rows


def ranking(table: pd.DataFrame) -> pd.DataFrame:
    """Rank the controllers by the geometric mean of their RMSE (%) over all cases.

    The mean is taken for each seed, as are that of the optimality gaps and the mean rank (by RMSE
    among all but the oracle; a failed row is last). Each is given as the mean over the drawn seeds
    with its confidence interval.

    Parameters
    ----------
    table
        As :func:`score_table` returns it, without what should not count.

    Returns
    -------
    DataFrame
        Best first: ``controller``; ``rmse_percent`` and ``optimality_gap``, each with ``_low`` and
        ``_high``; ``seed_0_rmse_percent``; ``mean_rank, mean_rank_half_width``;
        ``command_total_variation, microseconds_per_sample, rows, failed, warnings``. Means are
        missing where rows failed.
    """
    rivals = table[table["controller"] != ORACLE]
    errors = rivals["rmse_um"].fillna(np.inf)
    ranks = errors.groupby([rivals[name] for name in [*CASE, "seed"]]).rank(method="average")
    table = table.assign(rank=ranks)
    lines = [_line(str(name), rows) for name, rows in table.groupby("controller", sort=False)]
    return pd.DataFrame(lines).sort_values(
        ["rmse_percent", "mean_rank"], na_position="last", ignore_index=True
    )


def _line(controller: str, rows: pd.DataFrame) -> dict[str, object]:
    draws = drawn(rows)
    nominal = rows[rows["seed"] == 0]
    failed = rows["rmse_um"].isna()
    rank, rank_half = interval(draws.groupby("seed")["rank"].mean().to_numpy())
    return {
        "controller": controller,
        **_geometric_mean(draws, "rmse_percent"),
        **_geometric_mean(draws, "optimality_gap"),
        "seed_0_rmse_percent": _geometric_mean(nominal, "rmse_percent")["rmse_percent"],
        "mean_rank": rank,
        "mean_rank_half_width": rank_half,
        "command_total_variation": _geometric_mean(draws, "command_total_variation")[
            "command_total_variation"
        ],
        "microseconds_per_sample": float(rows["microseconds_per_sample"].median()),
        "rows": len(rows),
        "failed": int(failed.sum()),
        "warnings": ", ".join(sorted(words(rows.loc[~failed, "status"].tolist()))),
    }


def _geometric_mean(rows: pd.DataFrame, column: str) -> dict[str, float]:
    # A failed row must not make a mean better: it makes it missing.
    with np.errstate(divide="ignore"):
        logs = np.log(rows[column])
    by_seed = logs.groupby(rows["seed"]).agg(lambda values: values.mean(skipna=False))
    mean, half = interval(by_seed.to_numpy()) if len(by_seed) else (np.nan, np.nan)
    return {
        column: float(np.exp(mean)),
        f"{column}_low": float(np.exp(mean - half)),
        f"{column}_high": float(np.exp(mean + half)),
    }


def by_case(table: pd.DataFrame) -> pd.DataFrame:
    """Summarise every controller and case: geometric means over the drawn seeds.

    Returns
    -------
    DataFrame
        ``controller, plant, reference, frequency_hz, ts_s, rmse_percent, rmse_percent_low,
        rmse_percent_high, command_total_variation``.
    """
    return _summary(table, ["controller", *CASE], with_interval=True)


def by_sampling_time(table: pd.DataFrame) -> pd.DataFrame:
    """Summarise every controller, plant and sampling time: geometric means over the drawn seeds.

    Returns
    -------
    DataFrame
        ``controller, plant, ts_s, rmse_percent, command_total_variation``.
    """
    return _summary(table, ["controller", "plant", "ts_s"], with_interval=False)


def _summary(table: pd.DataFrame, names: list[str], *, with_interval: bool) -> pd.DataFrame:
    error, effort = "rmse_percent", "command_total_variation"
    lines = []
    for values, rows in drawn(table).groupby(names, sort=False):
        means = _geometric_mean(rows, error)
        lines.append(
            dict(zip(names, values, strict=True))
            | (means if with_interval else {error: means[error]})
            | {effort: _geometric_mean(rows, effort)[effort]}
        )
    return pd.DataFrame(lines)
