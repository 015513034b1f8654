"""A pandas DataFrame as an HTML table that a reader can sort and search."""

from __future__ import annotations

import math
from collections.abc import Callable
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from rdpi_gym.support.words import number

SEARCH_FROM_ROWS = 15
"""Tables of at least so many rows get a search field."""

_UNITS = {
    "um": "µm", "V": "V", "s": "s", "ms": "ms", "hz": "Hz", "percent": "%", "V_s": "V/s",
    "um_V": "µm/V", "V_per_s": "V/s",
}  # fmt: skip
_TURNED = {"unit", "meaning"}  # columns whose cells are captions
_WORDS = {"rmse": "RMSE", "nrmse": "NRMSE", "ts": "Ts", "rms": "RMS"}


def heading(name: str) -> str:
    """Turn a column's name into what a reader expects above it, the unit in brackets.

    A name that has a blank or a capital at its beginning is taken as written.
    """
    if " " in name or name[:1].isupper():
        return name
    stem, unit = name, ""
    for suffix in sorted(_UNITS, key=len, reverse=True):
        if name.endswith(f"_{suffix}"):
            stem, unit = name.removesuffix(f"_{suffix}"), f" ({_UNITS[suffix]})"
            break
    words = [_WORDS.get(word, word) for word in stem.split("_")]
    text = " ".join(words)
    return text[:1].upper() + text[1:] + unit


def told_table(frame: Any, say: Callable[[str], str]) -> Any:
    """Return a table, or nothing, in other quantities: its headings, units and meanings are turned."""
    if frame is None:
        return None
    turned = frame.rename(columns={name: _said_heading(str(name), say) for name in frame.columns})
    for name in _TURNED & set(turned.columns):
        turned[name] = [say(cell) if isinstance(cell, str) else cell for cell in turned[name]]
    return turned


def _said_heading(name: str, say: Callable[[str], str]) -> str:
    said = say(heading(name))
    return name if said == heading(name) else said


def format_number(value: float) -> str:
    """Write a number with four significant digits, without needless zeros."""
    return number(value, 4, "usual").replace("-", "\N{MINUS SIGN}")


def table_html(frame: pd.DataFrame) -> str:
    """Write a table; everything in it is escaped."""
    numeric = [pd.api.types.is_numeric_dtype(t) for t in frame.dtypes]
    numeric = [
        n and not pd.api.types.is_bool_dtype(t) for n, t in zip(numeric, frame.dtypes, strict=True)
    ]
    head = "".join(
        f'<th scope="col"{_side(n)}><button type="button">{escape(heading(str(name)))}</button></th>'
        for name, n in zip(frame.columns, numeric, strict=True)
    )
    columns = [frame.iloc[:, i].tolist() for i in range(frame.shape[1])]
    body = "".join(
        "<tr>" + "".join(_cell(v, n) for v, n in zip(row, numeric, strict=True)) + "</tr>\n"
        for row in zip(*columns, strict=True)
    )
    search = (
        '<input class="search" type="search" placeholder="Search this table" aria-label="Search this table">'
        if len(frame) >= SEARCH_FROM_ROWS
        else ""
    )
    return (
        f'<div class="table">{search}<div class="scroll"><table><thead><tr>{head}</tr></thead>\n'
        f"<tbody>{body}</tbody></table></div></div>"
    )


def _side(numeric: bool) -> str:
    return ' class="number"' if numeric else ""


def _cell(value: Any, numeric: bool) -> str:
    if isinstance(value, bool | np.bool_):
        return f"<td>{'yes' if value else 'no'}</td>"
    missing = value is None or value is pd.NA or (isinstance(value, float) and math.isnan(value))
    if missing:
        return f'<td{_side(numeric)} data-sort="">–</td>'
    if isinstance(value, float):
        return (
            f'<td{_side(numeric)} data-sort="{value!r}" title="{value:.12g}">'
            f"{format_number(value)}</td>"
        )
    return f"<td{_side(numeric)}>{escape(str(value))}</td>"
