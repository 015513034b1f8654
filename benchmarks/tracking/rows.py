"""What names a row of the tracking benchmark, and the store of its rows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

from rdpi_gym.support.store import RowStore, check_row

ROWS_FILE = "rows.jsonl"
FORMAT = "rdpi-bench-rows"
_TEXTS = ("controller", "plant", "reference", "status")
_NUMBERS = (
    "frequency_hz", "ts_s", "seed", "rmse_um", "rmse_percent", "max_um", "max_percent",
    "command_variation_V_s", "max_command_step_V", "saturated_percent", "microseconds_per_sample",
)  # fmt: skip
Key: TypeAlias = tuple[str, str, str, float, float, int]


def key(row: Mapping[str, Any]) -> Key:
    """Return what names a row: controller, plant, reference, frequency (Hz), Ts (s), seed."""
    return (
        str(row["controller"]),
        str(row["plant"]),
        str(row["reference"]),
        float(row["frequency_hz"]),
        float(row["ts_s"]),
        int(row["seed"]),
    )


def open_rows(folder: Path) -> RowStore[Key]:
    """Return the store of the rows in a folder."""
    return RowStore(folder / ROWS_FILE, FORMAT, _key_of_whole)


def _key_of_whole(row: Mapping[str, Any]) -> Key:
    """Return what names a row all of whose fields hold what a run writes."""
    check_row(row, _TEXTS, _NUMBERS)
    return key(row)
