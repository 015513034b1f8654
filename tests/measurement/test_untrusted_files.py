"""Files that were made to do harm: nothing runs, nothing hangs, no memory is taken for them."""

from __future__ import annotations

import gzip
import io
import os
import subprocess
import sys
import tracemalloc
import zipfile
from collections.abc import Callable
from contextlib import contextmanager, suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from rdpi_gym.measurement import load, matlab
from rdpi_gym.measurement.matlab import MatlabReader
from rdpi_gym.support.errors import InputError
from tests.looping import over

T = 0.02 * np.arange(40)
COLUMNS = {"t": T, "u": np.sin(T), "y": np.cos(T)}
TEXT = "t,u,y\n" + "".join(f"{t:.2f},{np.sin(t):.5f},{np.cos(t):.5f}\n" for t in T)
TYPE_OF_THE_FIRST_ARRAY = 176  # of its numbers, in a file of savemat


@pytest.fixture
def crashing(tmp_path) -> Path:
    """A MATLAB file with one wrong byte, on which scipy's reader ends the process."""
    path = tmp_path / "run.mat"
    savemat(path, COLUMNS)
    content = bytearray(path.read_bytes())
    assert content[TYPE_OF_THE_FIRST_ARRAY] == 9  # doubles
    content[TYPE_OF_THE_FIRST_ARRAY] = 8  # a type that does not exist
    path.write_bytes(content)
    return path


def test_a_matlab_file_that_crashes_its_reader_is_one_line(crashing, refusal) -> None:
    line = refusal(crashing)
    assert "run.mat cannot be read as MATLAB file (it ends the program that reads it, SIG" in line


def test_after_a_crash_the_next_file_is_read(crashing) -> None:
    whole = crashing.with_name("whole.mat")
    savemat(whole, COLUMNS)
    with MatlabReader() as reader:
        with pytest.raises(ValueError, match="ends the program"):
            reader.read(crashing, ["u", "t"])
        np.testing.assert_array_equal(reader.read(whole, ["u"]).values["u"].ravel(), COLUMNS["u"])


WAITING = "import time; time.sleep(60)"
WORKING = """
from rdpi_gym.measurement import matlab_child as child
child.read_v5 = lambda *_: all(iter(lambda: 1, 0))
child.main()
"""


@over("program, limit_s, patience", [(WAITING, 0.2, 1.0), (WORKING, 0.2, 1e3)])
def test_a_matlab_file_that_takes_too_long_is_given_up(
    program, limit_s, patience, tmp_path, refusal, monkeypatch
) -> None:
    def start() -> subprocess.Popen[bytes]:
        command = [sys.executable, "-c", program]
        return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    monkeypatch.setattr(matlab, "_start", start)
    monkeypatch.setattr(matlab, "LIMIT_S", limit_s)
    monkeypatch.setattr(matlab, "_PATIENCE", patience)
    savemat(tmp_path / "run.mat", COLUMNS)
    assert "(it is not read within 0 s)" in refusal(tmp_path / "run.mat")


def test_a_folder_of_matlab_files_takes_one_process(tmp_path, monkeypatch) -> None:
    started, start = [], matlab._start
    monkeypatch.setattr(matlab, "_start", lambda: started.append(start()) or started[-1])
    for name in ("one", "two", "three"):
        savemat(tmp_path / f"{name}.mat", COLUMNS)
    assert len(load(tmp_path).records) == 3
    assert [process.returncode is not None for process in started] == [True]


def test_what_lies_beside_the_data_is_not_imported(tmp_path, monkeypatch) -> None:
    for name in ("numpy", "scipy", "json"):
        (tmp_path / f"{name}.py").write_text("open('ran', 'w')")
    savemat(tmp_path / "run.mat", COLUMNS)
    monkeypatch.chdir(tmp_path)
    load("run.mat")
    assert not Path("ran").exists()


def test_a_matlab_variable_that_expands_beyond_its_file(tmp_path, refusal) -> None:
    savemat(tmp_path / "run.mat", {**COLUMNS, "y": np.zeros(20_000_000)}, do_compression=True)
    assert (tmp_path / "run.mat").stat().st_size < 300_000
    line = refusal(tmp_path / "run.mat")
    assert "run.mat, variable y: 153 MiB of numbers, where what is read of this file may" in line


