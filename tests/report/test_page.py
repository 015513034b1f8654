"""A page is one file that fetches nothing, shows foreign names as text, and is whole or absent."""

import gzip
import json
from base64 import b64decode
from html.parser import HTMLParser

import pandas as pd
import plotly.graph_objects as go
import pytest

from rdpi_gym.report import page as page_module
from rdpi_gym.report.page import Section, write_page
from rdpi_gym.report.style import figure_text, styled
from rdpi_gym.support.errors import InputError
from tests.unpacked import figures

NASTY = '</script><script>alert(1)</script><b onload="x">&amp; "name"'
LOADING = {"src", "href", "srcset", "action", "data", "poster", "background"}


class Reader(HTMLParser):
    """Collects what a browser would: tags, their attributes, and the text of elements."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.text, self.scripts = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag == "script":
            self.scripts.append("")

    def handle_data(self, data):
        if self.tags and self.lasttag == "script" and self.cdata_elem == "script":
            self.scripts[-1] += data
        else:
            self.text.append(data)


def small_figure(name="measured"):
    return styled(go.Figure(go.Scatter(x=[0.0, 1.0], y=[0.0, 2.0], name=figure_text(name))))


@pytest.fixture
def written(tmp_path):
    sections = [
        Section(NASTY, f"{NASTY}\n\n- first {NASTY}\n- second", small_figure(NASTY)),
        Section("Two figures", "Both.", [small_figure(), small_figure()]),
        Section("A choice", "One of two.", {NASTY: small_figure(), "other": small_figure()}),
        Section("A table", "Below.", table=pd.DataFrame({NASTY: [NASTY], "rmse_um": [0.125]})),
        Section("Words only", "No figure.", folded=True),
    ]
    return write_page(tmp_path / "report.html", NASTY, NASTY, sections).read_text(encoding="utf-8")


def test_nothing_is_fetched(written):
    for tag, attributes in Reader(written).tags:
        assert tag not in {"iframe", "object", "embed", "img", "base", "form"}
        for name in LOADING & attributes.keys():
            assert attributes[name].startswith(("#", "data:,")), (tag, attributes)
    assert "@import" not in page_module.CSS
    assert "url(" not in page_module.CSS
    # and the browser is told so
    (policy,) = (a["content"] for _, a in Reader(written).tags if "http-equiv" in a)
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy


def test_foreign_names_stay_text(written):
    reader = Reader(written)
    assert "alert(1)" in "".join(reader.text)
    assert not any("onload" in attributes for _, attributes in reader.tags)
    assert not any(script.strip().startswith("alert") for script in reader.scripts)
    assert NASTY in reader.text
    blocks = figures(written)
    assert len(blocks) == 5
    assert json.loads(blocks[0])["data"][0]["name"] == figure_text(NASTY)


def test_every_figure_has_its_data_and_every_link_its_section(written):
    tags = Reader(written).tags
    identifiers = {attributes["id"] for _, attributes in tags if "id" in attributes}
    boxes = [attributes for _, attributes in tags if attributes.get("class") == "figure"]
    links = [attributes["href"][1:] for tag, attributes in tags if tag == "a"]
    options = [attributes["value"] for tag, attributes in tags if tag == "option"]
    assert len(boxes) == 5
    assert {box["data-figure"] for box in boxes} <= identifiers
    assert len(links) == 5
    assert set(links) | set(options) <= identifiers
    assert sum("hidden" in box for box in boxes) == 1
    names = [NASTY, "Two figures", "Two figures", f"A choice, {NASTY}", "A choice, other"]
    assert [(box["role"], box["aria-label"]) for box in boxes] == [("figure", n) for n in names]


def test_paragraphs_and_lists(tmp_path, written):
    page = write_page(tmp_path / "a.html", "T", "one\ntwo\n\nthree\n\n- a\n- b", [])
    text = page.read_text(encoding="utf-8")
    counts = [t.count('<script type="text/plain" id="plotly">') for t in (text, written)]
    assert counts == [0, 1]  # inside once, packed, and only where there are figures
    packed = next(s for s in Reader(written).scripts if len(s) > 1e6)
    assert "plotly.js v" in gzip.decompress(b64decode(packed)).decode()[:200]
    assert "<p>one two</p>" in text
    assert "<p>three</p>" in text
    assert "<ul><li>a</li><li>b</li></ul>" in text


def test_failure_leaves_the_old_page_and_no_part(tmp_path):
    target = tmp_path / "report.html"
    write_page(target, "Old", "Old.", [])
    before = target.read_bytes()
    with pytest.raises(AttributeError):
        write_page(target, "New", "New.", [Section("One", "Text.", figure=object())])
    assert target.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["report.html"]
    write_page(target, "Old", "Old.", [])
    assert target.read_bytes() == before  # the same input gives the same bytes
    with pytest.raises(InputError, match="cannot be written"):
        write_page(target / "report.html", "T", "S", [])
