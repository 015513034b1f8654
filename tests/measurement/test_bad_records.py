"""What is refused, with the file, the line and the column that a person has to look at."""

from __future__ import annotations

import numpy as np
import pytest

from rdpi_gym.measurement import DataOptions, Record, load
from rdpi_gym.support.errors import InputError
from tests.looping import over


def with_cell(lines: list[str], line: int, column: int, cell: str) -> str:
    """Replace a cell; `line` is counted from 1, `column` from 0."""
    cells = lines[line - 1].split(",")
    cells[column] = cell
    return "\n".join([*lines[: line - 1], ",".join(cells), *lines[line:]])


@over("cell", ["inf", "-Infinity", "1e999"])
@over("column, name", [(0, "t"), (1, "u"), (2, "y")])
def test_no_finite_number(write, sine_lines, refusal, cell, column, name) -> None:
    line = refusal(write("run.csv", with_cell(sine_lines(), 13, column, cell)))
    assert f"run.csv, line 13, column {name}: " in line
    assert "is no finite number; mend or remove this sample" in line


def test_no_finite_number_in_an_optional_column(write, sine_lines, refusal) -> None:
    lines = sine_lines()
    lines = [lines[0] + ",temperature", *(f"{line},20" for line in lines[1:])]
    line = refusal(write("run.csv", with_cell(lines, 9, 3, "nan")))
    assert "run.csv, line 9, column temperature: nan" in line


def test_lines_are_counted_with_comments_and_empty_ones(write, sine_lines, refusal) -> None:
    text = with_cell(sine_lines(), 13, 1, "inf")
    line = refusal(write("run.csv", "# a\r\n\r\n" + text.replace("\n", "\r\n")))
    assert "run.csv, line 15, column u: inf" in line


@over("cell", ["x", "1.2.3", "1_000", "--", "12 V", "0x10"])
def test_no_number(write, sine_lines, refusal, cell) -> None:
    line = refusal(write("run.csv", with_cell(sine_lines(), 30, 2, cell)))
    assert f"run.csv, line 30, column y: {cell!r} is not a number" in line


def test_no_number_under_another_name(write, sine_lines, refusal) -> None:
    lines = ["t,volt,y", *sine_lines()[1:]]
    options = DataOptions(columns={"u": "volt"})
    line = refusal(write("run.csv", with_cell(lines, 2, 1, "?")), options)
    assert "run.csv, line 2, column volt (u): '?' is not a number" in line


def test_no_number_at_a_position(write, sine_lines, refusal) -> None:
    options = DataOptions(columns={"t": 0, "u": 1, "y": 2})
    line = refusal(write("run.csv", with_cell(sine_lines()[1:], 1, 2, "?")), options)
    assert "run.csv, line 1, column 2 (y): '?' is not a number" in line


def test_points_and_commas_mixed(write, sine_lines, refusal) -> None:
    lines = with_cell(sine_lines(), 20, 1, "0|5").replace(",", ";").replace("|", ",")
    line = refusal(write("run.csv", lines))
    assert "run.csv, line 20, column u: '0,5' is not a number" in line


def test_an_empty_cell(write, sine_lines, refusal) -> None:
    line = refusal(write("run.csv", with_cell(sine_lines(), 7, 1, " ")))
    assert "run.csv, line 7, column u: no value" in line


def test_a_file_that_was_cut_off(write, sine_lines, refusal) -> None:
    text = "\n".join(sine_lines())
    line = refusal(write("run.csv", text[: text.rindex(",")]))
    assert "run.csv, line 41, column y: no value; perhaps the file was cut off here" in line


@over("delimiter", [",", ";", " "])
def test_lines_that_ran_together(write, sine_lines, refusal, delimiter) -> None:
    lines = sine_lines()
    lines[9] += "," + lines.pop(10)
    line = refusal(write("run.csv", "\n".join(lines).replace(",", delimiter)))
    assert "run.csv, line 10, column 3: 6 values where 3 were expected" in line


