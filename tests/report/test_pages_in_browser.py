"""Every kind of page in a real browser: it draws all of its figures, silently and without a network."""

import shutil

import numpy as np
import pytest

from benchmarks.tracking.report import write_benchmark_page
from rdpi_gym.cli import main
from rdpi_gym.diagnosis import compare
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import P5, Plant, named_plant
from rdpi_gym.report.comparison_page import write_compare_page
from rdpi_gym.report.discovery_page import write_discovery_page
from tests.unpacked import figures as packed_figures

sync_api = pytest.importorskip(
    "playwright.sync_api", reason="Playwright's Python package is not installed (extra: test)"
)
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
if CHROMIUM is None:
    pytest.skip(
        "no Chromium is installed (Debian: apt-get install chromium)", allow_module_level=True
    )
_WAIT_MS, _STEP_MS = 60_000, 50

# Every figure that is not hidden: its name, and the size of what Plotly has drawn in it.
_DRAWN = """() => [...document.querySelectorAll(".figure:not([hidden])")].map((box) => {
  const drawn = [...box.querySelectorAll("svg.main-svg, canvas")];
  const areas = drawn.map((each) => each.getBoundingClientRect()).map((r) => r.width * r.height);
  const traces = box.querySelectorAll(".trace, .barlayer .point, .hm image").length;
  return {name: box.id, plotly: box.classList.contains("js-plotly-plot"),
          area: Math.max(0, ...areas), traces: traces};
})"""

_UNFOLD = "() => document.querySelectorAll('details').forEach((each) => { each.open = true; })"

# How far each title in a figure reaches beyond the figure's left and right edge (pixels).
_BEYOND = """() => [...document.querySelectorAll(".figure:not([hidden])")].flatMap((box) => {
  const frame = box.getBoundingClientRect();
  return [...box.querySelectorAll(".annotation-text, .xtitle, .ytitle, .gtitle")].map((title) => {
    const r = title.getBoundingClientRect();
    return {text: title.textContent, beyond: Math.max(frame.left - r.left, r.right - frame.right)};
  });
})"""

# Pairs of things to read or to press that cover each other, by more than a pixel each way.
_OVERLAPS = """() => {
  const seen = "main h1, main h2, main p, main li, main label, main select, main input, main th, "
    + "main td, nav a, .figure svg text, .updatemenu-button rect, .modebar-group";
  const boxes = [...document.querySelectorAll(seen)]
    .filter((each) => each.checkVisibility({visibilityProperty: true}))
    .filter((each) => each.tagName !== "text" || each.textContent.trim())
    .map((each) => {
      let {left, top, right, bottom} = each.getBoundingClientRect();
      const frame = each.closest(".scroll");
      if (frame) {
        const {left: x, top: y} = frame.getBoundingClientRect();
        left = Math.max(left, x); right = Math.min(right, x + frame.clientWidth);
        top = Math.max(top, y); bottom = Math.min(bottom, y + frame.clientHeight);
      }
      const text = each.textContent.trim() || String(each.getAttribute("class"));
      return {each, left, top, right, bottom, text};
    })
    .filter((box) => box.right - box.left > 1 && box.bottom - box.top > 1)
    .sort((a, b) => a.top - b.top);
  const found = [];
  boxes.forEach((a, i) => {
    for (const b of boxes.slice(i + 1)) {
      if (b.top > a.bottom - 1) break;
      const button = a.each.closest(".updatemenu-button");
      if (a.each.contains(b.each) || b.each.contains(a.each)) continue;
      if (button && button === b.each.closest(".updatemenu-button")) continue;
      const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (wide > 1.5 && high > 1.5) found.push([a.text, b.text]);
    }
  });
  return found;
}"""

# Each table: its section, what is cut off of its width, and the height of its scroll bar (pixels).
_TABLES = """() => [...document.querySelectorAll(".scroll")].map((box) => ({
  title: box.closest("section").querySelector("h2").textContent,
  cut: box.scrollWidth - box.clientWidth,
  bar: box.offsetHeight - box.clientHeight - 2,
}))"""


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=CHROMIUM, ignore_default_args=["--hide-scrollbars"]
        )
        yield chromium
        chromium.close()


