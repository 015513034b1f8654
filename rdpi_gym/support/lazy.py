"""Public names of a package, stated once in its stub and loaded when they are first used."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def attach(package: str, stub: Path) -> tuple[list[str], Callable[[str], Any]]:
    """Return the names that a stub imports, sorted, and the ``__getattr__`` that loads them.

    ``from package import name`` names a module of the package itself; ``from module import *`` stands
    for all that ``__all__`` of the module lists.
    """
    homes: dict[str, str] = {}
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                names = import_module(node.module).__all__ if alias.name == "*" else [alias.name]
                homes.update(dict.fromkeys(names, node.module))

    def load(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home = homes[name]
        found = (
            import_module(f"{home}.{name}")
            if home == package
            else getattr(import_module(home), name)
        )
        setattr(sys.modules[package], name, found)
        return found

    return sorted(homes), load
