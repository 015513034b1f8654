"""A pandas DataFrame as an HTML table that a reader can sort and search."""

from __future__ import annotations

import math
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from rdpi_gym.support.words import number

SEARCH_FROM_ROWS = 15
"""Tables of at least so many rows get a search field."""

_UNITS = {
    "um": "{output_unit}", "V": "{input_unit}", "s": "s", "ms": "ms", "hz": "Hz", "percent": "%", "V_s": "{input_unit}/s",
    "um_V": "{output_unit}/{input_divisor}", "V_per_s": "{input_unit}/s",
}  # fmt: skip
_WORDS = {"rmse": "RMSE", "nrmse": "NRMSE", "ts": "Ts", "rms": "RMS"}


def heading(name: str) -> str:
    """Turn a column's name into what a reader expects above it, the unit in brackets, as a template.

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
