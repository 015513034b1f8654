"""A page of results: one HTML file with its figures, tables and scripts inside."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from itertools import count
from pathlib import Path
from typing import Any

import pandas as pd
from plotly.offline import get_plotlyjs

from rdpi_gym.measurement import Quantities, Quantity
from rdpi_gym.report.assets import CSS, SCRIPT
from rdpi_gym.report.style import figure_text
from rdpi_gym.report.tables import table_html, told_table
from rdpi_gym.support.files import write_atomic

VOLTS_AND_MICROMETRES = Quantities()
"""For which every text of this room is written."""

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
    keep: Sequence[str] = (),
) -> Path:
    """Write a self-contained page, whole or not at all; it opens without a network."""
    numbers = count(1)
    say = partial(quantities.said, keep=keep)
    drawn = partial(_in_figures(quantities).said, keep=[*keep, *map(figure_text, keep)])
    if not quantities.are_standard:
        summary, sections = say(summary), [_told(section, say, drawn) for section in sections]
    parts = [_section_html(f"s{i}", s, numbers) for i, s in enumerate(sections, start=1)]
    contents = "".join(
        f'<li><a href="#s{i}">{escape(s.title)}</a></li>' for i, s in enumerate(sections, start=1)
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
{_prose(summary)}</header>
{"".join(parts)}</main>
</div>
<script>{SCRIPT}</script>
</body>
</html>
"""
    return write_atomic(path, document)


def _in_figures(quantities: Quantities) -> Quantities:
    """Return the quantities as a figure takes words that come from a user."""
    sides = (quantities.input, quantities.output)
    return Quantities(*(Quantity(*map(figure_text, vars(side).values())) for side in sides))


def _told(section: Section, say: Callable[[str], str], drawn: Callable[[str], str]) -> Section:
    """Return a section in other quantities than V and µm."""

    def redrawn(figure: Any) -> Any:
        return type(figure)(_said(figure.to_plotly_json(), drawn))

    figure, table = section.figure, section.table
    if isinstance(figure, Mapping):
        figure = {name: redrawn(each) for name, each in figure.items()}
    elif isinstance(figure, Sequence):
        figure = [redrawn(each) for each in figure]
    elif figure is not None:
        figure = redrawn(figure)
    return Section(say(section.title), say(section.text), figure, told_table(table, say))


def _said(value: Any, say: Callable[[str], str]) -> Any:
    """Turn every text of a figure."""
    if isinstance(value, str):
        return say(value)
    if isinstance(value, dict):
        return {key: each if key == "bdata" else _said(each, say) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_said(each, say) for each in value]
    return value


def _section_html(name: str, section: Section, numbers: Iterator[int]) -> str:
    body = [f"<h2>{escape(section.title)}</h2>\n", _prose(section.text)]
    figure = section.figure
    if isinstance(figure, Mapping):
        body.append(_choice_html(figure, section.title, numbers))
    elif isinstance(figure, Sequence):
        body += [_figure_html(f"f{next(numbers)}", each) for each in figure]
    elif figure is not None:
        body.append(_figure_html(f"f{next(numbers)}", figure))
    if section.table is not None:
        body.append(table_html(section.table))
    return f'<section id="{name}">{"".join(body)}</section>\n'


def _choice_html(figures: Mapping[str, Any], title: str, numbers: Iterator[int]) -> str:
    names = {f"f{next(numbers)}": name for name in figures}
    options = "".join(f'<option value="{f}">{escape(name)}</option>' for f, name in names.items())
    drawn = [
        _figure_html(f, figures[name], hidden=i > 0) for i, (f, name) in enumerate(names.items())
    ]
    label = f'<label class="choice">Show <select aria-label="{escape(title)}" autocomplete="off">'
    return f"{label}{options}</select></label>{''.join(drawn)}"


def _figure_html(name: str, figure: Any, hidden: bool = False) -> str:
    # "<" cannot end the script element early when it is written as JSON's escape
    data = figure.to_json().replace("<", "\\u003c")
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
