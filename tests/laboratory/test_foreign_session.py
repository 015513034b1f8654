"""A session folder from somebody else: nothing outside it is read or written, nothing in it is code."""

import ast
import asyncio
import json
import os
import socket

import pytest

import rdpi_gym as rg
from rdpi_gym.laboratory.downloads import notebook_of
from rdpi_gym.laboratory.lab import Lab
from rdpi_gym.laboratory.opening import session_folder
from rdpi_gym.laboratory.session import JOURNAL, Session, Step
from rdpi_gym.laboratory.session_jobs import Events
from tests.laboratory.test_lab import Played

SECRET = "what the user has elsewhere"


def places(folder):
    """A session, and a folder of the user outside it."""
    session, elsewhere = folder / "session", folder / "home"
    for made in (session / "data", session / "refused", elsewhere):
        made.mkdir(parents=True)
    (session / JOURNAL).touch()
    (elsewhere / "thesis.csv").write_text(SECRET)
    return session, elsewhere


@pytest.fixture
def session(tmp_path):
    return places(tmp_path)[0]


def step(**changes):
    made = Step("s1", None, "Base model", {"kind": "fit"}, rg.plants["P5"], 1.0, 2.0, {"run": 1.5})
    return {"do": "step", "step": {**made.to_dict(), **changes}}


def journal(folder, *events):
    (folder / JOURNAL).write_text("".join(json.dumps(event) + "\n" for event in events))


def instead(place, target):
    """Put a link to a target in the place of a file or a folder."""
    if place.is_dir():
        place.rmdir()
    place.unlink(missing_ok=True)
    place.symlink_to(target)


def special(place, make):
    place.unlink(missing_ok=True)
    make(str(place))


LINKS = {
    "data": lambda folder, target: instead(folder / "data", target),
    "refused": lambda folder, target: instead(folder / "refused", target),
    "a file": lambda folder, target: instead(folder / "data/run.csv", target / "thesis.csv"),
    "a part": lambda folder, target: instead(folder / "data/.run.csv.part", target / "thesis.csv"),
    "a hanging link": lambda folder, target: instead(folder / "data/run.csv", "nowhere"),
    "journal": lambda folder, target: instead(folder / JOURNAL, target / "thesis.csv"),
    "settings": lambda folder, target: instead(folder / "data/dataset.toml", target / "thesis.csv"),
    "journal as FIFO": lambda folder, target: special(folder / JOURNAL, os.mkfifo),
    "settings as FIFO": lambda folder, target: special(folder / "data/dataset.toml", os.mkfifo),
    "socket": lambda folder, target: special(
        folder / "data/run.csv", socket.socket(socket.AF_UNIX).bind
    ),
}
LINK = "is a link or no regular file; this folder may hold neither"


def test_a_session_with_a_link_or_a_special_file_is_refused(
    monkeypatch, subtests, tmp_path_factory
):
    for kind in LINKS:
        with subtests.test(kind=kind):
            tmp_path = tmp_path_factory.mktemp("case")
            session, elsewhere = places(tmp_path)
            monkeypatch.chdir(session.parent)  # the address of a socket is short
            LINKS[kind](session.relative_to(session.parent), elsewhere)
            for reader in (session_folder, Session):
                with pytest.raises(rg.InputError, match=LINK):
                    reader(session)
            assert (elsewhere / "thesis.csv").read_text() == SECRET


def attack(session, elsewhere, kind, act, monkeypatch):
    monkeypatch.setattr("rdpi_gym.laboratory.session_jobs.Workers", Played)

    async def write(path):
        path.write_bytes(b"foreign")

    async def attacked():
        lab = Lab(session, Events(), 1)
        lab.start()
        await lab.put_file("run.csv", write)
        (session / "data" / "run.csv").unlink()
        LINKS[kind](session, elsewhere)
        actions = {
            "put": lambda: lab.put_file("run.csv", write),
            "delete": lambda: lab.delete_file("run.csv"),
            "open": lab.open,
            "settings": lambda: lab.set_settings({"title": "x"}),
            "clear": lab._clear,
        }
        with pytest.raises(rg.InputError, match="is a link or no regular file"):
            await actions[act]()

    asyncio.run(attacked())
    assert [(f.name, f.read_text()) for f in elsewhere.iterdir()] == [("thesis.csv", SECRET)]


def test_a_link_that_comes_while_it_is_open_is_not_followed(
    monkeypatch, subtests, tmp_path_factory
):
    for act in ["put", "delete", "open", "settings", "clear"]:
        for kind in ["data", "a file", "settings"]:
            with subtests.test(act=act, kind=kind):
                tmp_path = tmp_path_factory.mktemp("case")
                session, elsewhere = places(tmp_path)
                attack(session, elsewhere, kind, act, monkeypatch)


