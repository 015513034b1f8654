"""Texts of the package with places to fill."""

from __future__ import annotations

import re
from importlib.resources import files


def template(name: str) -> str:
    """Return a file of ``rdpi_gym/firmware/writing/templates``."""
    return (files("rdpi_gym.firmware.writing") / "templates" / name).read_text(encoding="utf-8")


def filled(text: str, parts: set[str] | frozenset[str] = frozenset(), **values: str) -> str:
    r"""Fill a text."""
    for name in set(re.findall(r"@IF_(\w+)@", text)):
        stay = r"\1" if name in parts else ""
        text = re.sub(rf"@IF_{name}@\n(.*?)@END_{name}@\n", stay, text, flags=re.DOTALL)
    lines = []
    for line in text.splitlines():
        new = re.sub(r"@([A-Z_]+)@", lambda found: values[found[1]], line)
        if new.strip() or not re.search(r"@[A-Z_]+@", line):
            lines.append(new)
    return "\n".join(lines) + "\n"


def helpers(name: str, text: str) -> list[str]:
    """Return the C functions of a template that a text calls, and those that these call, callees first."""
    found: list[str] = []
    for piece in reversed(template(name).split("\n\n\n")):
        functions = re.findall(r"^static \w+ (\w+)\(", piece, re.MULTILINE)
        if functions and re.search(rf"\b{functions[-1]}\b", "\n".join([text, *found])):
            found.insert(0, piece.rstrip("\n") + "\n")
    return found
