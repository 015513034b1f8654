"""What is refused, with the file, the line and the column that a person has to look at."""

from __future__ import annotations

import numpy as np
import pytest

from rdpi_gym.measurement import DataOptions, Record, load
from rdpi_gym.support.errors import InputError
from tests.looping import over
from tests.measurement.conftest import made_lines

LINES = made_lines()
TEXT, ROWS = "\n".join(LINES), "\n".join(LINES[1:])
STILL = "\n".join(made_lines(amplitude_V=0))
POSITIONS = {"t": 0, "u": 1, "y": 2}


def cell(line: int, column: int, value: str, lines: list[str] = LINES) -> str:
    """Replace a cell; `line` is counted from 1, `column` from 0."""
    cells = lines[line - 1].split(",")
    cells[column] = value
    return "\n".join([*lines[: line - 1], ",".join(cells), *lines[line:]])


def beside(name: str, value: str) -> list[str]:
    """The lines with a column more, of one value."""
    return [f"{LINES[0]},{name}", *(f"{line},{value}" for line in LINES[1:])]


def together(delimiter: str) -> str:
    """The text with two lines on one."""
    return "\n".join([*LINES[:9], f"{LINES[9]},{LINES[10]}", *LINES[11:]]).replace(",", delimiter)


def crowded() -> str:
    """Twenty samples, half of them within a ten-thousandth of a step."""
    lines = made_lines(samples=20)
    for k in range(9):
        lines[k + 2] = ",".join([f"{1e-5 * (k + 1):.6f}", *lines[k + 2].split(",")[1:]])
    return "\n".join(lines)


NOT_FINITE = "is no finite number; mend or remove this sample"
CASES: list[tuple[str, dict, str]] = [
    *(
        (cell(13, k, value), {}, f"line 13, column {'tuy'[k]}: ... {NOT_FINITE}")
        for k in range(3)
        for value in ("inf", "-Infinity", "1e999")
    ),
    (cell(9, 3, "nan", beside("temperature", "20")), {}, "line 9, column temperature: nan"),
    # lines are counted with comments and empty ones
    ("# a\r\n\r\n" + cell(13, 1, "inf").replace("\n", "\r\n"), {}, "line 15, column u: inf"),
    *(
        (cell(30, 2, value), {}, f"line 30, column y: {value!r} is not a number")
        for value in ("x", "1.2.3", "1_000", "--", "12 V", "0x10")
    ),
    (cell(2, 1, "?", ["t,volt,y", *LINES[1:]]), {"columns": {"u": "volt"}}, "line 2, column volt (u): '?' is not a number"),
    (cell(1, 2, "?", LINES[1:]), {"columns": POSITIONS}, "line 1, column 2 (y): '?' is not a number"),
    # points and commas mixed
    (cell(20, 1, "0|5").replace(",", ";").replace("|", ","), {}, "line 20, column u: '0,5' is not a number"),
    (cell(7, 1, " "), {}, "line 7, column u: no value"),
    (TEXT[: TEXT.rindex(",")], {}, "line 41, column y: no value; perhaps the file was cut off here"),
    *((together(d), {}, "line 10, column 3: 6 values where 3 were expected") for d in ",; "),
    *((cell(8, 0, value), {}, f"line 8, column t: time goes from 0.1 to {value} s") for value in ("-1", "0.08")),
    (STILL, {}, "line 2, column u: u stays at 0 V in all samples, so"),
    ("\n".join(made_lines(samples=15)), {}, "line 16, column u: the record ends after 15 samples; give 16 or more"),
    (TEXT, {"skip_s": 0.5}, "line 41, column u: 15 samples are left after the first 0.5 s of 0.78 s"),
    (crowded(), {}, "samples are left at the median step of 0.02 s; give 16 or more"),
    *(
        (
            "\n".join(["# made today", header, *LINES[1:]]), {},
            f"line 2, column {name}: missing ({meaning}) ... the file has {header.replace(',', ', ')}; name it with "
            f"--columns {name}=...",
        )
        for header, name, meaning in (
            ("time,u,y", "t", "time in s"), ("t,U,y", "u", "voltage in V"), ("t,u,disp", "y", "displacement in µm"),
        )
    ),
    ("\n".join(["time,u,y", *LINES[1:]]), {}, "--columns t=... or give --sampling-time"),
    (TEXT, {"columns": {"reference": "ref"}}, "line 1, column ref (reference): missing (reference in µm)"),
    ("\n".join(beside("u", "0")), {}, "line 1, column u: it is there twice"),
    (TEXT, {"columns": {"u": "y"}}, "line 1, column y: read as u, so y needs a column of its own"),
    (ROWS, {}, "line 1, column 0: a number where a header was expected ... --columns t=0,u=1,y=2"),
    (ROWS, {"columns": {"t": 0, "u": 1}}, "(missing: y)"),
    (ROWS, {"columns": {"t": 0, "u": 1, "y": 3}}, "line 1, column 3 (y): there are 3 columns; give a position from 0 to 2"),
    # a header that does not fit
    ("\n".join(["time stamp u y", *(line.replace(",", " ") for line in LINES[1:])]), {"columns": {"t": "stamp"}}, "line 2: 3 values under 4 names (line 1)"),
    # decimal commas between commas
    ("\n".join([LINES[0], *(line.replace(".", ",") for line in LINES[1:])]), {}, "line 2: 6 values under 3 names (line 1) ... put semicolons between the values"),
    *((text, {}, "the file ends before its first value") for text in ("", "\n\n", "# t,u,y\n", "t,u,y\n")),
    ("Scope, model 7\n", {}, "line 2: the file ends before its first value"),
    # prose above the header, and a row of values that is none
    ("\n".join(["Scope, model 7", "Samples,40,40", "", "Time,CH1,CH2", *LINES[1:]]), {}, "line 4, column t: missing (time in s) ... the file has Time, CH1, CH2;"),
    ("\n".join(["Exported at noon", *LINES[1:]]), {"columns": {"t": 0, "u": 1, "y": "y"}}, "line 1, column y: missing ... the file has Exported, at, noon"),
    ("\n".join(["Exported at noon", *LINES[:2], "a,b,c", *LINES[2:]]), {}, "line 4, column t: 'a' is not a number"),
    ("\n".join(["Exported at noon", LINES[0], "0,1", *LINES[1:]]), {}, "line 3, column y: no value"),
    # neither UTF-8 nor what instruments write
    (b"# gemessen\nt,u,y,L\x81nge\n0,1,2,3\n", {}, "line 2, column 8 (byte 18): not UTF-8 text; save the file as UTF-8"),
    (b"t,u,y\n0,1,\xe9\x02\n", {}, "line 2, column 5 (byte 10): not UTF-8 text"),
    ("t,u,y\n0,1,Länge\n".encode("cp1252"), {}, "line 2, column y: 'Länge' is not a number"),
    ("t,u,y\n0,1,2".encode("utf-16")[:-1], {}, "line 2, column 5 (byte 22): not UTF-16-"),
    ("t,u,y\n0,1,2".encode("utf-16-le"), {}, "line 1, column 2: a NUL character"),
    (TEXT, {"sampling_time_s": 5e-3}, "line 2, column t: time steps by 0.02 s on average ... --sampling-time says 0.005 s"),
    (cell(12, 3, "1.5", beside("period", "1")), {}, "line 12, column period: 1.5 is no index of a repetition"),
    ("\n".join([*LINES, *made_lines(start_s=1e6)[1:]]), {}, "run.csv: time jumps from 0.78 to 1e+06 s where the median step is 0.02 s"),
]  # fmt: skip


