"""Whatever happens to a file on its way: it is read, or refused with one line, never a traceback."""

from __future__ import annotations

from functools import partial

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import savemat

from rdpi_gym.measurement import Dataset, load
from rdpi_gym.measurement.binary import read_matlab, read_npz
from rdpi_gym.measurement.matlab import MatlabReader
from rdpi_gym.support.errors import InputError
from tests.looping import over

T = 0.02 * np.arange(40)
COLUMNS = {"t": T, "u": np.sin(T), "y": np.cos(T)}
TEXT = "t,u,y\n" + "\n".join(f"{t:.2f},{np.sin(t):.5f},{np.cos(t):.5f}" for t in T)


def read_or_refuse(path) -> None:
    try:
        assert isinstance(load(path), Dataset)
    except InputError as error:
        line = str(error)
        assert path.name in line
        assert "\n" not in line


@given(st.data())
def test_damaged_text(tmp_path_factory, data) -> None:
    raw = bytearray(TEXT.encode())
    pieces = st.sampled_from(
        [b",", b"\n", b"\r", b'"', b";", b" ", b"\t", b"nan", b"1e400", b"0,5"]
    )
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(raw)))
        removed = data.draw(st.integers(0, 30))
        raw[at : at + removed] = data.draw(pieces | st.binary(max_size=3))
    path = tmp_path_factory.mktemp("damaged") / "run.csv"
    path.write_bytes(raw)
    read_or_refuse(path)


def test_a_quotation_mark_that_is_not_closed(write, refusal) -> None:
    line = refusal(write("run.csv", TEXT.replace("0.20,", '"0.20,')))
    assert "run.csv, line 12: a quotation mark is not closed" in line


@over("name", ["v5.mat", "compressed.mat", "v73.mat", "run.npz"])
def test_binary_files_cut_off_anywhere(tmp_path, name) -> None:
    path = tmp_path / name
    if name == "v73.mat":
        with h5py.File(path, "w") as file:
            for key, values in COLUMNS.items():
                file[key] = values
    elif name == "run.npz":
        np.savez(path, **COLUMNS)
    else:
        savemat(path, COLUMNS, do_compression=name == "compressed.mat")
    whole = path.read_bytes()
    with MatlabReader() as reader:  # one for all: each takes a process
        read = read_npz if name == "run.npz" else partial(read_matlab, reader=reader)
        read(path, {})
        for kept in range(0, len(whole), 37):
            path.write_bytes(whole[:kept])
            with pytest.raises(InputError) as caught:
                read(path, {})
            assert name in str(caught.value)
            assert "\n" not in str(caught.value)
