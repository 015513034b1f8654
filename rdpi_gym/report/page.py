"""A page of results: one HTML file with its figures, tables and scripts inside."""

from __future__ import annotations

import gzip
import json
from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import count
from pathlib import Path
from typing import Any

import pandas as pd
from plotly.offline import get_plotlyjs

from rdpi_gym.measurement import Quantities, Quantity
from rdpi_gym.report.chart import Chart
from rdpi_gym.report.chart_plotly import plotly_figure
from rdpi_gym.report.style import FONT, GRID, INK, MUTED, PALETTE, PAPER, figure_text
from rdpi_gym.report.tables import table_html
from rdpi_gym.support.files import write_atomic

CSS = f"""
:root {{ --ink: {INK}; --muted: {MUTED}; --line: {GRID}; --paper: {PAPER}; --link: {PALETTE[0]}; }}
* {{ box-sizing: border-box; }}
html {{ scroll-behavior: smooth; scroll-padding-top: 1rem; }}
body {{ margin: 0; color: var(--ink); background: #F6F7F8; font: 16px/1.6 {FONT}; }}
.layout {{ display: grid; grid-template-columns: 15rem minmax(0, 76rem); gap: 2rem;
  justify-content: center; padding: 0 1.5rem; }}
nav {{ position: sticky; top: 0; align-self: start; max-height: 100vh; overflow-y: auto;
  padding: 2.2rem 0; font-size: .9rem; }}
nav ol {{ list-style: none; margin: 0; padding: 0; border-left: 2px solid var(--line); }}
nav a {{ display: block; padding: .25rem .8rem; margin-left: -2px; color: var(--muted);
  text-decoration: none; border-left: 2px solid transparent; overflow-wrap: anywhere; }}
nav a:hover {{ color: var(--ink); }}
nav a.here {{ color: var(--link); border-left-color: var(--link); }}
main {{ padding: 2rem 0 4rem; min-width: 0; }}
h1 {{ font-size: 1.9rem; line-height: 1.2; margin: 0 0 1rem; letter-spacing: -.01em; }}
h2 {{ font-size: 1.25rem; line-height: 1.3; margin: 0 0 .6rem; }}
h1, h2, p, li {{ overflow-wrap: anywhere; }}
summary {{ cursor: pointer; }}
summary h2 {{ display: inline; }}
details[open] > summary {{ margin-bottom: .6rem; }}
header, section {{ background: var(--paper); border: 1px solid var(--line); border-radius: 10px;
  padding: 1.4rem 1.6rem; margin-bottom: 1.2rem; }}
p, ul {{ max-width: 72ch; margin: 0 0 .8rem; }}
ul {{ padding-left: 1.2rem; }}
a {{ color: var(--link); }}
.figure {{ width: 100%; margin: 2.2rem 0 .6rem; }}
/* the tool bar of a figure stands above it: inside it would cover legends and buttons */
.figure .modebar-container {{ top: -1.9rem !important; }}
.choice {{ display: flex; gap: .6rem; align-items: center; margin: .8rem 0 0; font-size: .95rem; }}
select, .search {{ font: inherit; font-size: .9rem; padding: .3rem .5rem; color: inherit;
  background: var(--paper); border: 1px solid #B9C1C9; border-radius: 6px; max-width: 100%; }}
.table {{ margin: .8rem 0 0; }}
.search {{ margin-bottom: .5rem; width: 18rem; }}
.scroll {{ overflow: auto; max-height: 34rem; border: 1px solid var(--line); border-radius: 6px; }}
/* a bar that is always seen: one that shows only while scrolling hides that there is more */
.scroll::-webkit-scrollbar {{ width: 12px; height: 12px; background: #F1F4F7; }}
.scroll::-webkit-scrollbar-thumb {{ background: #AEB7C0; border-radius: 6px; border: 2px solid #F1F4F7; }}
table {{ border-collapse: collapse; width: 100%; font-size: .88rem; line-height: 1.4;
  font-variant-numeric: tabular-nums; }}
th, td {{ padding: .35rem .6rem; text-align: left; border-bottom: 1px solid var(--line); }}
td.number {{ text-align: right; white-space: nowrap; }}
th.number button {{ text-align: right; }}
tbody tr:last-child td {{ border-bottom: 0; }}
tbody tr:hover {{ background: #F1F4F7; }}
th {{ position: sticky; top: 0; background: #EEF1F4; padding: 0; vertical-align: bottom; }}
th button {{ all: unset; box-sizing: border-box; display: block; width: 100%; cursor: pointer;
  padding: .4rem .6rem; font-weight: 600; }}
th button:focus-visible {{ outline: 2px solid var(--link); outline-offset: -2px; }}
th[aria-sort=ascending] button::after {{ content: " ▲"; font-size: .7em; }}
th[aria-sort=descending] button::after {{ content: " ▼"; font-size: .7em; }}
@media (max-width: 96rem) {{  /* tables need the width more than the contents do */
  .layout {{ grid-template-columns: minmax(0, 76rem); gap: 0; padding: 0 .8rem; }}
  nav {{ position: static; max-height: none; padding: 1rem 0 0; }}
  nav ol {{ display: flex; flex-wrap: wrap; border-left: 0; }}
  nav a {{ margin: 0; padding: .1rem .8rem .1rem 0; border-left: 0; }}
  main {{ padding-top: 1rem; }}
  header, section {{ padding: 1rem; }}
}}
@media (max-width: 40rem) {{  /* narrower, labels would run into each other */
  section {{ overflow-x: auto; }}
  .figure {{ min-width: 36rem; }}
}}
@media print {{
  body {{ background: none; }}
  nav, .search, .choice {{ display: none; }}
  .layout {{ display: block; }}
  .scroll {{ max-height: none; overflow: visible; }}
  header, section {{ border: 0; padding: 0; break-inside: avoid; }}
}}
"""

