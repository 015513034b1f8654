"""Fingerprint: whether a stored row still says what the code does."""

from __future__ import annotations

import ast
import hashlib
from functools import cache
from pathlib import Path

import rdpi_gym

# What a row depends on; neither who runs the cases nor tables and pages made of rows are among it.
_ROOMS = ("plant", "signals", "measurement", "identification", "diagnosis")
_STUDY = (
    "case_row",
    "cases",
    "dataset",
    "draws",
    "outside",
    "plants",
    "transform",
    "truth",
    "visibility",
)


@cache
def study_fingerprint() -> str:
    """Return a hash of the code that a row depends on, comments and docstrings left out.

    Examples
    --------
    >>> len(study_fingerprint())
    16
    """
    here = Path(__file__).parent
    files = [f for room in _ROOMS for f in Path(rdpi_gym.__file__).parent.glob(f"{room}/**/*.py")]
    files += [*here.parent.glob("independent/*.py"), *(here / f"{name}.py" for name in _STUDY)]
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(statements(file.read_text(encoding="utf-8")).encode())
    return digest.hexdigest()[:16]


def statements(source: str) -> str:
    """Return what a Python source does, without comments, docstrings and layout.

    Examples
    --------
    >>> statements("x = 1  # one") == statements("'A number.'; x = 1")
    True
    """
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(
            node, clean=False
        ):
            node.body = node.body[1:]
    return ast.dump(tree)
