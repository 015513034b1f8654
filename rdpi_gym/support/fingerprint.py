"""Fingerprints: whether a stored row still says what the code does."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable
from pathlib import Path


def fingerprint(parts: Iterable[bytes]) -> str:
    """Return a short hash of parts, each with its length, so that nothing moves between them."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "big") + part)
    return digest.hexdigest()[:16]


def room_files(*rooms: str) -> list[Path]:
    """Return the Python files of rooms of this package, for example ``plant``."""
    package = Path(__file__).parents[1]
    return [file for room in rooms for file in (package / room).glob("**/*.py")]


def code_parts(files: Iterable[Path]) -> list[bytes]:
    """Return what Python files do, in an order that does not depend on where they stand.

    Comments, docstrings, imports and layout are left out, as are names and places of files: a
    moved file or a mended sentence throws no result away.
    """
    return sorted(statements(file.read_text(encoding="utf-8")).encode() for file in files)


def statements(source: str) -> str:
    r"""Return what a Python source does: no comments, docstrings, imports, layout or sentences.

    A string of four words or more is a sentence: a message, an effect's cause.
    """
    return ast.dump(_Doing().visit(ast.parse(source)))


_SENTENCE_WORDS = 4


class _Doing(ast.NodeTransformer):
    """Leaves of a module what it does."""

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        return None if isinstance(node.value, ast.Constant) else self.generic_visit(node)

    def visit_Import(self, node: ast.Import) -> None:
        return None

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        return None

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        text = isinstance(node.value, str) and len(node.value.split()) >= _SENTENCE_WORDS
        return ast.Constant("") if text else node

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.AST:
        parts = [p.value if isinstance(p, ast.Constant) else "x" for p in node.values]
        sentence = len("".join(map(str, parts)).split()) >= _SENTENCE_WORDS
        return ast.Constant("") if sentence else self.generic_visit(node)