@over("text, options, said", CASES)
def test_what_is_wrong_is_named_by_its_place(tmp_path, refusal, text, options, said) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    line = refusal(path, DataOptions(**options))
    for part in said.split(" ... "):
        assert (f"run.csv, {part}" if part.startswith("line") else part) in line


def test_what_just_suffices_is_read(write) -> None:
    path = write("run.csv", TEXT)
    assert load(path, DataOptions(skip_s=0.48)).records[0].t_s.size == 16
    assert load(path, DataOptions(sampling_time_s=0.0201)).records[0].ts_s == pytest.approx(0.02)
    path = write("run.csv", "\n".join(made_lines(samples=16)))
    assert load(path).records[0].t_s.size == 16


def test_a_missing_column_of_values_asks_for_no_sampling_time(write, refusal) -> None:
    for header in ("t,U,y", "t,u,disp"):
        line = refusal(write("run.csv", "\n".join([header, *LINES[1:]])))
        assert "--sampling-time" not in line


def test_a_folder_or_a_file_that_cannot_be_read(write, refusal, tmp_path) -> None:
    assert "no.csv does not exist; give a data file or a folder" in refusal(tmp_path / "no.csv")
    assert ": no data file in this folder; give .csv" in refusal(tmp_path)
    line = refusal(write("run.xlsx", "PK"))
    assert "run.xlsx: files that end in '.xlsx' are not read; give a folder or one of .csv" in line
    for name in ("a.csv", "b.csv"):
        write(name, STILL)
    line = refusal(tmp_path)
    assert "a.csv, line 2, column u: u stays at 0 V in all samples (and in 1 more records)" in line


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
