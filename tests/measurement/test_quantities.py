"""Name, symbol and unit of input and output: from dataset.toml, the header, the options."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.io import savemat

import rdpi_gym as rg
from rdpi_gym.measurement import DataOptions, Quantities, Quantity, load, parse_units
from rdpi_gym.support.errors import InputError
from tests.looping import over

DAMPER = Quantities(Quantity("displacement", "x", "mm"), Quantity("force", "F", "kN"))
TOML = (
    '[quantities]\ninput = { name = "displacement", symbol = "x", unit = "mm" }\n'
    'output = { name = "force", symbol = "F", unit = "kN" }\n'
)
SINE = 3.0 * np.sin(0.2 * np.arange(60))


def text(header: str, *columns) -> str:
    rows = np.column_stack((0.01 * np.arange(60), *columns))
    return "\n".join([header, *(",".join(f"{value:.9g}" for value in row) for row in rows), ""])


def test_the_default_is_a_voltage_and_a_displacement(write) -> None:
    data = load(write("run.csv", text("t,u,y", SINE, 2 * SINE)))
    assert data.quantities == Quantities()
    assert data.quantities.are_standard
    assert "from " not in data.describe()


def test_dataset_toml_names_the_quantities(write) -> None:
    path = write("run.csv", text("t,u,y", SINE, 2 * SINE))
    write("dataset.toml", TOML)
    data = load(path)
    assert data.quantities == DAMPER
    np.testing.assert_allclose(data.records[0].u_V, SINE, rtol=1e-8)
    np.testing.assert_allclose(data.records[0].y_um, 2 * SINE, rtol=1e-8)
    assert "from displacement x (mm) to force F (kN)" in data.describe()


@over("header", ["t [s],x (mm),F [kN]", "t_s,x_mm,F_kN", "t,x [mm],F (kN)"])
def test_the_header_names_symbols_and_units(write, header) -> None:
    path = write("run.csv", text(header, SINE, 2 * SINE))
    data = load(path, DataOptions(columns={"u": "x", "y": "F"}))
    assert data.quantities == DAMPER
    np.testing.assert_allclose(data.records[0].u_V, SINE, rtol=1e-8)


def test_a_header_in_millivolts_and_nanometres_is_converted_and_said(write) -> None:
    data = load(write("run.csv", text("t [ms],u_mV,y (nm)", SINE, 2 * SINE)))
    (record,) = data.records
    assert data.quantities == Quantities()
    assert record.ts_s == pytest.approx(1e-5)
    np.testing.assert_allclose(record.u_V, 1e-3 * SINE, rtol=1e-8)
    np.testing.assert_allclose(record.y_um, 2e-3 * SINE, rtol=1e-8)
    assert "column y (nm) (y) is in nm, as its name says" in record.remarks


def test_what_the_user_says_overrides_the_header(write) -> None:
    path = write("run.csv", text("t,u,y [nm]", SINE, SINE))
    (record,) = load(path, DataOptions(units={"y": "um"})).records
    np.testing.assert_allclose(record.y_um, SINE, rtol=1e-8)


@over("name", ["y_m", "u_max", "y (measured)", "y_ref"])
def test_what_only_looks_like_a_unit_is_none(write, name) -> None:
    path = write("run.csv", text(f"t,u,{name}", SINE, SINE))
    data = load(path, DataOptions(columns={"y": name}))
    assert data.quantities == Quantities()
    np.testing.assert_allclose(data.records[0].y_um, SINE, rtol=1e-8)


def test_a_unit_of_another_quantity_is_not_converted(write) -> None:
    path = write("run.csv", text("t,u,y", SINE, 2 * SINE))
    data = load(path, DataOptions(units=parse_units("u=mm,y=kN")))
    assert (data.quantities.input.name, data.quantities.input.unit) == ("displacement", "mm")
    assert (data.quantities.output.name, data.quantities.output.unit) == ("force", "kN")
    np.testing.assert_allclose(data.records[0].u_V, SINE, rtol=1e-8)


def test_a_unit_is_turned_into_the_one_that_is_shown(write) -> None:
    path = write("run.csv", text("t,u,y", SINE, 2 * SINE))
    write("dataset.toml", TOML)
    (record,) = load(path, DataOptions(units={"y": "N", "u": "m"})).records
    np.testing.assert_allclose(record.y_um, 2e-3 * SINE, rtol=1e-8)
    np.testing.assert_allclose(record.u_V, 1e3 * SINE, rtol=1e-8)


def test_units_are_resolved_file_by_file(write, tmp_path) -> None:
    write("one.csv", text("t,u,y [kN]", SINE, SINE))
    write("two.csv", text("t,u,y [N]", SINE, 1e3 * SINE))
    one, two = load(tmp_path).records
    np.testing.assert_allclose(one.y_um, two.y_um, rtol=1e-8)
    write("two.csv", text("t,u,y [mm]", SINE, SINE))
    with pytest.raises(InputError, match=r"two\.csv.*unit 'mm' of y is not turned into kN"):
        load(tmp_path)


@over(
    "toml, said",
    [
        (
            "[quantities]\ninputs = {}",
            r"quantities: 'inputs' is unknown \(did you mean 'input'\?\)",
        ),
        ("[quantities]\noutput = 'kN'", r"quantities.output is 'kN'; expected an object"),
        ("[quantities]\noutput = { units = 'kN' }", r"quantities.output: 'units' is unknown"),
        ("[quantities]\noutput = { name = 'force' }", "'force', has no unit; give it one"),
        ("[quantities]\noutput = { unit = 'furlong' }", "in 'furlong' has no name; give it one"),
        ("[quantities]\noutput = { unit = '' }", "quantities.output.unit is ''; give 1 to 30 char"),
        ("[quantities]\noutput = { unit = 3 }", "quantities.output.unit is 3; expected text"),
        (
            "[units]\ny = 'mm'\n[quantities]\noutput = { unit = 'kN' }",
            "shown in 'kN' while column y is in 'mm'",
        ),
        ("[columns]\ninputs = ['a', 'a']", "columns.inputs is .*; give different names"),
        ("[columns]\ninputs = [3]", r"columns.inputs\[0\] is 3; expected text"),
    ],
)
def test_what_is_wrong_in_dataset_toml_is_one_line(write, refusal, toml, said) -> None:
    path = write("run.csv", text("t,u,y", SINE, SINE))
    write("dataset.toml", toml)
    with pytest.raises(InputError, match=said):
        load(path)
    assert "dataset.toml" in refusal(path)


def test_several_inputs_are_kept_beside_the_one_that_is_used(write) -> None:
    path = write("run.csv", text("t,u1,u2,y", SINE, 5 * SINE, 2 * SINE))
    (record,) = load(path).records
    np.testing.assert_allclose(record.u_V, SINE, rtol=1e-8)
    assert list(record.others) == ["u2"]
    np.testing.assert_allclose(record.others["u2"], 5 * SINE, rtol=1e-8)
    assert any("kept beside it: u2 (--input chooses)" in remark for remark in record.remarks)
    (record,) = load(path, DataOptions(input="u2")).records
    np.testing.assert_allclose(record.u_V, 5 * SINE, rtol=1e-8)
    assert list(record.others) == ["u1"]


def test_dataset_toml_lists_inputs_of_any_name(write) -> None:
    path = write("run.csv", text("t,left,right,y", SINE, 5 * SINE, 2 * SINE))
    write("dataset.toml", '[columns]\ninputs = ["left", "right"]\n')
    assert list(load(path).records[0].others) == ["right"]
    assert list(load(path, DataOptions(input="right")).records[0].others) == ["left"]
    with pytest.raises(InputError, match="column middle"):
        load(path, DataOptions(input="middle"))


def test_arrays_of_several_inputs(tmp_path) -> None:
    t = 0.01 * np.arange(60)
    np.savez(tmp_path / "run.npz", t=t, u1=SINE, u2=5 * SINE, y_nm=2 * SINE)
    (record,) = load(tmp_path / "run.npz").records
    np.testing.assert_allclose(record.y_um, 2e-3 * SINE)
    np.testing.assert_allclose(record.others["u2"], 5 * SINE)


def test_options_refuse_two_inputs() -> None:
    with pytest.raises(InputError, match="--input 'u2': give the name of one column"):
        DataOptions(columns={"u": "u1"}, input="u2")


def test_what_is_written_is_read_back_with_its_quantities(write, tmp_path) -> None:
    path = write("run.csv", text("t,u1,u2,y", SINE, 5 * SINE, 2 * SINE))
    write("dataset.toml", TOML)
    data = rg.load(path)
    for again in (
        rg.load(data.write(tmp_path / "out")),
        rg.load_result(data.save(tmp_path / "a.npz")),
    ):
        assert again.quantities == DAMPER
        np.testing.assert_allclose(again.records[0].others["u2"], 5 * SINE, rtol=1e-8)


@over("turned", [False, True])
@over("kind", ["npz", "mat"])
def test_a_variable_of_several_channels_holds_several_inputs(tmp_path, kind, turned) -> None:
    u = np.column_stack((SINE, 5 * SINE, -SINE))
    save = {"npz": np.savez, "mat": lambda path, **columns: savemat(path, columns)}[kind]
    path = tmp_path / f"run.{kind}"
    save(path, t=0.01 * np.arange(60), u=u.T if turned else u, y=2 * SINE)
    (record,) = load(path).records
    np.testing.assert_allclose(record.u_V, SINE)
    assert list(record.others) == ["u2", "u3"]
    (record,) = load(path, DataOptions(input="u2")).records
    np.testing.assert_allclose(record.u_V, 5 * SINE)
    np.testing.assert_allclose(record.others["u3"], -SINE)
