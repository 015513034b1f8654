"""The C compiler of this machine, and programs made with it."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from rdpi_gym.support.errors import InputError

STRICT = ("-std=c99", "-O2", "-ffp-contract=off")
"""Flags with which code is bit by bit what Python is."""
_LONGEST_S = 600.0


def compiler() -> list[str]:
    """Return the words that call a C compiler: ``$CC``, else cc, gcc or clang."""
    named = os.environ.get("CC", "")
    for words in filter(None, (shlex.split(named), ["cc"], ["gcc"], ["clang"])):
        if shutil.which(words[0]):
            return words
    none = f"$CC is {named}, which is not there, and no" if named else "no"
    raise InputError(f"{none} C compiler is found; install gcc or clang, or set CC")


def build(sources: Sequence[Path], out: Path, precision: int, include: Path) -> Path:
    """Compile a program."""
    words = [*compiler(), *STRICT, f"-DRDPI_PRECISION={precision}", f"-I{include}"]
    done = run([*words, *map(str, sources), "-o", str(out), "-lm"], out.parent)
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if "error" in line] or [done.stderr]
        raise InputError(f"{words[0]} refuses the code: {lines[0].strip()}")
    return out


def run(words: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a program and wait for its end."""
    try:
        return subprocess.run(
            words, cwd=folder, capture_output=True, text=True, errors="replace", timeout=_LONGEST_S, check=False
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise InputError(f"{words[0]} did not end within {_LONGEST_S:.0f} s") from error
    except OSError as error:
        raise InputError(f"{words[0]} cannot be run ({error.strerror})") from error