CODE = "s1 = 0\nimport os; os.system('true')\ns1"


def test_a_name_of_a_step_that_is_none_is_damage(subtests, tmp_path_factory):
    for events in [
        [step(id=CODE)],
        [step(id="s1; print(1)")],
        [step(id="ｓ1")],
        [step(), step(id="s2", parent=CODE)],
        [step(parent="s1")],
        [step(), step(id="s2", parent="s1"), {**step(parent="s2"), "do": "update"}],
        [step(), {"do": "go", "path": [CODE], "redo": []}],
        [step(), {"do": "go", "path": ["s1"], "redo": ["s7"]}],
        [step(), {"do": "refit", "step": CODE, "refit": {"effect": "", "form": ""}}],
        [step(train_um="__import__('os')")],
        [step(label=["x"])],
        [step(held=[1])],
    ]:
        with subtests.test(events=events):
            tmp_path = tmp_path_factory.mktemp("case")
            session, _ = places(tmp_path)
            journal(session, *events)
            with pytest.raises(rg.InputError, match=r"journal\.jsonl, line \d is damaged"):
                Session(session)


def test_every_text_of_a_journal_is_quoted_in_the_notebook(session):
    nasty = "'''\"\"\"\\\n<script>alert(1)</script> ![](x) `rm`"
    first = step(label=nasty, made={"kind": "fit", "core": nasty})
    others = [
        {"kind": "candidate", "effect": nasty, "form": nasty},
        {"kind": "added", "effect": nasty},
        {"kind": "removal", "effect": nasty},
        {"kind": "refit", "held": [nasty]},
        {"kind": nasty, "effect": nasty, "parameter": nasty, "value": nasty},
        {"kind": "set", "effect": "", "parameter": nasty, "value": [nasty]},
    ]
    steps = [step(id=f"s{k}", parent=f"s{k - 1}", made=made) for k, made in enumerate(others, 2)]
    journal(session, {"do": "read"}, first, *steps)
    t = [0.01 * k for k in range(40)]
    (session / "data" / "run.csv").write_text("t,u,y\n" + "".join(f"{x},{x},{x}\n" for x in t))
    cells = json.loads(notebook_of(Session(session)))["cells"]
    calls = {
        ast.unparse(node.func)
        for cell in cells
        if cell["cell_type"] == "code"
        for node in ast.walk(ast.parse("".join(cell["source"])))
        if isinstance(node, ast.Call)
    }
    assert not calls & {"os.system", "alert", "__import__", "eval", "exec"}
    text = "".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")
    assert "<script" not in text
    assert "![" not in text


BAD_SETTINGS = {
    "not UTF-8": b'title = "\xff"',
    "records is a number": b"records = 3",
    "a record is a number": b"[records]\nrun = 3",
    "broken": b"[records",
    "a date": b"title = 1979-05-27",
    "a date in a record": b"[records.run]\nnote = 1979-05-27T07:32:00Z",
    "too large": b"#" * (2**20 + 1),
    "units is a list": b"units = [1]",
}


def bring_settings(session, tmp_path, kind, as_folder, monkeypatch):
    monkeypatch.setattr("rdpi_gym.laboratory.session_jobs.Workers", Played)
    rig = tmp_path / "rig"
    rig.mkdir()
    (rig / "run.csv").write_text("t,u,y\n" + "".join(f"{k},{k % 9},{k}\n" for k in range(40)))
    (rig / "dataset.toml").write_bytes(BAD_SETTINGS[kind])

    async def brought():
        lab = Lab(session, Events(), 1)
        lab.start()
        with pytest.raises(rg.InputError, match=r"dataset\.toml"):
            await lab.bring([rig if as_folder else rig / "run.csv"])
        return lab.state()

    assert asyncio.run(brought())["current"] is None
    # and as they may stand in the session of somebody else
    (session / "data" / "dataset.toml").write_bytes(BAD_SETTINGS[kind])
    (session / "data" / "run.csv").write_bytes((rig / "run.csv").read_bytes())

    async def opened():
        lab = Lab(session, Events(), 1)
        lab.start()
        with pytest.raises(rg.InputError, match=r"dataset\.toml"):
            await lab.open()
        return json.dumps(lab.state())

    assert "run.csv" in asyncio.run(opened())


def test_bad_settings_beside_a_record_are_one_line(monkeypatch, subtests, tmp_path_factory):
    for kind in BAD_SETTINGS:
        for as_folder in [True, False]:
            with subtests.test(kind=kind, as_folder=as_folder):
                tmp_path = tmp_path_factory.mktemp("case")
                session, _ = places(tmp_path)
                bring_settings(session, tmp_path, kind, as_folder, monkeypatch)
