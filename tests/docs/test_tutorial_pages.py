"""The pages that walk through the laboratory: made from their templates, by commands that exist."""

import re
from pathlib import Path

import pytest

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_json
from studies.pages import (
    CONSOLE,
    ELISION,
    FENCE,
    PROMPT,
    TEMPLATES,
    Session,
    contradiction,
    fill,
    is_claim,
    quoted,
)
from studies.tutorial import PAGES
from studies.tutorial import main as make
from tests.looping import over

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
MAKE = "run python -m studies.tutorial"


def prose_and_commands(text):
    """Lines of a page or a template, without what its commands print."""
    kept, block = [], ""
    for line in text.splitlines():
        if block == CONSOLE and line != FENCE and not line.startswith(PROMPT):
            continue
        kept.append(line)
        if block:
            block = "" if line == FENCE else block
        elif line.startswith(FENCE):
            block = line
    return kept


def as_pattern(line):
    """A line of a template as a pattern of the page's line."""
    line = re.sub(r'^(!\[.*\]\(\S+) ".*"\)$', r"\1)", line)
    return "(.+)".join(re.escape(part) for part in re.split(r"\{\{.*?\}\}", line))


@over("name", PAGES)
def test_page_is_made_from_its_template(name):
    template = prose_and_commands(TEMPLATES[name].read_text(encoding="utf-8"))
    wanted = [as_pattern(line) for line in template if not is_claim(line)]
    page = prose_and_commands((DOCS / f"{name}.md").read_text(encoding="utf-8"))
    assert len(page) == len(wanted), MAKE
    for pattern, line in zip(wanted, page, strict=True):
        assert re.fullmatch(pattern, line), MAKE


@over("name", PAGES)
def test_every_command_of_a_page_has_printed_something(name):
    page = (DOCS / f"{name}.md").read_text(encoding="utf-8")
    for block in re.findall(r"^```console\n(.*?)^```$", page, flags=re.M | re.S):
        for said in re.split(r"^\$ .*\n", block, flags=re.M)[1:]:
            assert said.strip() or "make_data" in block
    assert "/tmp" not in page
    assert "Traceback" not in page


def test_pictures_exist_are_small_and_none_is_left_over():
    shown = set()
    for name in PAGES:
        page = (DOCS / f"{name}.md").read_text(encoding="utf-8")
        shown |= set(re.findall(r"^!\[.*\]\((tutorial/\S+)\)$", page, flags=re.M))
    assert {f"tutorial/{path.name}" for path in (DOCS / "tutorial").iterdir()} == shown
    for path in shown:
        content = (DOCS / path).read_bytes()
        assert content.startswith(b"\x89PNG")
        assert len(content) < 40_000, path


@pytest.fixture
def session(tmp_path):
    write_json(
        tmp_path / "add.json",
        {"format": "rdpi-add", "version": 1, "steps": [{"effect": "creep", "size": 0.01234}, {"effect": "delay", "size": 2.0}]},
    )  # fmt: skip
    return Session(tmp_path)


def test_numbers_and_names_are_filled_in(session):
    line = "{{add.json:steps.*.effect}}: {{add.json:steps.0.size:.2g}} µm"
    assert quoted(line, session.folder) == "creep and delay: 0.012 µm"
    with pytest.raises(InputError, match=r"add\.json has no steps\.5\.size"):
        quoted("{{add.json:steps.5.size}}", session.folder)


@over(
    "claim, holds",
    [
        ("steps.0.effect = creep", True),
        ("steps.0.effect = delay", False),
        ("steps.*.effect = creep, delay", True),
        ("steps.-1.size > 1.5", True),
        ("steps.-1.size < 1.5", False),
        ("steps.0.effect ~ ree", True),
        ("steps.0.effect ~ reed", False),
        ("steps.*.effect ! lag", True),
        ("steps.*.effect ! delay", False),
    ],
)
def test_claims_are_held_against_the_results(claim, holds, session):
    assert (contradiction(f"<!-- claim: add.json:{claim} -->", session.folder) is None) is holds


def test_a_claim_that_cannot_be_read_is_refused(session):
    with pytest.raises(InputError, match="write <!-- claim"):
        contradiction("<!-- claim: all is well -->", session.folder)


def test_template_is_filled(session):
    template = (
        'Text.\n\n![Alt](tutorial/a.png "results/report.html: Loops / first (train)")\n'
        "<!-- claim: add.json:steps.0.effect = creep -->\n```console\n$ rdpi effects delay\n```\n"
        "```toml sub/dataset.toml\nskip_s = 1.0\n```\n"
    )
    drawn = []

    def draw(page, section, choice):
        drawn.append((page.relative_to(session.folder).as_posix(), section, choice))
        return b"PNG"

    page, pictures = fill(template, session, draw)
    assert drawn == [("results/report.html", "Loops", "first (train)")]
    assert pictures == {"tutorial/a.png": b"PNG"}
    lines = page.splitlines()
    assert lines[2] == "![Alt](tutorial/a.png)"
    assert lines[3:5] == [CONSOLE, "$ rdpi effects delay"]
    assert any("y(t) = y_m(t - T)" in line for line in lines)
    assert (session.folder / "sub" / "dataset.toml").read_text() == "skip_s = 1.0\n"
    with pytest.raises(InputError, match=r"effect is creep, the prose says = delay"):
        fill("<!-- claim: add.json:steps.0.effect = delay -->", session, draw)


def test_the_list_of_records_is_printed_once(session):
    (session.folder / "say.py").write_text(
        "import sys\nprint(sys.argv[1], 'data', *(f'  record {k} (train): 9 samples' for k in range(4)), '', '', 'end', sep='\\n')\n"
    )
    assert session.run("python say.py one")[-3:] == ["  record 3 (train): 9 samples", "", "end"]
    assert session.run("python say.py two") == ["two", ELISION, "", "end"]


LONG = "rdpi discover --example picma --out results/picma/found"
"""Takes a minute and a half of processor: the study alone runs it, and holds the claims against it."""


MOST_LINES = 25


def printed_of(page):
    """Printed text of each command of a page, by the command."""
    found = {}
    for block in re.findall(r"^```console\n(.*?)^```$", page, flags=re.M | re.S):
        for part in re.split(r"^\$ ", block, flags=re.M)[1:]:
            command, *lines = part.splitlines()
            found[command] = lines
    return found


def wording(lines):
    """Words of what a command prints: digits, and the widths of columns, are those of a machine."""
    words = re.sub(r"−?\d[\d.]*(e[+-]?\d+)?", "0", " ".join(lines)).replace("─", "")
    return words.split()


def test_the_commands_run_as_pasted_and_print_what_the_page_shows(tmp_path):
    printed = printed_of((DOCS / "tutorial.md").read_text(encoding="utf-8"))
    assert LONG in printed
    assert len(printed) == 8
    session = Session(tmp_path)
    for command in printed:
        if command != LONG:
            lines = session.run(command)
            assert wording(lines) == wording(printed[command]), MAKE
            assert len(lines) <= MOST_LINES, command
    assert len(printed[LONG]) <= MOST_LINES


@over(
    "command, said",
    [
        ("rdpi simulate --hide crep", "'crep' is unknown"),
        ("rm -r results", "a page runs rdpi, python, head and nothing else"),
        ("python missing.py", "missing.py"),
    ],
)
def test_a_command_that_fails_is_named(command, said, session):
    with pytest.raises(InputError, match=said):
        session.run(command)


def test_an_unknown_page_is_refused(capsys):
    assert make(["nothing"]) == 2
    assert "no page is named 'nothing'" in capsys.readouterr().err
