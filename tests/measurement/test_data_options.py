"""What the command line says about DATA."""

from __future__ import annotations

import subprocess
import sys

import pytest
import typer
from typer.testing import CliRunner

from rdpi_gym.cli.options import DataArgument, expanded
from rdpi_gym.measurement import DataOptions, load, parse_columns, parse_units
from rdpi_gym.support.errors import InputError
from tests.looping import over


@over(
    "header",
    ["t [ms];u [mV];y [nm]", "t (ms);u (mV);y (nm)", "t_ms;u_mV;y_nm", "t/ms;u / mV;y/nm", "t ms;u mV;y nm",
     "t;u;y\nms;mV;nm", "t;u;y\n[ms];[mV];[nm]", '"t";"u";"y"\n"(ms)";"(mV)";"(nm)"'],
)  # fmt: skip
def test_units_of_a_header(write, header) -> None:
    rows = [f"{k},0;{k % 7},5;{k % 5},25" for k in range(40)]
    data = load(write("run.csv", "\n".join([header, *rows, ""])))
    (record,) = data.records
    assert record.ts_s == pytest.approx(1e-3)
    assert (record.u_V[1], record.y_um[1]) == pytest.approx((1.5e-3, 1.25e-3))
    assert data.units_assumed == ""


@over(
    "header, toml, options, asked",
    [
        ("t,u,y", "", DataOptions(), "no unit is given for u, y: taken as V, µm; --units u=UNIT,y=UNIT gives others"),
        ("t,u [mm],y", "", DataOptions(), "no unit is given for y: taken as µm; --units y=UNIT gives others"),
        ("t,u,F_kN", "", DataOptions(columns={"y": "F_kN"}), "no unit is given for u: taken as V; --units u=UNIT gives others"),
        ("t,u [mV],y [nm]", "", DataOptions(), ""),
        ("t,u,y", "", DataOptions(units={"u": "V", "y": "um"}), ""),
        ("t,u,y", '[units]\nu = "V"\ny = "um"\n', DataOptions(), ""),
        ("t,u,y", '[records.run.units]\nu = "V"\ny = "um"\n', DataOptions(), ""),
        ("t,u,y", '[quantities]\ninput = {name = "shift", unit = "mm"}\noutput = {unit = "kN"}\n', DataOptions(), ""),
    ],
)  # fmt: skip
def test_units_that_nothing_states_are_asked_for(
    write, sine_lines, header, toml, options, asked
) -> None:
    write("dataset.toml", toml)
    data = load(write("run.csv", "\n".join([header, *sine_lines()[1:], ""])), options)
    assert data.units_assumed == asked
    assert ("no unit is given" in data.describe()) == bool(asked)


@over(
    "header, step, samples, asked",
    [("t,u_V,y_um", 1.0, 1000, "no unit is given for t: taken as s; --units t=UNIT gives others"),
     ("t,u_V,y_um", 1.0, 999, ""), ("t,u_V,y_um", 0.049, 1000, ""), ("t_ms,u_V,y_um", 60.0, 1000, "")],
)  # fmt: skip
def test_times_without_a_unit_are_doubted_where_many_samples_are_slow(
    write, header, step, samples, asked
) -> None:
    rows = [f"{k * step:.6g},{k % 7},{k % 5}" for k in range(samples)]
    data = load(write("run.csv", "\n".join([header, *rows, ""])))
    assert data.units_assumed == asked


@over(
    "column, unit, factor",
    [
        ("t", "s", 1.0),
        ("t", "ms", 1e-3),
        ("t", "us", 1e-6),
        ("t", "µs", 1e-6),
        ("t", "μs", 1e-6),
        ("u", "V", 1.0),
        ("u", "mV", 1e-3),
        ("u", "kV", 1e3),
        ("y", "m", 1e6),
        ("y", "mm", 1e3),
        ("y", "um", 1.0),
        ("y", "µm", 1.0),
        ("y", "nm", 1e-3),
    ],
)
def test_units(write, sine_lines, column, unit, factor) -> None:
    path = write("run.csv", "\n".join(sine_lines()))
    plain = load(path).records[0]
    read = load(path, DataOptions(units=parse_units(f"{column}={unit}"))).records[0]
    name = {"t": "t_s", "u": "u_V", "y": "y_um"}[column]
    assert getattr(read, name) == pytest.approx(factor * getattr(plain, name), rel=1e-12)