SCRIPT = """
"use strict";
(() => {
  const config = {responsive: true, displaylogo: false, showSendToCloud: false,
                  modeBarButtonsToRemove: ["select2d", "lasso2d"]};
  const unpack = (packed) => {
    const bytes = Uint8Array.from(atob(packed.textContent), (letter) => letter.charCodeAt(0));
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
  };
  const draw = async (box) => {
    if (!window.Plotly || box.dataset.begun || box.hidden) return;
    if (box.closest("details:not([open])")) return;
    box.dataset.begun = "yes";
    const figure = JSON.parse(await unpack(document.getElementById(box.dataset.figure)));
    await Plotly.newPlot(box, figure.data, figure.layout, config);
    box.dataset.drawn = "yes";
  };
  const boxes = [...document.querySelectorAll(".figure")];
  // one after the other, so that the page answers in between; hidden ones when they are chosen
  const drawFrom = (i) => {
    if (i >= boxes.length) return;
    draw(boxes[i]);
    setTimeout(drawFrom, 0, i + 1);
  };
  const packed = document.getElementById("plotly");
  const load = async () => {
    const script = document.createElement("script");
    script.textContent = await unpack(packed);
    document.head.append(script);
    drawFrom(0);
    for (const folded of document.querySelectorAll("details")) {
      folded.addEventListener("toggle", () => folded.querySelectorAll(".figure").forEach(draw));
    }
  };
  if (packed) load();
  // what is pointed at, or printed, unfolds
  const unfold = () => {
    const wanted = location.hash && document.querySelector(location.hash + " > details");
    if (wanted) wanted.open = true;
  };
  window.addEventListener("hashchange", unfold);
  window.addEventListener("beforeprint", () => {
    document.querySelectorAll("details").forEach((folded) => { folded.open = true; });
  });
  unfold();

  for (const choice of document.querySelectorAll(".choice select")) {
    const show = () => {
      for (const option of choice.options) {
        const box = document.getElementById(option.value);
        box.hidden = !option.selected;
        if (!option.selected) continue;
        if (box.dataset.drawn) Plotly.Plots.resize(box);
        else draw(box);
      }
    };
    choice.addEventListener("change", show);
  }

  const value = (row, column) => {
    const cell = row.cells[column];
    return cell.dataset.sort === undefined ? cell.textContent : cell.dataset.sort;
  };
  const words = new Intl.Collator(undefined, {numeric: true});
  const compare = (a, b, numeric) => {
    if (a === "" || b === "") return 0;
    return numeric ? Number(a) - Number(b) : words.compare(a, b);
  };
  for (const table of document.querySelectorAll("table")) {
    const body = table.tBodies[0];
    const heads = [...table.tHead.rows[0].cells];
    heads.forEach((head, column) => {
      head.firstElementChild.addEventListener("click", () => {
        const down = head.getAttribute("aria-sort") === "ascending";
        heads.forEach((other) => other.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", down ? "descending" : "ascending");
        const numeric = head.classList.contains("number");
        const rows = [...body.rows].map((row) => [value(row, column), row]);
        // rows without a value stay at the end in either order
        rows.sort(([a], [b]) => (a === "") - (b === "") || (down ? -1 : 1) * compare(a, b, numeric));
        body.append(...rows.map(([, row]) => row));
      });
    });
  }
  for (const search of document.querySelectorAll(".search")) {
    const rows = [...search.parentElement.querySelectorAll("tbody tr")];
    search.addEventListener("input", () => {
      const wanted = search.value.toLowerCase().split(/\\s+/).filter(Boolean);
      for (const row of rows) {
        const text = row.textContent.toLowerCase();
        row.hidden = !wanted.every((word) => text.includes(word));
      }
    });
  }

  const links = new Map([...document.querySelectorAll("nav a")].map((a) => [a.hash.slice(1), a]));
  const mark = new IntersectionObserver((seen) => {
    for (const entry of seen) {
      if (!entry.isIntersecting) continue;
      links.forEach((link) => link.classList.remove("here"));
      links.get(entry.target.id)?.classList.add("here");
    }
  }, {rootMargin: "-10% 0px -80% 0px"});
  document.querySelectorAll("section").forEach((section) => mark.observe(section));
})();
"""


