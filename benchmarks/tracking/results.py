"""The tables on disk: leaderboard.csv, leaderboard.md, measured.csv."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from benchmarks.tracking.evaluation import Evaluation
from benchmarks.tracking.markdown import leaderboard_text
from rdpi_gym.files import write_atomic


def write_tables(out: Path, evaluation: Evaluation) -> Path:
    """Write every table of a run into a folder; ``measured.csv`` only where it has rows.

    Returns
    -------
    Path
        ``leaderboard.md``.
    """
    write_atomic(out / "leaderboard.csv", _csv(evaluation.table))
    if not evaluation.measured.table.empty:
        write_atomic(out / "measured.csv", _csv(evaluation.measured.table))
    return write_atomic(out / "leaderboard.md", leaderboard_text(evaluation))


def _csv(table: pd.DataFrame) -> str:
    return table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
