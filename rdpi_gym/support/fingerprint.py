"""Fingerprints: whether a stored row still says what the code does."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable
from pathlib import Path


def fingerprint(parts: Iterable[bytes]) -> str:
    """Return a short hash of parts, each with its length, so that nothing moves between them.

    Examples
    --------
    >>> fingerprint([b"ab", b"c"]) == fingerprint([b"a", b"bc"])
    False
    """
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "big") + part)
    return digest.hexdigest()[:16]


def room_files(*rooms: str) -> list[Path]:
    """Return the Python files of rooms of this package, for example ``plant``.

    Examples
    --------
    >>> "fingerprint.py" in [file.name for file in room_files("support")]
    True
    """
    package = Path(__file__).parents[1]
    return [file for room in rooms for file in (package / room).glob("**/*.py")]


def code_parts(files: Iterable[Path]) -> list[bytes]:
    """Return what Python files do, in an order that does not depend on where they stand.

    Comments, docstrings, imports and layout are left out, as are names and places of files: a
    moved file or a mended sentence throws no result away.
    """
    return sorted(statements(file.read_text(encoding="utf-8")).encode() for file in files)


def statements(source: str) -> str:
    r"""Return what a Python source does, without comments, docstrings, imports and layout.

    Examples
    --------
    >>> statements("import os\nx = 1  # one") == statements("'A number.'; x = 1")
    True
    """
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            body[:] = [item for item in body if not _says_nothing(item)]
    return ast.dump(tree)


def _says_nothing(item: ast.AST) -> bool:
    docstring = isinstance(item, ast.Expr) and isinstance(item.value, ast.Constant)
    return docstring or isinstance(item, ast.Import | ast.ImportFrom)
