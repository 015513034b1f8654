"""A page of results: one HTML file with its figures, tables and scripts inside."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import count
from pathlib import Path
from typing import Any

import pandas as pd
from plotly.offline import get_plotlyjs

from rdpi_gym.measurement import Quantities, Quantity
from rdpi_gym.report.assets import CSS, SCRIPT
from rdpi_gym.report.style import figure_text
from rdpi_gym.report.tables import table_html
from rdpi_gym.support.files import write_atomic

VOLTS_AND_MICROMETRES = Quantities()
"""Of a page that states no other."""

# The browser is told to fetch nothing, whatever a figure may ask for.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:"
)


@dataclass(frozen=True)
class Section:
    """One section of a page: what is seen, in words, and the figure or table that shows it.

    Parameters
    ----------
    title
        Heading; it also stands in the table of contents.
    text
        Plain text, escaped. A blank line begins a paragraph; a paragraph whose lines all begin
        with ``- `` is a list.
    figure
        A Plotly figure, several one below the other, or several by name, of which the reader
        chooses one. Names that come from a user go through
        :func:`rdpi_gym.report.style.figure_text` inside a figure; here they are escaped.
    table
        Shown below the figure, sortable by every column.

    Examples
    --------
    >>> Section("Error by record", "The second record is worse.").title
    'Error by record'
    """

    title: str
    text: str
    figure: Any | Sequence[Any] | Mapping[str, Any] | None = None
    table: pd.DataFrame | None = None


def write_page(
    path: Path | str,
    title: str,
    summary: str,
    sections: Sequence[Section],
    quantities: Quantities = VOLTS_AND_MICROMETRES,
) -> Path:
    """Write a self-contained page, whole or not at all; it opens without a network.

    Fields of texts, as ``{output_unit}``, are filled in from `quantities`.
    """
    numbers = count(1)
    say, drawn = _written(quantities, escape).fill, _written(quantities, _in_json).fill
    parts = [say(_section_html(f"s{i}", s, numbers, drawn)) for i, s in enumerate(sections, 1)]
    contents = "".join(
        f'<li><a href="#s{i}">{say(escape(s.title))}</a></li>'
        for i, s in enumerate(sections, start=1)
    )
    plotly = f"<script>{get_plotlyjs()}</script>" if next(numbers) > 1 else ""
    document = f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<link rel="icon" href="data:,">
<title>{escape(title)}</title>
<style>{CSS}</style>
{plotly}
</head>
<body>
<div class="layout">
<nav aria-label="Contents"><ol>{contents}</ol></nav>
<main>
<header><h1>{escape(title)}</h1>
{say(_prose(summary))}</header>
{"".join(parts)}</main>
</div>
<script>{SCRIPT}</script>
</body>
</html>
"""
    return write_atomic(path, document)


def _written(quantities: Quantities, write: Callable[[str], str]) -> Quantities:
    """Return quantities whose words, which come from a user, are written as a place needs them."""
    sides = (quantities.input, quantities.output)
    return Quantities(*(Quantity(*map(write, vars(side).values())) for side in sides))


def _in_json(word: str) -> str:
    """Write a word as it stands within a text of a figure, in JSON within a page."""
    return json.dumps(figure_text(word))[1:-1].replace("<", "\\u003c")


def _section_html(
    name: str, section: Section, numbers: Iterator[int], drawn: Callable[[str], str]
) -> str:
    body = [f"<h2>{escape(section.title)}</h2>\n", _prose(section.text)]
    figure = section.figure
    if isinstance(figure, Mapping):
        body.append(_choice_html(figure, section.title, numbers, drawn))
    elif isinstance(figure, Sequence):
        body += [_figure_html(f"f{next(numbers)}", each, drawn) for each in figure]
    elif figure is not None:
        body.append(_figure_html(f"f{next(numbers)}", figure, drawn))
    if section.table is not None:
        body.append(table_html(section.table))
    return f'<section id="{name}">{"".join(body)}</section>\n'


def _choice_html(
    figures: Mapping[str, Any], title: str, numbers: Iterator[int], drawn: Callable[[str], str]
) -> str:
    names = {f"f{next(numbers)}": name for name in figures}
    options = "".join(f'<option value="{f}">{escape(name)}</option>' for f, name in names.items())
    each = [
        _figure_html(f, figures[name], drawn, hidden=i > 0)
        for i, (f, name) in enumerate(names.items())
    ]
    label = f'<label class="choice">Show <select aria-label="{escape(title)}" autocomplete="off">'
    return f"{label}{options}</select></label>{''.join(each)}"


def _figure_html(name: str, figure: Any, drawn: Callable[[str], str], hidden: bool = False) -> str:
    # "<" cannot end the script element early when it is written as JSON's escape
    data = drawn(figure.to_json().replace("<", "\\u003c"))
    height = figure.layout.height or 420
    return (
        f'<script type="application/json" id="{name}-data">{data}</script>'
        f'<div class="figure" id="{name}" data-figure="{name}-data" style="min-height:{height}px"'
        f"{' hidden' if hidden else ''}></div>\n"
    )


def _prose(text: str) -> str:
    html = []
    for paragraph in text.strip().split("\n\n"):
        lines = [line.strip() for line in paragraph.strip().splitlines()]
        if lines and all(line.startswith("- ") for line in lines):
            items = "".join(f"<li>{escape(line[2:])}</li>" for line in lines)
            html.append(f"<ul>{items}</ul>\n")
        elif lines:
            html.append(f"<p>{escape(' '.join(lines))}</p>\n")
    return "".join(html)
