"""What is no number is bridged and not scored, up to a fifth of a record."""

from __future__ import annotations

import numpy as np
import pytest

from rdpi_gym.identification import fit
from rdpi_gym.measurement import DataOptions, load
from rdpi_gym.measurement.sampling import filled_times, unknown_times
from tests.looping import over


def with_cells(lines: list[str], rows, column: int, cell: str) -> str:
    """Replace cells of a column; rows are counted from 0, behind the header."""
    changed = list(lines)
    for row in rows:
        cells = changed[row + 1].split(",")
        cells[column] = cell
        changed[row + 1] = ",".join(cells)
    return "\n".join(changed) + "\n"


@over("column, key", [(1, "u_V"), (2, "y_um")])
@over("cell", ["nan", "NaN"])
def test_a_value_that_is_no_number_is_bridged_and_not_scored(
    write, sine_lines, column, key, cell
) -> None:
    (whole,) = load(write("whole.csv", "\n".join(sine_lines()))).records
    (mended,) = load(write("run.csv", with_cells(sine_lines(), [11, 12], column, cell))).records
    assert np.flatnonzero(~mended.error_mask).tolist() == [11, 12]
    expected = getattr(whole, key).copy()
    expected[11:13] = np.interp([11, 12], [10, 13], expected[[10, 13]])
    np.testing.assert_allclose(getattr(mended, key), expected)
    assert mended.remarks == (
        "left out of the error, simulated through in a straight line: 2 of 40 samples (5 %) with "
        "no number in u or y, the first in line 13",
    )


def test_more_than_a_fifth_is_refused(write, sine_lines, refusal) -> None:
    path = write("run.csv", with_cells(sine_lines(), range(3, 12), 2, "nan"))
    said = "run.csv, line 5, column y: nan is no number, and so it is in 9 of 40 samples"
    assert said in refusal(path)
    # what is skipped does not count
    (record,) = load(path, DataOptions(skip_s=0.1)).records
    assert int(record.error_mask.sum()) == 28


def test_a_fifth_may_be_missing(write, sine_lines) -> None:
    (record,) = load(write("run.csv", with_cells(sine_lines(), range(3, 11), 2, "nan"))).records
    assert int(record.error_mask.sum()) == 32


def test_a_time_that_stands_there_twice_is_put_between_its_neighbours(write, sine_lines) -> None:
    (record,) = load(write("run.csv", with_cells(sine_lines(), [6], 0, "0.100000"))).records
    assert np.flatnonzero(~record.error_mask).tolist() == [6]
    np.testing.assert_allclose(record.t_s, 0.02 * np.arange(40))
    assert (
        "1 of 40 samples (2.5 %) with a time that is missing or stands there twice"
        in (record.remarks[0])
    )


def test_a_line_that_stands_there_twice_is_left_out(write, sine_lines) -> None:
    lines = sine_lines()
    (record,) = load(write("run.csv", "\n".join([*lines[:10], *lines[9:]]) + "\n")).records
    (whole,) = load(write("whole.csv", "\n".join(lines) + "\n")).records
    np.testing.assert_allclose(record.t_s, whole.t_s)
    np.testing.assert_allclose(
        record.y_um[record.error_mask], whole.y_um[record.error_mask], atol=1e-9
    )
    assert record.error_mask.sum() >= 38


@over("rows", [[0], [39], [0, 1, 20, 39]])
def test_times_that_are_missing_are_filled(write, sine_lines, rows) -> None:
    (record,) = load(write("run.csv", with_cells(sine_lines(), rows, 0, "nan"))).records
    np.testing.assert_allclose(record.t_s, 0.02 * np.arange(40), atol=1e-12)
    assert np.flatnonzero(~record.error_mask).tolist() == rows


def test_a_column_of_times_that_says_nothing_is_refused(write, sine_lines, refusal) -> None:
    line = refusal(write("run.csv", with_cells(sine_lines(), range(40), 0, "0.5")))
    assert "39 of 40 times are missing or stand there twice" in line


@over("gone", [[200], [1], [150, 151, 152], range(100, 120), [7, 50, 51, 300]])
@over("ts_s, decimals, options", [
    (5e-3, 6, DataOptions()),
    (3.328e-4, 4, DataOptions()),
    (3.328e-4, 4, DataOptions(sampling_time_s=3.328e-4)),
    (1.0 / 3.0, 9, DataOptions(skip_s=2.0)),
])  # fmt: skip
def test_a_row_that_is_lost_counts_as_one_that_is_no_number(
    write, gone, ts_s, decimals, options
) -> None:
    k = np.arange(400)
    u = 20.0 * np.sin(0.06 * k) * np.linspace(0.3, 1.0, k.size)
    y = 0.6 * u + 0.8 * np.abs(np.sin(u / 7.0)) + 0.01 * np.cos(991.0 * k)
    lines = [f"{7 + t:.{decimals}f},{a},{b}" for t, a, b in zip(ts_s * k, u, y, strict=True)]
    told = [f"{line.split(',')[0]},nan,nan" if i in gone else line for i, line in enumerate(lines)]
    lost = [line for i, line in enumerate(lines) if i not in gone]
    forms = [
        load(write(f"{name}.csv", "\n".join(["t,u,y", *rows]) + "\n"), options)
        for name, rows in (("told", told), ("lost", lost))
    ]
    a, b = (form.records[0] for form in forms)
    np.testing.assert_array_equal(a.error_mask, b.error_mask)
    np.testing.assert_array_equal(a.u_V, b.u_V)
    np.testing.assert_array_equal(a.y_um, b.y_um)
    np.testing.assert_allclose(a.t_s, b.t_s, rtol=1e-12)
    assert fit(forms[0], 3).train_rmse_um == pytest.approx(fit(forms[1], 3).train_rmse_um, rel=1e-9)


def test_what_is_missing_in_what_is_skipped_is_bridged_in_its_history(write, sine_lines) -> None:
    path = write("run.csv", with_cells(sine_lines(), [1], 1, "nan"))
    (record,) = load(path, DataOptions(skip_s=0.1)).records
    assert record.error_mask.all()
    assert np.isfinite(record.before_V).all()
    assert record.before_V.size == 5


def test_of_two_samples_with_one_stamp_the_later_has_no_time() -> None:
    t_s = np.array([0.0, 0.1, 0.1, 0.3, np.nan, 0.3, 0.6])
    unknown = unknown_times(t_s)
    assert unknown.tolist() == [False, False, True, False, True, True, False]
    np.testing.assert_allclose(filled_times(t_s, unknown), 0.1 * np.arange(7))
