"""MATLAB v5 and v7.3 files and NumPy archives: the same record, and what is refused."""

from __future__ import annotations

import h5py
import numpy as np
from scipy.io import savemat
from scipy.sparse import csr_array

from rdpi_gym.measurement import DataOptions, load
from tests.looping import over

T = 0.02 * np.arange(40)
U = np.sin(2 * np.pi * T)
COLUMNS = {"t": T, "u": U, "y": 8 * U}


def save(path, variables) -> None:
    """Write v5 (.mat), v7.3 (name ends in 73.mat: user block and reversed axes) or npz."""
    if path.suffix == ".npz":
        np.savez(path, **variables)
    elif path.stem.endswith("73"):
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, value in variables.items():
                group = file.create_group(name) if isinstance(value, dict) else file
                for key, array in value.items() if isinstance(value, dict) else [(name, value)]:
                    group.create_dataset(key, data=np.asarray(array).T)
        with path.open("r+b") as stream:
            stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    else:
        savemat(path, variables)


every_format = over("name", ["run.mat", "run73.mat", "run.npz"])


@every_format
@over("shape", [(-1,), (1, -1), (-1, 1)])
def test_rows_and_columns(tmp_path, name, shape) -> None:
    save(tmp_path / name, {key: value.reshape(shape) for key, value in COLUMNS.items()})
    (record,) = load(tmp_path / name).records
    np.testing.assert_allclose(record.t_s, T, atol=1e-15)
    np.testing.assert_array_equal(record.u_V, U)
    np.testing.assert_array_equal(record.y_um, 8 * U)


@every_format
def test_other_names_units_optional_columns(tmp_path, name) -> None:
    variables = {
        "volts": U,
        "y": 8e-6 * U,
        "reference": 7 * U,
        "temperature": 20 + U,
        "period": np.arange(40, dtype=np.uint8) // 20,
        "unrelated": np.zeros((3, 4)),
    }
    save(tmp_path / name, variables)
    options = DataOptions(columns={"u": "volts"}, units={"y": "m"}, sampling_time_s=0.02)
    (record,) = load(tmp_path / name, options).records
    np.testing.assert_allclose(record.y_um, 8 * U, atol=1e-12)
    np.testing.assert_array_equal(record.reference_um, 7 * U)
    np.testing.assert_array_equal(record.temperature_C, 20 + U)
    np.testing.assert_array_equal(record.period, np.arange(40) // 20)
    np.testing.assert_allclose(record.t_s, T, atol=1e-15)


@over("name", ["run.mat", "run73.mat"])
def test_one_struct_that_holds_the_columns(tmp_path, name) -> None:
    save(tmp_path / name, {"measurement": COLUMNS, "gain": np.ones((1, 1))})
    np.testing.assert_array_equal(load(tmp_path / name).records[0].u_V, U)


@every_format
@over(
    "changed, options, said",
    [
        ({"y": None, "displacement": U}, {}, ", variable y: missing (displacement in µm); the file has"),
        ({"y": None, "displacement": U}, {}, "--columns y=..."),
        ({"y": np.zeros((40, 2))}, {}, ", variable y: shape"),
        ({"y": U + 1j}, {}, ", variable y: no array of real numbers"),
        ({"y": U[1:]}, {}, ", variable y: 39 values where variable u has 40"),
        (
            {"y": np.where(np.arange(40) == 17, np.inf, U)}, {},
            ", element 17 (counted from 0), variable y: inf is no finite number",
        ),
        ({}, {"u": 1}, ", variable u: position 1 means nothing here"),
        (dict.fromkeys(COLUMNS, np.zeros(0)), {}, "the record ends after 0 samples; give 16 or more"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(tmp_path, refusal, name, changed, options, said) -> None:
    variables = {key: value for key, value in (COLUMNS | changed).items() if value is not None}
    save(tmp_path / name, variables)
    line = refusal(tmp_path / name, DataOptions(columns=options))
    assert (f"{name}{said}" if said.startswith(",") else said) in line


@every_format
def test_a_file_that_was_cut_off_or_is_of_another_kind(tmp_path, refusal, name) -> None:
    save(tmp_path / name, COLUMNS)
    whole = (tmp_path / name).read_bytes()
    for content in (whole[: len(whole) // 2], b"t,u,y\n" * 200):
        (tmp_path / name).write_bytes(content)
        assert f"{name} cannot be read as" in refusal(tmp_path / name)


def test_pickled_objects_and_an_array_without_a_name_are_refused(tmp_path, refusal) -> None:
    np.savez(tmp_path / "run.npz", **{**COLUMNS, "y": np.array([object()] * 40)})
    line = refusal(tmp_path / "run.npz")
    assert "cannot be read as npz file ('y' holds Python objects, which are not read)" in line
    with (tmp_path / "run.npz").open("wb") as stream:
        np.save(stream, U)
    assert "one array without a name" in refusal(tmp_path / "run.npz")


@over("other", ["text", csr_array(np.diag(U)), np.array([{}], dtype=object)])
def test_matlab_variables_that_hold_no_numbers(tmp_path, refusal, other) -> None:
    savemat(tmp_path / "run.mat", {**COLUMNS, "y": other})
    assert "run.mat, variable y: no array of real numbers" in refusal(tmp_path / "run.mat")


def test_matlab_characters_in_a_v73_file(tmp_path, refusal) -> None:
    with h5py.File(tmp_path / "run.mat", "w") as file:
        for name, value in COLUMNS.items():
            file[name] = value
        del file["y"]
        file["y"] = np.arange(40, dtype=np.uint16)
        file["y"].attrs["MATLAB_class"] = np.bytes_("char")
    assert "run.mat, variable y: no array of real numbers" in refusal(tmp_path / "run.mat")
