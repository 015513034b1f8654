"""Damaged files of every kind, each with its share of 7,500; and a fuzzer that can find something."""

from __future__ import annotations

import json
import os
import sys
import zipfile
import zlib
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from rdpi_gym.support.errors import InputError
from tests.fuzz.readers import DAMAGED, GROUPS, STRUCTURED, Case, Subject, subject
from tests.fuzz.running import run_case, watched
from tests.fuzz.structure import (
    Attacks,
    Document,
    archive,
    npy,
    packed_archive,
    shuffled,
    zip_words,
)

SEED = int(os.environ.get("RDPI_FUZZ_SEED", "0"))
CASES = {name: count // 8 for name, count in DAMAGED.items()} | {
    name: count // 4 for name, count in STRUCTURED.items()
}
"""A part of the shares of `make fuzz`, which finds in a night what is rare."""


def test_each_kind_of_attack_has_its_share() -> None:
    assert sum(DAMAGED.values()) == sum(STRUCTURED.values()) == 20_000
    assert 7_400 < sum(CASES.values()) <= 2_500 + 5_000


@pytest.mark.parametrize("group", GROUPS)
def test_a_reader_gives_a_value_or_one_line_and_nothing_else(group, capsys) -> None:
    if group == "learned":
        pytest.importorskip("stable_baselines3")
    jobs = [(name, range(CASES[name])) for name in GROUPS[group]]
    wrong = watched(SEED, jobs)
    printed = capsys.readouterr().out
    assert wrong == 0, printed
    for name, cases in jobs:
        assert f"DONE {name}, seed {SEED}: {len(cases)} cases" in printed


def test_a_case_is_always_the_same_file(tmp_path) -> None:
    for name in (
        "csv",
        "npz",
        "matlab-v5",
        "matlab-v7.3",
        "signal",
        "npz/structure",
        "result/structure",
    ):
        written = []
        for turn in range(2):
            with subject(name) as made:
                for case in range(20):
                    folder = tmp_path / f"{name.replace('/', ' ')} {turn} {case}"
                    folder.mkdir()
                    made.write(Case(name, 7, case), folder)
                    files = [path for path in sorted(folder.iterdir()) if path.is_file()]
                    written.append([path.read_bytes() for path in files if not path.is_symlink()])
        assert written[:20] == written[20:], name
        assert len({b"".join(files) for files in written}) > 10, name


def test_every_attack_comes_once_and_then_two_at_a_time() -> None:
    assert {shuffled(5, 12, number) for number in range(12)} == set(range(12))
    tree = {"plant": {"name": "a", "n": "3"}, "taps": [1, 2, 3, 4, 5, 6]}
    document = Document(tree, lambda tree: json.dumps(tree).encode(), lambda _, raw: {"a": raw})
    attacks = Attacks([document])
    said = [attacks.case(7, number)["a"] for number in range(1 + len(attacks))]
    assert json.loads(said[0]) == tree
    assert len(set(said)) > 0.9 * len(said)
    found = [json.loads(each) for each in said]
    for changed in (
        {"taps": tree["taps"]},
        {**tree, "taps": [2**63, 2, 3, 4, 5, 6]},
        {**tree, "plant": {"name": "a", "n": str(2**32 - 1)}},
        {**tree, "plant": {"name": "a", "n": "3", "unknown": 1}},
        {**tree, "plant": [tree["plant"]]},
    ):
        assert found.count(changed) == 1
    assert attacks.case(7, len(said)) == attacks.case(7, len(said))


def test_archives_of_attacks_are_those_that_numpy_and_zipfile_read(tmp_path) -> None:
    header = {"descr": "<f8", "fortran_order": False, "shape": [2], "version": [1, 0]}
    content = npy(header, np.array([1.0, 2.0]).tobytes())
    plain = archive({"a.npy": content})
    packed = zlib.compressobj(wbits=-15)
    deflated = packed.compress(content) + packed.flush()
    for raw in (plain, packed_archive({"a.npy": (deflated, len(content))})):
        (tmp_path / "a.npz").write_bytes(raw)
        with zipfile.ZipFile(tmp_path / "a.npz") as file:
            stream = file.open("a.npy")
            stream._expected_crc = None  # of the packed one it is left out
            assert np.load(BytesIO(stream.read(len(content)))).tolist() == [1.0, 2.0]
        words = {int.from_bytes(raw[at : at + size], "little") for at, size in zip_words(raw)}
        assert {len(content), len("a.npy"), 1, 20} <= words


def test_memory_beyond_the_limit_is_a_finding_even_in_one_line(tmp_path) -> None:
    def read(folder):
        try:
            bytearray(2**29)
        except MemoryError as error:
            raise InputError("a.csv is damaged") from error

    said = run_case(reader(read), "any", 0, 0, tmp_path / "f", limited=True)
    assert said.startswith("it takes more than 256 MiB: 'a.csv is damaged'")
    assert run_case(reader(read), "any", 0, 0, tmp_path / "f") == "value"


def reader(read) -> Subject:
    return Subject(lambda rng, folder: (folder / "a").write_bytes(b"a"), read)


def refuse(message: str) -> None:
    raise InputError(message)


def test_a_finding_is_all_but_a_value_and_a_short_line(tmp_path) -> None:
    for read, said in (
        (lambda folder: 1, "value"),
        (lambda folder: refuse("a.csv: no number; give one"), "refused"),
        (lambda folder: refuse("x" * 400), "refused"),  # it shows both ends of a line that long
        (lambda folder: refuse(""), "a line of 0 characters"),
        (lambda folder: 1 / 0, "ZeroDivisionError"),
        (lambda folder: (folder / "b").read_bytes(), "FileNotFoundError"),
        (lambda folder: bytearray(2**62), "MemoryError"),
        (lambda folder: Path("a\0b").stat(), "ValueError"),
    ):
        assert said in run_case(reader(read), "any", 0, 0, tmp_path / "f")


def test_a_process_that_crashes_is_a_finding_and_the_next_case_is_run(capsys) -> None:
    program = """
import json, os, sys
for name, first, end in json.loads(sys.argv[-1]):
    for case in range(first, end):
        print(f"case {name} {case}", flush=True)
        if (name, case) == ("csv", 2):
            os.abort()
    print(f"DONE {name} from {first}", flush=True)
"""
    jobs = [("npz", range(2)), ("csv", range(5)), ("plant", range(1))]
    assert watched(3, jobs, [sys.executable, "-c", program]) == 1
    printed = capsys.readouterr().out
    assert "WRONG python -m tests.fuzz csv --seed 3 --case 2\nended with -6" in printed
    assert [line for line in printed.splitlines() if line.startswith("DONE")] == [
        "DONE npz from 0", "DONE csv from 3", "DONE plant from 0",
    ]  # fmt: skip
