"""Rows whose check sums are right, written by somebody else: computed again, never trusted."""

import pytest

from benchmarks.rows import TASKS, TRACKING
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.store import named_rows

SCORED = {
    "controller": "none", "plant": "P5", "reference": "sine", "frequency_hz": 10.0, "ts_s": 1e-3,
    "seed": 0, "rmse_um": 0.5, "status": "ok",
}  # fmt: skip
TASK = {
    "controller": "pi", "task": "Bare", "draws": "public seed 2026", "plant": 0, "stamp": "a",
    "failure": "", "certificate": None, "rmse_percent": float("nan"),
}  # fmt: skip


def written(opened, folder, row):
    """Write a row as whoever knows the format can."""
    store = opened(folder)
    line = store._line(row)
    store.path.write_bytes(store._head + line)
    return opened(folder)


def test_a_score_that_no_run_writes_is_no_row(tmp_path_factory, subtests):
    for change in [
        {"rmse_um": "0.5"},
        {"rmse_um": -1},
        {"rmse_um": True},
        {"status": 3},
        {"status": None},
        {"seed": float("inf")},
        {"frequency_hz": {}},
    ]:
        with subtests.test(change=change):
            tmp_path = tmp_path_factory.mktemp("case")
            assert len(written(TRACKING.open, tmp_path, SCORED).rows) == 1
            store = written(TRACKING.open, tmp_path, {**SCORED, **change})
            assert (store.rows, store.damaged) == ({}, 1)


def test_a_task_that_no_run_writes_is_no_row(tmp_path_factory, subtests):
    for change in [
        {"plant": 0.5},
        {"stamp": 3},
        {"failure": None},
        {"certificate": 0.5},
        {"tuning_samples": []},
    ]:
        with subtests.test(change=change):
            tmp_path = tmp_path_factory.mktemp("case")
            assert len(written(TASKS.open, tmp_path, TASK).rows) == 1
            store = written(TASKS.open, tmp_path, {**TASK, **change})
            assert (store.rows, store.damaged) == ({}, 1)


def test_rows_are_not_appended_through_a_link(tmp_path_factory, subtests):
    for there in [True, False]:
        with subtests.test(there=there):
            tmp_path = tmp_path_factory.mktemp("case")
            outside = tmp_path / "outside.jsonl"
            if there:
                named_rows(outside).append([{"key": "a"}])
            before = outside.read_bytes() if there else None
            (tmp_path / "rows.jsonl").symlink_to(outside)
            with pytest.raises(InputError, match=r"rows\.jsonl cannot be written") as caught:
                named_rows(tmp_path / "rows.jsonl").append([{"key": "b"}])
            assert "\n" not in str(caught.value)
            assert (outside.read_bytes() if there else None) == before
            assert outside.exists() == there