@over("value", ["-1", "0.08"])
def test_time_that_does_not_increase(write, sine_lines, refusal, value) -> None:
    line = refusal(write("run.csv", with_cell(sine_lines(), 8, 0, value)))
    assert f"run.csv, line 8, column t: time goes from 0.1 to {float(value):g} s" in line


def test_voltage_that_never_changes(write, sine_lines, refusal) -> None:
    line = refusal(write("run.csv", "\n".join(sine_lines(amplitude_V=0))))
    assert "run.csv, line 2, column u: u stays at 0 V in all samples, so" in line


def test_voltage_that_never_changes_in_any_record(write, sine_lines, refusal, tmp_path) -> None:
    for name in ("a.csv", "b.csv"):
        write(name, "\n".join(sine_lines(amplitude_V=0)))
    line = refusal(tmp_path)
    assert "a.csv, line 2, column u: u stays at 0 V in all samples (and in 1 more records)" in line


def test_fewer_than_sixteen_samples(write, sine_lines, refusal) -> None:
    line = refusal(write("run.csv", "\n".join(sine_lines(samples=15))))
    assert "run.csv, line 16, column u: the record ends after 15 samples; give 16 or more" in line
    assert load(write("run.csv", "\n".join(sine_lines(samples=16)))).records[0].t_s.size == 16


def test_fewer_than_sixteen_samples_after_the_skip(write, sine_lines, refusal) -> None:
    path = write("run.csv", "\n".join(sine_lines()))
    line = refusal(path, DataOptions(skip_s=0.5))
    assert "run.csv, line 41, column u: 15 samples are left after the first 0.5 s of 0.78 s" in line
    assert load(path, DataOptions(skip_s=0.48)).records[0].t_s.size == 16


def test_fewer_than_sixteen_samples_at_the_median_step(write, sine_lines, refusal) -> None:
    lines = sine_lines(samples=20)
    for k in range(9):
        lines[k + 2] = ",".join([f"{1e-5 * (k + 1):.6f}", *lines[k + 2].split(",")[1:]])
    line = refusal(write("run.csv", "\n".join(lines)))
    assert "samples are left at the median step of 0.02 s; give 16 or more" in line


@over(
    "header, name, meaning",
    [
        ("time,u,y", "t", "time in s"),
        ("t,U,y", "u", "voltage in V"),
        ("t,u,disp", "y", "displacement in µm"),
    ],
)
def test_a_missing_column(write, sine_lines, refusal, header, name, meaning) -> None:
    line = refusal(write("run.csv", "\n".join(["# made today", header, *sine_lines()[1:]])))
    assert f"run.csv, line 2, column {name}: missing ({meaning})" in line
    assert f"the file has {header.replace(',', ', ')}; name it with --columns {name}=..." in line
    assert ("--sampling-time" in line) == (name == "t")


def test_a_missing_column_that_was_asked_for(write, sine_lines, refusal) -> None:
    path = write("run.csv", "\n".join(sine_lines()))
    line = refusal(path, DataOptions(columns={"reference": "ref"}))
    assert "run.csv, line 1, column ref (reference): missing (reference in µm)" in line


def test_a_column_that_is_there_twice(write, sine_lines, refusal) -> None:
    lines = ["t,u,y,u", *(f"{line},0" for line in sine_lines()[1:])]
    assert "run.csv, line 1, column u: it is there twice" in refusal(
        write("run.csv", "\n".join(lines))
    )


def test_a_column_that_is_read_twice(write, sine_lines, refusal) -> None:
    path = write("run.csv", "\n".join(sine_lines()))
    line = refusal(path, DataOptions(columns={"u": "y"}))
    assert "run.csv, line 1, column y: read as u, so y needs a column of its own" in line


def test_no_header(write, sine_lines, refusal) -> None:
    path = write("run.csv", "\n".join(sine_lines()[1:]))
    line = refusal(path)
    assert "run.csv, line 1, column 0: a number where a header was expected" in line
    assert "--columns t=0,u=1,y=2" in line
    assert "(missing: y)" in refusal(path, DataOptions(columns={"t": 0, "u": 1}))