@over(
    "text, message",
    [
        ("y=furlong", "--units: unit 'furlong' of y is unknown; known are m, mm, um, nm"),
        ("t=h", "--units: unit 'h' of t is unknown; known are s, ms, us"),
        ("u=W", "--units: unit 'W' of u is unknown; known are V, mV, kV"),
        ("period=s", "--units: unit 's' of period is unknown; period is an index without unit"),
        ("disp=m", "--units: 'disp' is unknown; known are t, u, y"),
        ("y", "--units 'y': 'y' is not NAME=VALUE; write y=m,t=ms"),
        ("y=m,y=nm", "y is given twice"),
        ("", "--units '': '' is not NAME=VALUE"),
    ],
)
def test_units_that_are_refused(text, message) -> None:
    with pytest.raises(InputError) as caught:
        parse_units(text)
    assert message in str(caught.value)


def test_columns() -> None:
    assert parse_columns("t=time, u = voltage ,y=a=b,reference=4") == {
        "t": "time",
        "u": "voltage",
        "y": "a=b",
        "reference": 4,
    }


@over(
    "text, message",
    [
        ("temprature=T", "--columns: 'temprature' is unknown (did you mean 'temperature'?)"),
        ("u=1,y=1", "--columns: u and y both name column 1; give two columns"),
        ("u=", "'u=' is not NAME=VALUE; write t=time,u=voltage,y=disp"),
        ("u=a,u=b", "u is given twice"),
    ],
)
def test_columns_that_are_refused(text, message) -> None:
    with pytest.raises(InputError) as caught:
        parse_columns(text)
    assert message in str(caught.value)


@over(
    "options, message",
    [
        ({"sampling_time_s": 0.0}, "--sampling-time is 0.0; give seconds above 0"),
        ({"sampling_time_s": float("inf")}, "--sampling-time is inf"),
        ({"skip_s": -1.0}, "--skip is -1.0; give seconds, 0 or above"),
        ({"skip_s": float("nan")}, "--skip is nan"),
    ],
)
def test_times_that_are_refused(options, message) -> None:
    with pytest.raises(InputError) as caught:
        DataOptions(**options)
    assert message in str(caught.value)


def test_a_subcommand_with_all_options(write, sine_lines) -> None:
    seen: list[object] = []
    app = typer.Typer()

    @app.command()
    @expanded
    def describe(data: DataArgument, options: DataOptions) -> None:
        seen.append(options)
        print(load(data, options).describe())

    rows = [line.split(",", 1)[1] for line in sine_lines()[1:]]
    path = write("run.csv", "\n".join(rows))
    words = f"{path} --columns u=0,y=1 --units y=nm --sampling-time 0.01 --validate r* --skip 0.1"
    result = CliRunner().invoke(app, words.split())
    assert result.exit_code == 0, result.output
    asked = DataOptions(
        columns={"u": 0, "y": 1}, units={"y": "nm"}, sampling_time_s=0.01, validate="r*", skip_s=0.1
    )
    assert seen == [asked]
    assert "run (validation): 30 samples, 0.01 s apart, t = 0.1 to 0.39 s" in result.output
    CliRunner().invoke(app, [str(path)])
    assert seen[1] == DataOptions()


def test_reading_loads_no_heavy_library() -> None:
    code = (
        "import sys, rdpi_gym.measurement;"
        "print([m for m in ('pandas', 'scipy', 'h5py', 'torch') if m in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (result.stdout.strip(), result.stderr) == ("[]", "")