class Visit:
    """A page that is open, what its console said and what it asked the network for."""

    def __init__(self, browser, path, width=1280):
        self.said, self.asked = [], []
        self.page = browser.new_page(viewport={"width": width, "height": 900})
        self.page.on("console", lambda message: self.said.append(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.route("**/*", self._only_files)
        self.page.goto(path.as_uri())

    def _only_files(self, route):
        if route.request.url.startswith("file://"):
            route.continue_()
        else:
            self.asked.append(route.request.url)
            route.abort()

    def figures(self):
        """Unfold everything, wait until every figure that is shown is drawn; return what was drawn."""
        self.page.evaluate(_UNFOLD)
        for _ in range(_WAIT_MS // _STEP_MS):
            figures = self.page.evaluate(_DRAWN)
            if all(figure["area"] > 0 for figure in figures):
                break
            self.page.wait_for_timeout(_STEP_MS)
        return figures

    def choices(self):
        """Choose every option of every choice in turn, and return all figures that were drawn."""
        drawn = {figure["name"]: figure for figure in self.figures()}
        for choice in self.page.locator(".choice select").all():
            for i in range(choice.locator("option").count()):
                choice.select_option(index=i)
                drawn |= {figure["name"]: figure for figure in self.figures()}
        return drawn


@pytest.fixture
def visit(browser):
    visits = []

    def open_page(path, width=1280):
        visits.append(Visit(browser, path, width))
        return visits[-1]

    yield open_page
    for each in visits:
        each.page.close()


def record(name, role="train"):
    t = np.arange(1200) * 1e-3
    u = 10.0 * np.sin(2 * np.pi * 5.0 * t) + 3.0 * np.sin(2 * np.pi * 11.0 * t)
    return Record(name, t, u, Plant(P5, 1e-3).simulate(u), ts_s=1e-3, role=role)


def compare_page(folder):
    data = Dataset("two records", (record("first"), record("second", "validation")))
    return write_compare_page(folder / "report.html", compare(data, named_plant("P5-static")))


def bench_page(folder):
    asked = ["--controllers", "none,classical-static", "--references", "sine", "--plants", "P5"]
    small = ["--ts", "1e-3", "--seeds", "1", "--jobs", "1", "--out", str(folder)]
    assert main(["bench", *asked, *small]) == 0
    return folder / "report.html"


@pytest.fixture(params=["bench", "compare", "discover", "diagnose"])
def page(request, tmp_path):
    if request.param == "bench":
        return bench_page(tmp_path)
    if request.param == "compare":
        return compare_page(tmp_path)
    made = request.getfixturevalue(
        "made_discovery" if request.param == "discover" else "made_diagnosis"
    )
    return write_discovery_page(tmp_path / "report.html", "a <b>stage</b>", made())


def test_page_draws_every_figure_silently_and_alone(page, visit):
    opened = visit(page)
    figures = opened.choices()
    assert len(figures) == len(packed_figures(page.read_text(encoding="utf-8"))) > 0
    for figure in figures.values():
        assert figure["plotly"], figure
        assert figure["area"] > 100 * 100, figure
        assert figure["traces"] > 0, figure
    assert opened.said == []
    assert opened.asked == []


@pytest.fixture(params=["bench", "compare", "discover", "diagnose"])
def laid_out(request, tmp_path):
    """Write a page of the kind with much in it, long names and every column."""
    path = tmp_path / "report.html"
    if request.param == "bench":
        made = request.getfixturevalue("made_benchmark")()
        return write_benchmark_page(path, made)
    if request.param == "compare":
        return compare_page(tmp_path)
    made = request.getfixturevalue(
        "made_discovery" if request.param == "discover" else "made_diagnosis"
    )
    return write_discovery_page(path, "a stage", made())


@pytest.mark.parametrize("width", [800, 1280])
def test_nothing_covers_or_cuts_off_anything(width, laid_out, visit):
    opened = visit(laid_out, width)
    opened.figures()
    assert opened.page.evaluate(_OVERLAPS) == []
    titles = opened.page.evaluate(_BEYOND)
    assert titles
    assert [title for title in titles if title["beyond"] > 0] == []
    tables = opened.page.evaluate(_TABLES)
    assert tables
    assert [table for table in tables if table["cut"] > 0 and table["bar"] < 8] == []
    if width >= 1280:
        assert [table for table in tables if table["cut"] > 0] == []
    assert opened.page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")


def test_what_covers_something_is_noticed(tmp_path, visit):
    page = tmp_path / "bad.html"
    page.write_text("<main><p>one</p><p style='margin-top:-2em'>two</p></main>")
    opened = visit(page)
    assert opened.page.evaluate(_OVERLAPS) == [["one", "two"]]


def test_page_that_breaks_the_rules_is_noticed(tmp_path, visit):
    page = tmp_path / "bad.html"
    page.write_text('<img src="https://example.org/a.png"><script>undefined_name()</script>')
    opened = visit(page)
    opened.page.wait_for_timeout(_STEP_MS)
    assert opened.asked == ["https://example.org/a.png"]
    assert any("undefined_name" in text for text in opened.said)


def test_staircase_changes_its_scale(tmp_path, visit, made_discovery):
    opened = visit(write_discovery_page(tmp_path / "report.html", "scales", made_discovery()))
    opened.figures()
    axis = "() => document.getElementById('f1').layout.yaxis.type"
    assert opened.page.evaluate(axis) == "log"
    opened.page.locator("#f1 .updatemenu-button", has_text="linear").click()
    assert opened.page.evaluate(axis) == "linear"
    assert opened.said == []


def test_table_is_sorted_by_a_click(tmp_path, visit, made_diagnosis):
    opened = visit(write_discovery_page(tmp_path / "report.html", "tables", made_diagnosis()))
    opened.figures()
    table = opened.page.locator("section", has_text="The candidates").locator("table").first
    head = table.locator("th", has_text="Validation RMSE")
    head.click()
    head.click()
    names = table.locator("tbody tr td:first-child").all_text_contents()
    # the candidate without an error stays last
    assert names == ["thermal_drift", "delay", "creep", "backlash"]