def test_a_matlab_variable_that_nobody_asks_for_is_not_read(tmp_path) -> None:
    variables = {**COLUMNS, "picture": np.zeros(30_000_000)}
    savemat(tmp_path / "run.mat", variables, do_compression=True)
    assert load(tmp_path / "run.mat").records[0].u_V.size == 40


def test_a_struct_that_takes_more_memory_than_its_file_may(tmp_path, refusal, monkeypatch) -> None:
    monkeypatch.setattr(matlab, "largest_expansion", lambda size: 2**24)
    struct = {**COLUMNS, "picture": np.zeros(20_000_000)}
    savemat(tmp_path / "run.mat", {"measurement": struct}, do_compression=True)
    assert "run.mat takes more than 64 MiB to read" in refusal(tmp_path / "run.mat")


def npy(array) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def npy_head(*shape: int) -> bytes:
    stream = io.BytesIO()
    stated = {"descr": "<f8", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, stated)
    return stream.getvalue()


def archive(path: Path, **changed: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as stream:
        for name, content in ({key: npy(v) for key, v in COLUMNS.items()} | changed).items():
            stream.writestr(f"{name}.npy", content)
    return path


def test_an_array_that_nobody_asks_for_is_not_read(tmp_path) -> None:
    path = archive(tmp_path / "run.npz", notes=npy(np.array([{}], dtype=object)), junk=b"junk")
    assert load(path).records[0].u_V.size == 40


def test_an_archive_that_expands_to_gigabytes(tmp_path, refusal) -> None:
    path = archive(tmp_path / "run.npz", y=npy_head(400_000_000) + bytes(1000))
    assert "run.npz, 'y': expands to 3052 MiB; what is read of this file" in refusal(path)


def test_bytes_count_as_the_doubles_that_they_become(tmp_path, refusal, monkeypatch) -> None:
    monkeypatch.setattr("rdpi_gym.support.npz.FREE_BYTES", 2**20)
    monkeypatch.setattr("rdpi_gym.support.npz.EXPANSION", 1)
    path = archive(tmp_path / "run.npz", y=npy(np.zeros(2**18, dtype=np.int8)))
    assert "run.npz, 'y': expands to 0 MiB" in refusal(path)


@contextmanager
def taking_at_most(most_bytes: int):
    """Fail where the statements inside take more memory."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < most_bytes
    finally:
        tracemalloc.stop()


@over("shape", [(-2,), (-1,), (-2, 3), (-2, -20)])
def test_a_side_below_zero_is_refused_before_anything_is_read(tmp_path, refusal, shape) -> None:
    path = archive(tmp_path / "run.npz", y=npy_head(*shape) + bytes(2**26))
    with taking_at_most(2**22):
        assert "'y' has a side below 0" in refusal(path)


def test_a_list_of_arrays_that_fills_the_memory_is_not_read(tmp_path, refusal) -> None:
    path = tmp_path / "run.npz"
    with zipfile.ZipFile(path, "w") as stream:
        for number in range(30_000):
            stream.writestr(f"{number}", b"")
    with taking_at_most(2**23):
        assert "its list of arrays has more than 1 MiB" in refusal(path)


def test_an_array_shorter_than_its_header_says(tmp_path, refusal) -> None:
    path = archive(tmp_path / "run.npz", y=npy(np.zeros(40))[:-8])
    assert "'y' does not hold the 320 bytes that its header states" in refusal(path)


def v73(path: Path, without: str = "y") -> h5py.File:
    file = h5py.File(path, "w")
    for name, values in COLUMNS.items():
        if name != without:
            file[name] = values
    return file


def elsewhere(kind: str, folder: Path) -> Callable[[h5py.File], object]:
    """Return what puts a `y` into a file whose numbers lie in another one."""
    if kind == "external":
        (folder / "secret").write_bytes(bytes(320))
        place = (str(folder / "secret"), 0, h5py.h5f.UNLIMITED)
        return lambda file: file.create_dataset("y", (40,), dtype="f8", external=[place])
    with h5py.File(folder / "other.h5", "w") as other:
        other["y"] = COLUMNS["y"]
    virtual = h5py.VirtualLayout((40,), dtype="f8")
    virtual[:] = h5py.VirtualSource(folder / "other.h5", "y", (40,))
    return lambda file: file.create_virtual_dataset("y", virtual)


@over("kind", ["external", "virtual"])
def test_a_data_set_that_lies_in_another_file_is_not_read(tmp_path, refusal, kind) -> None:
    with v73(tmp_path / "run.mat") as file:
        elsewhere(kind, tmp_path)(file)
    assert "run.mat, variable y: its numbers lie in another file" in refusal(tmp_path / "run.mat")


@over("link", [h5py.SoftLink("/u"), h5py.ExternalLink("other.h5", "/y")])
def test_links_are_not_followed(tmp_path, refusal, link) -> None:
    with v73(tmp_path / "run.mat") as file:
        file["y"] = link
    assert "run.mat, variable y: a link to another place" in refusal(tmp_path / "run.mat")


def test_groups_that_hold_each_other(tmp_path) -> None:
    with v73(tmp_path / "run.mat", without="") as file:
        file.create_group("a/b/c")
        file["a/b/c/again"] = file["a"]
        file["a/b/top"] = file["/"]
    assert load(tmp_path / "run.mat").records[0].u_V.size == 40


def test_a_huge_data_set_is_read_only_if_asked_for_and_then_refused(tmp_path, refusal) -> None:
    with v73(tmp_path / "run.mat", without="") as file:
        file.create_dataset("picture", (6 * 2**27,), dtype="f8", chunks=(2**16,))
    assert load(tmp_path / "run.mat").records[0].u_V.size == 40
    with h5py.File(tmp_path / "run.mat", "a") as file:
        file.move("y", "z")
        file.move("picture", "y")
    assert "run.mat, variable y: 6144 MiB of numbers" in refusal(tmp_path / "run.mat")


@over("make", [lambda path: os.mkfifo(path), lambda path: path.symlink_to("/dev/zero")])
@over("name", ["run.csv", "run.mat", "run.npz", "dataset.toml"])
def test_a_fifo_or_a_link_to_a_device_in_a_folder_of_data(tmp_path, refusal, name, make) -> None:
    (tmp_path / "whole.csv").write_text(TEXT)
    make(tmp_path / name)
    assert f"{name} is no regular file" in refusal(tmp_path)
    (tmp_path / name).unlink()


def test_an_empty_path_is_not_the_current_folder(tmp_path, refusal, monkeypatch) -> None:
    (tmp_path / "run.csv").write_text(TEXT)
    monkeypatch.chdir(tmp_path)
    assert "the path of the data is empty" in refusal("")


def test_a_name_that_a_terminal_would_obey(tmp_path, refusal) -> None:
    (tmp_path / "run\x1b[2J.csv").write_text(TEXT)
    line = refusal(tmp_path)
    assert r"run\x1b[2J.csv: the name holds control characters" in line


@over(
    "text, toml, said",
    [
        *(
            (text, "", said)
            for text, said in [
                (TEXT.replace("0.20,", "0." + "2" * 200_000 + ","), "line 12: 200018 characters"),
                (TEXT.replace("0.20,", "9" * 5000 + ","), "is no finite number"),
                (TEXT.replace("0.20,", str(10**400) + ","), "is no finite number"),
                (
                    TEXT.replace("0.20,", "0.20,1e200,").replace(",0.19867", ""),
                    "too large for a measurement",
                ),
                (TEXT.replace("0.20,", "0.2\0,"), "a NUL character"),
                (TEXT.replace("t,", "x" * 50_000 + ","), "missing (time in s)"),
                (TEXT.replace("0.20,", "\x1b[2J,"), r"'\x1b[2J' is not a number"),
                (TEXT.replace("0.20,", "x" * 5_000 + ","), "is not a number"),
            ]
        ),
        *(
            (TEXT, toml, said)
            for toml, said in [
                ("title = " + "[" * 10_000, "nested too deep"),
                ("a." * 5_000 + "a = 1", "unknown"),
                ("skip_s = " + "9" * 5000, "not TOML"),
                (f"skip_s = {10**400}", "skip_s is 1000"),
                (f"[columns]\nu = {10**400}", "columns.u is 1000"),
                (f"[records.run]\nmask_s = [[0, {10**400}]]", "mask_s[0][1] is 1000"),
                (
                    'title = "\\u001b]0;gone\\u0007"',
                    r"'\x1b]0;gone\x07'; give text without control characters",
                ),
                ('[records.run]\nnote = "\\u202e"', "note is '\\u202e'; give text without"),
                ("x" * 5_000 + " = 1", "is unknown"),
                ("title = 1\n" + "#" * 2**20, "1 MiB at most"),
            ]
        ),
    ],
)
def test_text_and_dataset_toml(write, refusal, text, toml, said) -> None:
    write("dataset.toml", toml)
    line = refusal(write("run.csv", text))
    assert said in line
    assert len(line) < 400


@over("name", ["run.csv.gz", "run.TXT.GZ", "run.dat.gz", "run.tsv.gz"])
def test_a_compressed_text_is_read_as_the_text(tmp_path, write, name) -> None:
    (tmp_path / name).write_bytes(gzip.compress(TEXT.encode()))
    (plain,), (packed,) = load(write("plain.csv", TEXT)).records, load(tmp_path / name).records
    assert packed.name == "run"
    np.testing.assert_array_equal(packed.y_um, plain.y_um)


@over(
    "content, said",
    [
        (gzip.compress(TEXT.encode())[:-9], "cannot be read as gzip (Compressed file ended"),
        (TEXT.encode(), "cannot be read as gzip (Not a gzipped file"),
        (gzip.compress(gzip.compress(TEXT.encode())), "not UTF-8 text"),
        (gzip.compress(b""), "the file ends before its first value"),
        (b"", "the file ends before its first value"),
    ],
)
def test_a_compressed_text_that_is_damaged(tmp_path, refusal, content, said) -> None:
    (tmp_path / "run.csv.gz").write_bytes(content)
    assert said in refusal(tmp_path / "run.csv.gz")


def test_a_compressed_text_that_expands_beyond_its_file(tmp_path, refusal) -> None:
    (tmp_path / "run.csv.gz").write_bytes(gzip.compress(bytes(2**28), 1))
    with taking_at_most(2**27 + 2**26):
        assert "expands to more than 128 MiB" in refusal(tmp_path / "run.csv.gz")


def test_any_wrong_byte_of_a_compressed_text_is_read_or_refused(tmp_path) -> None:
    path, whole = tmp_path / "run.csv.gz", gzip.compress(TEXT.encode(), mtime=0)
    read = 0
    for place in range(0, len(whole), 3):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x55]) + whole[place + 1 :])
        with suppress(InputError):
            load(path)
            read += 1
    assert read < 8  # fields of the header that mean nothing to a reader: the time, the system


@over("name", ["run.gz", "run.npz.gz", "run.csv.gz.gz", "run.tar.gz", "run.zip", "run.csv.bz2"])
def test_an_archive_of_another_kind_is_one_line(tmp_path, refusal, name) -> None:
    (tmp_path / name).write_bytes(gzip.compress(TEXT.encode()))
    assert "are not read; give a folder or one of .csv, " in refusal(tmp_path / name)


def test_a_text_beside_its_compressed_copy_is_one_record_twice(tmp_path, write, refusal) -> None:
    write("run.csv", TEXT)
    (tmp_path / "run.csv.gz").write_bytes(gzip.compress(TEXT.encode()))
    assert "are both record 'run'" in refusal(tmp_path)


@over("kept", [1, 3, 5])
def test_a_last_value_that_was_cut_off_is_said(write, kept) -> None:
    (whole,) = load(write("run.csv", TEXT)).records
    assert whole.remarks == ()
    (cut,) = load(write("run.csv", TEXT[: -1 - kept])).records
    assert cut.remarks == (
        f"the file ends without a line break, so its last line ({TEXT.splitlines()[-1][:-kept]}) "
        "may be cut off",
    )


def test_the_index_of_a_repetition_that_no_index_holds(write, refusal) -> None:
    lines = [f"{line},{k}" for k, line in enumerate(TEXT.splitlines()[1:])]
    lines[7] = lines[7].removesuffix(",7") + ",1e30"
    line = refusal(write("run.csv", "\n".join(["t,u,y,period", *lines, ""])))
    assert "run.csv, line 9, column period: 1e+30 is no index of a repetition" in line
