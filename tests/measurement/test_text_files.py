"""Text records: every way of writing them that is promised is read, to the same numbers."""

from __future__ import annotations

import codecs

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rdpi_gym.measurement import DataOptions, Record, load, parse_columns, parse_units, write_csv
from tests.looping import over


def assert_is_the_sine(record: Record) -> None:
    t = 0.02 * np.arange(40)
    assert record.ts_s == pytest.approx(0.02, rel=1e-12)
    np.testing.assert_allclose(record.t_s, t, atol=1e-12)
    np.testing.assert_allclose(record.u_V, np.sin(2 * np.pi * t), atol=1e-6)
    np.testing.assert_allclose(record.y_um, 8 * np.sin(2 * np.pi * t), atol=1e-6)


@over("ending", ["csv", "txt", "dat", "tsv", "CSV"])
@over("delimiter", [",", ";", "\t", " ", ", ", " ; ", "   ", "\t "])
def test_delimiters(write, sine_lines, delimiter, ending) -> None:
    text = "\n".join(line.replace(",", delimiter) for line in sine_lines())
    (record,) = load(write(f"run.{ending}", text)).records
    assert record.name == "run"
    assert_is_the_sine(record)


@over("delimiter", [";", "\t", " ", "; "])
@over("header", [True, False])
def test_decimal_commas(write, sine_lines, delimiter, header) -> None:
    lines = [line.replace(",", delimiter).replace(".", ",") for line in sine_lines()]
    path = write("run.csv", "\n".join(lines if header else lines[1:]))
    options = DataOptions(columns={} if header else {"t": 0, "u": 1, "y": 2})
    assert_is_the_sine(load(path, options).records[0])


def test_decimal_commas_beside_a_date_with_points(write, sine_lines) -> None:
    rows = [line.replace(",", ";").replace(".", ",") for line in sine_lines()]
    lines = [f"date;{rows[0]}", *(f"12.03.2020 10:00;{row}" for row in rows[1:])]
    assert_is_the_sine(load(write("run.csv", "\n".join(lines))).records[0])


@over("end", ["\n", "\r\n", "\r"])
def test_line_ends_comments_empty_lines(write, sine_lines, end) -> None:
    lines = ["% made at night", "", *sine_lines(), "# the end", ""]
    lines.insert(10, "  # an interruption, 1, 2, 3")
    assert_is_the_sine(load(write("run.csv", end.join(lines))).records[0])


@over(
    "encoded",
    [
        lambda text: codecs.BOM_UTF8 + text.encode(),
        lambda text: codecs.BOM_UTF16_LE + text.encode("utf-16-le"),
        lambda text: codecs.BOM_UTF16_BE + text.encode("utf-16-be"),
    ],
)
def test_byte_order_marks(tmp_path, sine_lines, encoded) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(encoded("\n".join(sine_lines())))
    assert_is_the_sine(load(path).records[0])


SCOPE = "Model,TDS 2024\nRecord Length,40\nSamples,40,40\nProbe\n\nt,u,y\n"
DAQ = "\n".join(
    ["LabVIEW Messung", "Länge\t40\t40", "***Ende***", "Weg\tt\tu", "(µm)\t(s)\t(V)", ""]
)


@over(
    "prose, separator, order, encoding, taken",
    [
        (SCOPE, ",", (0, 1, 2), "utf-8", "the header is line 6; 4 lines above it are left out"),
        ("sep=;\nt;u;y\n", ";", (0, 1, 2), "utf-16", "the header is line 2; 1 line above it is left out"),
        ("Rig 2\n# t u y\n", " ", (0, 1, 2), "utf-8", "the header is line 2; 1 line above it is left out"),
        (DAQ, "\t", (2, 0, 1), "cp1252", "the header is line 4; 3 lines above it are left out"),
        ("t,u,y,Länge\n", ",", (0, 1, 2), "latin-1", "the file is no UTF-8 and was read as Windows-1252"),
    ],
)  # fmt: skip
def test_exports_of_instruments(tmp_path, sine_lines, prose, separator, order, encoding, taken):
    rows = (line.split(",") for line in sine_lines()[1:])
    text = prose + "\n".join(separator.join(row[k] for k in order) for row in rows) + "\n"
    path = tmp_path / "run.txt"
    path.write_bytes(text.encode(encoding))
    columns = {"y": "Weg"} if "Weg" in prose else {}
    (record,) = load(path, DataOptions(columns=columns)).records
    assert_is_the_sine(record)
    assert taken in record.remarks
    assert all("left out" in said or "Windows-1252" in said for said in record.remarks[:2])


