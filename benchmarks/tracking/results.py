"""The tables on disk: leaderboard.csv, ranking.csv, leaderboard.md, measured.csv."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from benchmarks.payoff.tables import payoff_part
from benchmarks.tracking.evaluation import Evaluation
from benchmarks.tracking.leaderboard import COLUMNS
from benchmarks.tracking.markdown import leaderboard_text
from rdpi_gym.support.files import write_atomic


def write_tables(out: Path, evaluation: Evaluation, payoff: pd.DataFrame | None = None) -> Path:
    """Write every table of a run into a folder; ``measured.csv`` only where it has rows."""
    table, text = evaluation.table, leaderboard_text(evaluation)
    if payoff is not None:
        table = pd.concat([table, payoff[list(COLUMNS)]], ignore_index=True)
        text += f"\n{payoff_part(payoff)}"
    write_atomic(out / "leaderboard.csv", _csv(table))
    write_atomic(out / "ranking.csv", _csv(_rankings(evaluation)))
    if not evaluation.measured.table.empty:
        write_atomic(out / "measured.csv", _csv(evaluation.measured.table))
    return write_atomic(out / "leaderboard.md", text)


def _rankings(evaluation: Evaluation) -> pd.DataFrame:
    """Return the ranking and those at one sampling time; ``ts_s`` is missing for the first."""
    parts = [(float("nan"), evaluation.ranking), *evaluation.where_trained.items()]
    return pd.concat(
        [part.assign(ts_s=ts)[["ts_s", *part.columns]] for ts, part in parts], ignore_index=True
    )


def _csv(table: pd.DataFrame) -> str:
    return table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
