"""Damaged files of every kind, each with its share of 20,000; and a fuzzer that can find something."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from random import Random

import pytest

from rdpi_gym.support.errors import InputError
from tests.fuzz.running import run_case, watched
from tests.fuzz.subjects import SHARES, Subject, subject

SEED = int(os.environ.get("RDPI_FUZZ_SEED", "0"))


def test_shares() -> None:
    assert sum(SHARES.values()) == 20_000


@pytest.mark.parametrize("name", SHARES)
def test_a_value_or_one_line_and_nothing_else(name, capsys) -> None:
    if name in ("policy", "hyperparameters"):
        pytest.importorskip("stable_baselines3")
    wrong = watched(name, SEED, range(SHARES[name]))
    printed = capsys.readouterr().out
    assert wrong == 0, printed
    assert f"{SHARES[name]} cases" in printed


@pytest.mark.parametrize("name", ["csv", "npz", "matlab-v5", "matlab-v7.3", "signal"])
def test_a_case_is_always_the_same_file(name, tmp_path) -> None:
    written = []
    for _ in range(2):
        with subject(name) as made:
            for case in range(20):
                folder = tmp_path / f"{len(written)}"
                folder.mkdir()
                made.write(Random(f"{name}/7/{case}"), folder)
                files = [path for path in sorted(folder.iterdir()) if path.is_file()]
                written.append([path.read_bytes() for path in files if not path.is_symlink()])
    assert written[:20] == written[20:]
    assert len({b"".join(files) for files in written}) > 10


def reader(read) -> Subject:
    return Subject(lambda rng, folder: (folder / "a").write_bytes(b"a"), read)


def refuse(message: str) -> None:
    raise InputError(message)


@pytest.mark.parametrize(
    ("read", "said"),
    [
        (lambda folder: 1, "value"),
        (lambda folder: refuse("a.csv: no number; give one"), "refused"),
        (lambda folder: refuse("x" * 400), "refused"),  # it shows both ends of a line that long
        (lambda folder: refuse(""), "a line of 0 characters"),
        (lambda folder: 1 / 0, "ZeroDivisionError"),
        (lambda folder: (folder / "b").read_bytes(), "FileNotFoundError"),
        (lambda folder: bytearray(2**62), "MemoryError"),
        (lambda folder: Path("a\0b").stat(), "ValueError"),
    ],
)
def test_what_is_a_finding(tmp_path, read, said) -> None:
    assert said in run_case(reader(read), "any", 0, 0, tmp_path / "f")


def test_a_process_that_crashes_is_a_finding_and_the_next_case_is_run(capsys) -> None:
    program = """
import os, sys
first = int(sys.argv[sys.argv.index("--first") + 1])
for case in range(first, 5):
    print(f"case {case}", flush=True)
    if case == 2:
        os.abort()
print("DONE")
"""
    assert watched("csv", 3, range(5), [sys.executable, "-c", program]) == 1
    printed = capsys.readouterr().out
    assert "WRONG python -m tests.fuzz csv --seed 3 --case 2\nended with -6" in printed
    assert printed.endswith("DONE\n")