def test_other_headers_and_units(write, sine_lines) -> None:
    lines = ["step,time,voltage,'disp, um',note".replace("'", '"')]
    for k, row in enumerate(sine_lines()[1:]):
        t, u, y = map(float, row.split(","))
        lines.append(f"{k},{1e3 * t:.6f},{1e3 * u:.6f},{1e-6 * y:.15f},a.b")
    options = DataOptions(
        columns={"t": "time", "u": "voltage", "y": "disp, um"},
        units=parse_units("t=ms,u=mV,y=m"),
    )
    assert_is_the_sine(load(write("run.csv", "\n".join(lines)), options).records[0])


def test_positions_with_and_without_header(write, sine_lines) -> None:
    rows = sine_lines()
    shuffled = ["x," + ",".join((t, "7", u, y)) for t, u, y in (r.split(",") for r in rows)]
    options = DataOptions(columns=parse_columns("t=1,u=3,y=4"))
    assert_is_the_sine(load(write("a.csv", "\n".join(shuffled)), options).records[0])
    assert_is_the_sine(load(write("b.csv", "\n".join(shuffled[1:])), options).records[0])


def test_header_in_a_comment_as_numpy_writes_it(tmp_path) -> None:
    t = 0.02 * np.arange(40)
    u = np.sin(2 * np.pi * t)
    np.savetxt(tmp_path / "run.txt", np.column_stack((8 * u, t, u)), header="y t u")
    assert_is_the_sine(load(tmp_path / "run.txt").records[0])


def test_quoted_values(write, sine_lines) -> None:
    lines = [",".join(f'"{cell}"' for cell in line.split(",")) for line in sine_lines()]
    assert_is_the_sine(load(write("run.csv", "\n".join(lines))).records[0])


def test_trailing_separators(write, sine_lines) -> None:
    lines = sine_lines()
    text = "\n".join([lines[0], *(f"{line},," for line in lines[1:])])
    assert_is_the_sine(load(write("run.csv", text)).records[0])


def test_no_time_column(write, sine_lines) -> None:
    text = "\n".join(line.split(",", 1)[1] for line in sine_lines())
    options = DataOptions(sampling_time_s=0.02)
    assert_is_the_sine(load(write("run.csv", text), options).records[0])


def test_time_is_the_clock_of_the_experiment(write, sine_lines) -> None:
    (record,) = load(write("run.csv", "\n".join(sine_lines(start_s=1234.5)))).records
    np.testing.assert_allclose(record.t_s, 1234.5 + 0.02 * np.arange(40), atol=1e-9)


def test_optional_columns(write, sine_lines) -> None:
    lines = sine_lines()
    text = "\n".join(
        [lines[0] + ",reference,temperature,period"]
        + [f"{line},{k / 4},{20 + k / 8},{k // 20}" for k, line in enumerate(lines[1:])]
    )
    options = DataOptions(units={"reference": "nm", "temperature": "°C"})
    (record,) = load(write("run.csv", text), options).records
    np.testing.assert_allclose(record.reference_um, np.arange(40) / 4000, rtol=1e-12)
    np.testing.assert_allclose(record.temperature_C, 20 + np.arange(40) / 8, rtol=1e-12)
    assert record.period is not None
    assert record.period.dtype == np.int64
    assert record.period.tolist() == [0] * 20 + [1] * 20


@given(st.lists(st.floats(-1e6, 1e6, width=64), min_size=16, max_size=60), st.integers(0, 2**32))
def test_written_records_are_read_back(tmp_path_factory, voltages, seed) -> None:
    u = np.array([*voltages, 1.0, 2.0])  # never constant
    draw = np.random.default_rng(seed).normal
    t = 3.0 + 5e-3 * np.arange(u.size)
    record = Record(
        "run", t, u, draw(size=u.size), 5e-3, draw(size=u.size), period=np.arange(u.size) // 7
    )
    path = write_csv(record, tmp_path_factory.mktemp("written") / "run.csv")
    (read,) = load(path).records
    for name in ("t_s", "u_V", "y_um", "reference_um", "period"):
        np.testing.assert_allclose(getattr(read, name), getattr(record, name), rtol=1e-12)
    assert read.ts_s == pytest.approx(5e-3, rel=1e-12)
