"""Docstrings as reStructuredText: absolute values, and Gymnasium's style (headings, tables, fences)."""

from __future__ import annotations

import re
from typing import Any


def convert(
    app: Any, what: str, name: str, target: object, options: object, lines: list[str]
) -> None:
    """Rewrite the lines of a docstring, as a handler of autodoc's event."""
    lines[:] = [re.sub(r"(?<![`|])\|(\w+)\|(?![`|])", r"\\|\1\\|", line) for line in lines]
    if any(line.startswith("## ") for line in lines):
        lines[:] = _converted(lines)


def _converted(lines: list[str]) -> list[str]:
    found: list[str] = []
    table: list[str] = []
    in_code = False
    for line in [*lines, ""]:
        if table and not line.startswith("|"):
            found += _table(table)
            table = []
        if line.startswith("```"):
            in_code = not in_code
            found += ["", f".. code-block:: {line[3:]}", ""] if in_code else [""]
        elif in_code:
            found.append(f"   {line}")
        elif line.startswith("|"):
            table.append(line)
        elif line.startswith("## "):
            found += ["", f".. rubric:: {line[3:]}", ""]
        elif line.startswith("* "):
            found += ["", _literals(line)]
        else:
            found.append(_literals(line))
    return found


def _table(rows: list[str]) -> list[str]:
    found = ["", ".. list-table::", "   :header-rows: 1", ""]
    for row in (rows[0], *rows[2:]):
        first, *rest = (_literals(cell.strip()) for cell in row.strip("|").split("|"))
        found += [f"   * - {first}", *(f"     - {cell}" for cell in rest)]
    return [*found, ""]


def _literals(text: str) -> str:
    """Write what stands between single backticks as a literal, roles and doctests aside."""
    if text.lstrip().startswith((">>>", "...")):
        return text
    text = re.sub(r"(?<![`:\w])`([^`]+)`(?![`_])", r"``\1``", text)
    return re.sub(r"(?<=[^\s\"'(\[{<`])``(?=\w+``)", r"\\ ``", text)
