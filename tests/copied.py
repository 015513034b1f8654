"""A copy of the checkout in which files are added or changed, and the tests that run in it."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
_BESIDE = {".git", ".venv", "build", "results", ".mypy_cache", ".ruff_cache", ".pytest_cache"}


def copied(folder: Path, source: Path = ROOT) -> Path:
    """Copy a checkout, compiled kernels too."""

    def beside(where: str, names: list[str]) -> set[str]:
        return set(names) & _BESIDE if Path(where) == source else set()

    shutil.copytree(source, folder, ignore=beside, symlinks=True)
    return folder


def add(folder: Path, files: Mapping[str, str]) -> None:
    """Add files that a copy does not have."""
    for name, text in files.items():
        assert not (folder / name).exists(), name
        (folder / name).write_text(text, encoding="utf-8")


def python(copy: Path, *words: str, timeout_s: float = 1800.0) -> subprocess.CompletedProcess[str]:
    """Run Python in a copy, whose packages it imports."""
    own = {
        "PYTHONPATH": str(copy),
        "PYTHONIOENCODING": "utf-8",
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    return subprocess.run(
        [sys.executable, *words],
        cwd=copy, env=os.environ | own, capture_output=True, text=True, timeout=timeout_s,
    )  # fmt: skip


def failures(
    copy: Path, paths: Sequence[str] = ("tests",), *words: str, may_be_none: bool = False
) -> list[str]:
    """Run the default tier of some paths in a copy; return the tests that fail, none if all pass.

    That no test runs is a failure too, unless there may be none.
    """
    own = ("-q", "-p", "no:cacheprovider", "-m", "not slow")
    run = python(copy, "-m", "pytest", *own, *words, *paths)
    found = re.findall(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", run.stdout, re.MULTILINE)
    passed = (0, 5) if may_be_none else (0,)  # 5: no test was collected
    if run.returncode not in passed and not found:
        found = [f"pytest ends with {run.returncode}: {(run.stdout + run.stderr)[-1000:]}"]
    return found
