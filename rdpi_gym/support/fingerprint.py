"""Fingerprints: whether a stored row still says what the code does."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable, Iterator
from functools import cache
from inspect import getsourcefile
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


@cache
def code_of(*rooms: str) -> bytes:
    """Return a hash of the files of rooms of this package."""
    files = sorted(room_files(*rooms))
    return fingerprint(file.read_bytes() for file in files).encode()


@cache
def source_of(kind: type) -> bytes:
    """Return the file that a class stands in, a user's own too; empty where there is none."""
    try:
        path = getsourcefile(kind)
        return b"" if path is None else Path(path).read_bytes()
    except (OSError, TypeError):
        return b""


def code_parts(files: Iterable[Path]) -> list[bytes]:
    """Return what Python files do, in an order that does not depend on where they stand.

    Comments, docstrings, imports and layout are left out, as are names and places of files: a
    moved file or a mended sentence throws no result away.
    """
    return sorted(statements(file.read_text(encoding="utf-8")).encode() for file in files)


def used_files(roots: Iterable[str], folder: Path) -> list[Path]:
    """Return the Python files of a package in a folder that modules are and import, at any remove.

    Parameters
    ----------
    roots
        Dotted names, those of other packages left out.
    folder
        Of the package, of whose name it is. A name that ``__init__.py`` brings from elsewhere is of
        the file that it comes from; a package whose name stands as text is one whose files are all
        read.
    """
    found: set[Path] = set()
    waiting, seen = list(roots), set[str]()
    while waiting:
        name = waiting.pop()
        if name in seen or name.partition(".")[0] != folder.name:
            continue
        seen.add(name)
        file = _file_of(name, folder)
        if file is None:  # what a module binds
            owner, _, bound = name.rpartition(".")
            waiting += _brought(owner, bound, folder)
        elif file not in found:
            found.add(file)
            waiting += _imported(file.read_text(encoding="utf-8"))
    return sorted(found)


@cache
def _imported(source: str) -> tuple[str, ...]:
    """Return the dotted names that a source imports, and its texts that may name a package."""
    names: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names += [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            names += [f"{node.value}.*"] if node.value.isprintable() and "." in node.value else []
    return tuple(dict.fromkeys(names))


def _file_of(name: str, folder: Path) -> Path | None:
    """The file of a module or of a package."""
    path = folder.parent.joinpath(*name.split("."))
    return next((f for f in (path.with_suffix(".py"), path / "__init__.py") if f.is_file()), None)


def _brought(owner: str, bound: str, folder: Path) -> Iterator[str]:
    """Where a name in a module comes from: the module, or what its package brings it from."""
    file = _file_of(owner, folder)
    if bound == "*":
        place = folder.parent.joinpath(*owner.split("."))
        yield from (f"{owner}.{each.stem}" for each in place.glob("*.py"))
    elif file is not None and file.name == "__init__.py":
        inside = _imported(file.read_text(encoding="utf-8"))
        own = [name for name in inside if name.rpartition(".")[2] == bound]
        yield from own or [owner]
    elif file is not None:
        yield owner


@cache
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