def test_a_position_that_is_not_there(write, sine_lines, refusal) -> None:
    options = DataOptions(columns={"t": 0, "u": 1, "y": 3})
    line = refusal(write("run.csv", "\n".join(sine_lines()[1:])), options)
    assert "run.csv, line 1, column 3 (y): there are 3 columns; give a position from 0 to 2" in line


def test_a_header_that_does_not_fit(write, sine_lines, refusal) -> None:
    blanks = ["time stamp u y", *(line.replace(",", " ") for line in sine_lines()[1:])]
    line = refusal(write("run.txt", "\n".join(blanks)), DataOptions(columns={"t": "stamp"}))
    assert "run.txt, line 2: 3 values under 4 names (line 1)" in line


def test_decimal_commas_between_commas(write, sine_lines, refusal) -> None:
    lines = sine_lines()
    text = "\n".join([lines[0], *(line.replace(".", ",") for line in lines[1:])])
    line = refusal(write("run.csv", text))
    assert "run.csv, line 2: 6 values under 3 names (line 1)" in line
    assert "put semicolons between the values" in line


@over("text", ["", "\n\n", "# t,u,y\n", "t,u,y\n"])
def test_no_values(write, refusal, text) -> None:
    assert "the file ends before its first value" in refusal(write("run.csv", text))


def test_wrong_encoding(tmp_path, refusal) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes("# gemessen\nt,u,y,Länge\n0,1,2,3\n".encode("latin-1"))
    line = refusal(path)
    assert "run.csv, line 2, column 8 (byte 18): not UTF-8 text; save the file as UTF-8" in line


def test_utf16_that_was_cut_off(tmp_path, refusal) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes("t,u,y\n0,1,2".encode("utf-16")[:-1])
    assert "run.csv, line 2, column 5 (byte 22): not UTF-16-" in refusal(path)


def test_utf16_without_its_mark(tmp_path, refusal) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes("t,u,y\n0,1,2".encode("utf-16-le"))
    assert "run.csv, line 1, column 2: a NUL character" in refusal(path)


def test_a_sampling_time_that_contradicts_the_file(write, sine_lines, refusal) -> None:
    path = write("run.csv", "\n".join(sine_lines()))
    line = refusal(path, DataOptions(sampling_time_s=5e-3))
    assert "run.csv, line 2, column t: time steps by 0.02 s on average" in line
    assert "--sampling-time says 0.005 s" in line
    assert load(path, DataOptions(sampling_time_s=0.0201)).records[0].ts_s == pytest.approx(0.02)


def test_a_period_that_is_no_index(write, sine_lines, refusal) -> None:
    lines = ["t,u,y,period", *(f"{line},1" for line in sine_lines()[1:])]
    line = refusal(write("run.csv", with_cell(lines, 12, 3, "1.5")))
    assert "run.csv, line 12, column period: 1.5 is no index of a repetition" in line


def test_time_that_jumps_far(write, sine_lines, refusal) -> None:
    lines = [*sine_lines(), *sine_lines(start_s=1e6)[1:]]
    line = refusal(write("run.csv", "\n".join(lines)))
    assert "run.csv: time jumps from 0.78 to 1e+06 s where the median step is 0.02 s" in line


def test_nothing_there(tmp_path, refusal) -> None:
    assert "no.csv does not exist; give a data file or a folder" in refusal(tmp_path / "no.csv")
    assert ": no data file in this folder; give .csv" in refusal(tmp_path)


def test_an_ending_that_is_not_read(write, refusal) -> None:
    line = refusal(write("run.xlsx", "PK"))
    assert "run.xlsx: files that end in '.xlsx' are not read; give a folder or one of .csv" in line


@over(
    "changes, reason",
    [
        ({"ts_s": 0.0}, "ts_s is 0.0"),
        ({"y_um": np.zeros(3)}, r"y_um has shape \(3,\)"),
        ({"role": "training"}, "role 'training' is unknown"),
    ],
)
def test_records_that_contradict_themselves(changes, reason) -> None:
    t = np.arange(20.0)
    columns = {"t_s": t, "u_V": t, "y_um": t, "ts_s": 1.0}
    with pytest.raises(InputError, match=reason):
        Record(name="run", **{**columns, **changes})
