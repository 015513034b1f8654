"""Rows of the benchmarks: their names, the fields that they hold, and their stores."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeAlias, TypeVar

from rdpi_gym.support.store import RowStore, check_row

K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True)
class RowFormat(Generic[K]):
    """Rows of one benchmark."""

    # file of the store, and what its first line states
    file: str
    name: str
    key: Callable[[Mapping[str, Any]], K]  # name of a row
    # fields that are text, numbers of 0 or above where given, and text where given
    texts: tuple[str, ...]
    numbers: tuple[str, ...]
    remarks: tuple[str, ...] = ()

    def open(self, folder: Path) -> RowStore[K]:
        """Return the store of the rows in a folder."""
        return RowStore(folder / self.file, self.name, self._checked_key)

    def _checked_key(self, row: Mapping[str, Any]) -> K:
        """Return the name of a row whose fields are those that a run writes."""
        check_row(row, self.texts, self.numbers, self.remarks)
        return self.key(row)


TrackingKey: TypeAlias = tuple[str, str, str, float, float, int]
"""Controller, plant, reference, frequency (Hz), Ts (s), seed."""
TaskKey: TypeAlias = tuple[str, str, str, int]
"""Controller, task, draws, number of the plant."""


def _tracking_key(row: Mapping[str, Any]) -> TrackingKey:
    return (
        str(row["controller"]),
        str(row["plant"]),
        str(row["reference"]),
        float(row["frequency_hz"]),
        float(row["ts_s"]),
        int(row["seed"]),
    )


def _task_key(row: Mapping[str, Any]) -> TaskKey:
    if type(row["plant"]) is not int:
        raise TypeError(f"plant is {row['plant']!r}")
    return str(row["controller"]), str(row["task"]), str(row["draws"]), row["plant"]


TRACKING = RowFormat(
    "rows.jsonl",
    "rdpi-bench-rows",
    _tracking_key,
    ("controller", "plant", "reference", "status"),
    (
        "frequency_hz", "ts_s", "seed", "rmse_um", "rmse_percent", "max_um", "max_percent",
        "command_variation_V_s", "max_command_step_V", "saturated_percent",
        "microseconds_per_sample",
    ),
)  # fmt: skip
"""One controller on one reference, plant, sampling time and seed."""
TASKS = RowFormat(
    "task-rows.jsonl",
    "rdpi-task-rows",
    _task_key,
    ("controller", "task", "draws", "stamp", "failure"),
    (
        "rmse_percent", "worst_percent", "rmse_um", "rmse_noise", "command_variation_V_s",
        "microseconds_per_sample", "tuning_samples",
    ),
    ("warning", "certificate", "sees"),
)  # fmt: skip
"""One controller on one drawn plant of a task."""
