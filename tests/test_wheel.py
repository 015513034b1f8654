"""The wheel holds code, beliefs and policies, and runs where no checkout is."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
KINDS = {".py", ".pyi", ".typed", ".json", ".pt", ".npz", ".yml", ".html", ".css", ".js"}
EXAMPLE = {"LICENSE", "dataset.toml", "identification.npz", "validation.npz"}
# Templates of what an export writes; a Makefile has no suffix.
TEMPLATES = {".c", ".h", ".md", ".txt", ""}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    # only what git knows, in a place of its own: setuptools builds beside the sources
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file() and not name.startswith(("tests/", "docs/", ".")):
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_bytes((ROOT / name).read_bytes())
    code = f"from setuptools.build_meta import build_wheel; print(build_wheel({str(folder)!r}))"
    built = subprocess.run(
        [sys.executable, "-c", code], cwd=source, capture_output=True, text=True, check=True
    )
    return folder / built.stdout.splitlines()[-1]


def test_a_wheel_holds_code_beliefs_policies_and_the_page_within_limits(wheel):
    files = [f for f in zipfile.ZipFile(wheel).infolist() if ".dist-info/" not in f.filename]
    names = [file.filename for file in files]
    assert {name.split("/")[0] for name in names} == {"rdpi_gym", "baselines", "benchmarks"}
    folder = "rdpi_gym/firmware/writing/templates/"
    templates = {name for name in names if name.startswith(folder)}
    example = {name for name in names if name.startswith("rdpi_gym/measurement/examples/picma/")}
    assert {Path(name).name for name in example} == EXAMPLE
    assert {Path(name).suffix for name in names if name not in templates | example} == KINDS
    assert {Path(name).suffix for name in templates} == TEMPLATES
    assert {n.split("/")[0] for n in names if n.endswith(".pt")} == {"baselines"}
    taken = {
        room: sum(file.compress_size for file in files if file.filename.startswith(room))
        for room in (
            "rdpi_gym/laboratory/",
            "rdpi_gym/firmware/",
            "baselines/learned/policies/",
            "rdpi_gym/measurement/examples/",
        )
    }
    assert wheel.stat().st_size - sum(taken.values()) < 1.3e6
    assert taken["rdpi_gym/laboratory/"] < 0.12e6
    assert taken["rdpi_gym/firmware/"] < 0.16e6
    assert taken["baselines/learned/policies/"] < 0.4e6
    assert taken["rdpi_gym/measurement/examples/"] < 0.25e6
    pages = {Path(name).parent.name for name in names if name.endswith((".html", ".css", ".js"))}
    assert pages == {"page"}


def test_the_command_runs_from_a_wheel_alone(wheel, tmp_path):
    zipfile.ZipFile(wheel).extractall(tmp_path / "installed")
    bench = [
        "bench", "--controllers", "classical-static", "--plants", "P5", "--references", "steps",
        "--ts", "1e-3", "--seeds", "1", "--jobs", "1", "--out", "results",
    ]  # fmt: skip
    program = "import sys; from rdpi_gym.cli import main; sys.exit(main(sys.argv[1:]))"
    run = subprocess.run(
        [sys.executable, "-c", program, *bench],
        cwd=tmp_path, capture_output=True, text=True, check=False,
        # no kernel is compiled for one small run
        env=os.environ | {"PYTHONPATH": str(tmp_path / "installed"), "NUMBA_DISABLE_JIT": "1"},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "results" / "leaderboard.md").exists()
