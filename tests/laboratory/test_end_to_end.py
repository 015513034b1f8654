"""The whole laboratory in a real browser, nothing put in its place: from dropped files to a notebook."""

import json
import subprocess
import sys
from dataclasses import replace

import pytest

import rdpi_gym as rg
from rdpi_gym.measurement import Record
from rdpi_gym.plant import Plant
from studies.chromium import LabPage, LabProcess

_RECORDS = ("triangle-slow", "stairs", "validation-loops")


@pytest.fixture(scope="module")
def hidden():
    """A stage with two hidden effects."""
    return rg.simulate("P5", hide=["creep", "asymmetry"], seed=1, ts_factor=4.0)


@pytest.fixture(scope="module")
def files(hidden, tmp_path_factory):
    """Records of it, every second sample."""
    records = [
        Record(r.name, r.t_s[::2], r.u_V[::2], r.y_um[::2], ts_s=2 * r.ts_s, role=r.role)
        for r in hidden.records
        if r.name in _RECORDS
    ]
    folder = rg.Dataset("two", tuple(records)).write(tmp_path_factory.mktemp("two") / "data")
    return sorted(folder.iterdir())


def test_two_hidden_effects_are_found_and_taken_home(browser, hidden, files, tmp_path):
    with LabProcess(tmp_path / "session") as lab, LabPage(browser) as page:
        page.open(lab)
        _walk(page, lab, files, tmp_path)
        steps = [event["step"] for event in lab.journal() if event["do"] == "step"]
    # with 15 % on top, as for the noise: motion between samples is left by the stage itself
    assert steps[-1]["validation_um"] < 1.15 * _left_by(hidden) < 0.5 * steps[0]["validation_um"]
    assert page.said == []
    assert page.asked == []


def _left_by(hidden):
    """Residual of the stage itself on the record to judge by, simulated from every second sample (µm rms)."""
    stage = replace(hidden.truth.plant, effects=hidden.truth.hidden)
    (record,) = [r for r in hidden.records if r.name == "validation-loops"]
    simulated = Plant(stage, 2 * record.ts_s).simulate(record.u_V[::2])
    return float((record.y_um[::2] - simulated).std())


def _walk(page, lab, files, folder):
    page.drop(files)
    page.until_steps(1)
    for count, effect in enumerate(("asymmetry", "creep"), 2):
        page.until_ranked()
        page.tab.get_by_test_id(f"card-{effect}").filter(has_text="advised").wait_for()
        assert page.first_card == effect
        page.click(f"add-{effect}")
        page.until_steps(count)
    page.until("document.getElementById('sentence').textContent.includes('the noise')")
    page.click("undo")
    page.until_steps(2)
    page.click("redo")
    page.until_steps(3)
    with page.tab.expect_download() as coming:
        page.click("take-notebook")
    coming.value.save_as(folder / "taken.ipynb")
    assert _run(folder / "taken.ipynb") == {
        step["id"]: [step["train_um"], step["validation_um"]] for step in _present(lab).values()
    }


def test_a_measured_stack_is_brought_nearer(browser, tmp_path):
    with LabProcess(tmp_path / "session") as lab, LabPage(browser) as page:
        page.open(lab)
        page.click("example-picma")
        page.until_steps(1)
        page.tab.locator("#cards > li").filter(has_text="advised").wait_for(timeout=300_000)
        assert page.first_card == "asymmetry"
        page.click("add-asymmetry")
        page.until_steps(2)
        page.until_ranked()
        base, asymmetric = _present(lab).values()
    assert page.said == []
    assert asymmetric["validation_um"] < 0.2 < 0.7 * base["validation_um"]


def _present(lab):
    """Return the steps as the journal has them last."""
    return {e["step"]["id"]: e["step"] for e in lab.journal() if e["do"] in ("step", "update")}


def _run(notebook):
    """Run the code of a notebook in a process of its own; return its errors."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    code.append("import json\nprint(json.dumps({k: list(v) for k, v in errors.items()}))")
    script = notebook.with_suffix(".py")
    script.write_text("\n".join(code).replace("JOBS = -1", "JOBS = 1"), encoding="utf-8")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_what_goes_wrong_is_a_sentence_and_loses_nothing(browser, files, tmp_path):
    session = tmp_path / "session"
    with LabPage(browser) as page:
        with LabProcess(session) as lab:
            before = _spoiled(page, lab, files)
        with LabProcess(session) as again:
            page.open(again)
            page.until_steps(1)
            assert page.tab.locator("#staircase .step").first.inner_text() == before
        assert page.asked == []


def _spoiled(page, lab, files):
    """Give a file that is none and a unit that there is not, kill the server; return the step."""
    page.open(lab)
    page.drop(files)
    page.until_steps(1)
    page.click("cancel")
    page.tab.get_by_test_id("job").wait_for(state="hidden")
    bad = {"name": "bad.csv", "mimeType": "text/csv", "buffer": b"t,u,y\n0,1,2\n0.1,none,2\n"}
    page.drop([bad])
    page.tab.get_by_test_id("refused-bad.csv").wait_for()
    assert "line 3" in page.text("refused-bad.csv")
    assert "row 3, column u" in page.text("refused-bad.csv")
    page.click("discard-bad.csv")
    page.tab.get_by_test_id("refused-bad.csv").wait_for(state="detached")
    detail = page.tab.locator("#detail")
    detail.locator("summary").click()
    detail.get_by_label("Unit of time").fill("fortnights")
    detail.get_by_role("button", name="Read again").click()
    detail.get_by_text("unit 'fortnights' of t is unknown").wait_for(timeout=60_000)
    page.until_steps(1)  # what was there stays
    before = page.tab.locator("#staircase .step").first.inner_text()
    lab.die()
    page.until("document.getElementById('alert-text').textContent.includes('rdpi lab --session')")
    return before


def test_two_laboratories_in_one_browser_and_a_ticket_that_is_good_once(browser, tmp_path):
    opened = [rg.lab(browser=False, session=tmp_path / name) for name in ("one", "other")]
    try:
        with LabPage(browser) as page:
            for lab in (*opened, *opened):
                page.tab.goto(lab.address)
                page.until("document.body.classList.contains('loaded')")
                assert "#" not in page.tab.url
                page.tab.goto(page.tab.url)  # the address alone, as from a bookmark
                page.until("document.body.classList.contains('loaded')")
            assert page.tab.context.cookies() == []
            assert page.said == []
    finally:
        for lab in opened:
            lab.stop()


def test_the_address_that_a_browser_is_started_with_is_good_once(browser, tmp_path, monkeypatch):
    given = []
    monkeypatch.setattr("webbrowser.open", given.append)
    lab = rg.lab(session=tmp_path / "session")
    token = lab.address.partition("=")[2]
    try:
        assert token not in given[0]
        with LabPage(browser) as first:
            first.tab.goto(given[0])
            first.until("document.body.classList.contains('loaded')")
        with LabPage(browser) as second:
            second.tab.goto(given[0])
            second.until("!document.getElementById('alert').hidden")
            assert "has been opened already" in second.text("alert")
    finally:
        lab.stop()