VOLTS_AND_MICROMETRES = Quantities()
"""Quantities of a page that states no other."""

# The browser is told to fetch nothing, whatever a figure may ask for.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:"
)


@dataclass(frozen=True)
class Section:
    """One section of a page: a figure, what it shows, in words below it, and a table."""

    title: str  # in the table of contents too
    # plain text, escaped: a blank line begins a paragraph, lines that begin with "- " are a list
    text: str
    # charts or Plotly figures, in which names that come from a user go through `figure_text`; several
    # one below the other, or by name, of which the reader chooses one
    figure: Any | Sequence[Any] | Mapping[str, Any] | None = None
    table: pd.DataFrame | None = None  # sortable by every column
    folded: bool = False  # whether only its title is seen until a reader unfolds it


def write_page(
    path: Path | str,
    title: str,
    summary: str,
    sections: Sequence[Section],
    quantities: Quantities = VOLTS_AND_MICROMETRES,
) -> Path:
    """Write a self-contained page that opens without a network, its fields filled in from `quantities`."""
    numbers = count(1)
    say, drawn = _written(quantities, escape).fill, _written(quantities, _in_json).fill
    parts = [say(_section_html(f"s{i}", s, numbers, drawn)) for i, s in enumerate(sections, 1)]
    contents = "".join(
        f'<li><a href="#s{i}">{say(escape(s.title))}</a></li>'
        for i, s in enumerate(sections, start=1)
    )
    plotly = _packed("plotly", get_plotlyjs()) if next(numbers) > 1 else ""
    document = f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<link rel="icon" href="data:,">
<title>{escape(title)}</title>
<style>{CSS}</style>
</head>
<body>
<div class="layout">
<nav aria-label="Contents"><ol>{contents}</ol></nav>
<main>
<header><h1>{escape(title)}</h1>
{say(_prose(summary))}</header>
{"".join(parts)}</main>
</div>
{plotly}
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
    return json.dumps(figure_text(word))[1:-1]


def _section_html(
    name: str, section: Section, numbers: Iterator[int], drawn: Callable[[str], str]
) -> str:
    title, body = f"<h2>{escape(section.title)}</h2>", list[str]()
    figure = section.figure
    if isinstance(figure, Mapping):
        body.append(_choice_html(figure, section.title, numbers, drawn))
    elif isinstance(figure, Sequence):
        body += [_figure_html(f"f{next(numbers)}", each, section.title, drawn) for each in figure]
    elif figure is not None:
        body.append(_figure_html(f"f{next(numbers)}", figure, section.title, drawn))
    body.append(_prose(section.text))
    if section.table is not None:
        body.append(table_html(section.table))
    content = f"{title}\n{''.join(body)}"
    if section.folded:
        content = f"<details><summary>{title}</summary>\n{''.join(body)}</details>"
    return f'<section id="{name}">{content}</section>\n'


def _choice_html(
    figures: Mapping[str, Any], title: str, numbers: Iterator[int], drawn: Callable[[str], str]
) -> str:
    names = {f"f{next(numbers)}": name for name in figures}
    options = "".join(f'<option value="{f}">{escape(name)}</option>' for f, name in names.items())
    each = [
        _figure_html(f, figures[name], f"{title}, {name}", drawn, hidden=i > 0)
        for i, (f, name) in enumerate(names.items())
    ]
    label = f'<label class="choice">Show <select aria-label="{escape(title)}" autocomplete="off">'
    return f"{label}{options}</select></label>{''.join(each)}"


def _figure_html(
    name: str, figure: Any, title: str, drawn: Callable[[str], str], hidden: bool = False
) -> str:
    figure = plotly_figure(figure) if isinstance(figure, Chart) else figure
    height = figure.layout.height or 420
    return (
        f"{_packed(f'{name}-data', drawn(figure.to_json()))}"
        f'<div class="figure" role="figure" aria-label="{escape(title)}" id="{name}" data-figure="{name}-data" style="min-height:{height}px"'
        f"{' hidden' if hidden else ''}></div>\n"
    )


def _packed(name: str, text: str) -> str:
    """Write a script or the data of a figure at a third of its size; every browser since 2023 unpacks it."""
    packed = b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode()
    return f'<script type="text/plain" id="{name}">{packed}</script>'


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
