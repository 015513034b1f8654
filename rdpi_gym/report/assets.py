"""Style sheet and script of a page: part of the page, so that it fetches nothing."""

from rdpi_gym.report.style import FONT, GRID, INK, MUTED, PALETTE, PAPER

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
  const draw = (box) => {
    if (box.dataset.drawn || box.hidden) return;
    box.dataset.drawn = "yes";
    const data = document.getElementById(box.dataset.figure);
    const figure = JSON.parse(data.textContent);
    Plotly.newPlot(box, figure.data, figure.layout, config);
  };
  const boxes = [...document.querySelectorAll(".figure")];
  // one after the other, so that the page answers in between; hidden ones when they are chosen
  const drawFrom = (i) => {
    if (i >= boxes.length) return;
    draw(boxes[i]);
    setTimeout(drawFrom, 0, i + 1);
  };
  drawFrom(0);

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
