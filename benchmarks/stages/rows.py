"""What names a row, and the store of rows: one controller on one drawn plant of a task."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

from rdpi_gym.support.store import RowStore, check_row

SUITE_VERSION = 1
"""Of the tasks: rows of another are of other plants or another protocol."""
ROWS_FILE = "task-rows.jsonl"
FORMAT = "rdpi-task-rows"
_TEXTS = ("controller", "task", "draws", "stamp", "failure")
_REMARKS = ("warning", "certificate", "sees")
_NUMBERS = (
    "rmse_percent", "worst_percent", "rmse_um", "rmse_noise", "command_variation_V_s",
    "microseconds_per_sample", "tuning_samples",
)  # fmt: skip
Key: TypeAlias = tuple[str, str, str, int]


def key(row: Mapping[str, Any]) -> Key:
    """Return what names a row: controller, task, draws, number of the plant."""
    return str(row["controller"]), str(row["task"]), str(row["draws"]), int(row["plant"])


def open_rows(folder: Path) -> RowStore[Key]:
    """Return the store of the rows in a folder."""
    return RowStore(folder / ROWS_FILE, FORMAT, _key_of_whole)


def _key_of_whole(row: Mapping[str, Any]) -> Key:
    """Return what names a row all of whose fields hold what a run writes."""
    check_row(row, _TEXTS, _NUMBERS, _REMARKS)
    if type(row["plant"]) is not int:
        raise TypeError(f"plant is {row['plant']!r}")
    return key(row)
