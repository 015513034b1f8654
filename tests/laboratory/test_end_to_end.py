"""The whole laboratory in a real browser, nothing put in its place: from dropped files to a notebook."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time

import pytest

import rdpi_gym as rg
from rdpi_gym.measurement import Record

sync_api = pytest.importorskip(
    "playwright.sync_api", reason="Playwright's Python package is not installed (extra: test)"
)
pytest.importorskip("starlette", reason="the extra lab is not installed")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
if CHROMIUM is None:
    pytest.skip(
        "no Chromium is installed (Debian: apt-get install chromium)", allow_module_level=True
    )
_PATIENCE_S, _STEP_MS = 60.0, 30
_RECORDS = ("triangle-slow", "stairs", "validation-loops")
_TRIED = "fetch('/api/state').then(r => r.json()).then(s => s.ranking && s.ranking.step === s.current && s.ranking.cards.length && s.ranking.cards.every(c => ['tried', 'failed', 'final'].includes(c.state)))"
_STEPS = "document.querySelectorAll('#staircase .step:not(.later)').length"


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Records of a stage with two hidden effects, every second sample."""
    whole = rg.simulate("P5", hide=["creep", "asymmetry"], seed=1, ts_factor=4.0)
    records = [
        Record(r.name, r.t_s[::2], r.u_V[::2], r.y_um[::2], ts_s=2 * r.ts_s, role=r.role)
        for r in whole.records
        if r.name in _RECORDS
    ]
    folder = rg.Dataset("two", tuple(records)).write(tmp_path_factory.mktemp("two") / "data")
    return sorted(folder.iterdir())


class Lab:
    """`rdpi lab` in a process of its own, on one session."""

    def __init__(self, session):
        self.session = session
        command = [sys.executable, "-m", "rdpi_gym", "lab", "--no-browser", "--session", session]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, text=True, cwd=session.parent
        )
        self.address = re.search(r"http://\S+", self.process.stdout.readline())[0]

    def journal(self):
        lines = (self.session / "journal.jsonl").read_text(encoding="utf-8").splitlines()
        return [json.loads(line) for line in lines]

    def stop(self):
        self.process.terminate()
        self.process.wait(20)
        self.process.stdout.close()

    def die(self):
        os.kill(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self.process.stdout.close()


class Page:
    """A page of the browser, with what its console said and what it asked other machines."""

    def __init__(self, tab):
        self.tab, self.said, self.asked = tab, [], []
        tab.set_default_timeout(1000 * _PATIENCE_S)
        tab.on("console", lambda message: self.said.append(message.text))
        tab.on("pageerror", lambda error: self.said.append(str(error)))
        tab.on("request", self._request)

    def _request(self, request):
        if not re.match(r"(http://127\.0\.0\.1:\d+/|data:|blob:)", request.url):
            self.asked.append(request.url)

    def open(self, lab):
        end = time.monotonic() + _PATIENCE_S
        while True:
            try:
                self.tab.goto(lab.address)
                break
            except sync_api.Error:
                if time.monotonic() > end:
                    raise
        self.tab.get_by_test_id("bring").wait_for(state="attached")

    def until(self, told):
        end = time.monotonic() + _PATIENCE_S
        while not self.tab.evaluate(told):
            assert time.monotonic() < end, told
            self.tab.wait_for_timeout(_STEP_MS)

    def text(self, name):
        return self.tab.get_by_test_id(name).inner_text()

    def click(self, name):
        self.tab.get_by_test_id(name).click()

    def first_card(self):
        return self.tab.locator("#cards > li").first.get_attribute("data-testid")


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM)
        yield chromium
        chromium.close()


def test_two_hidden_effects_are_found_and_taken_home(browser, files, tmp_path):
    lab = Lab(tmp_path / "session")
    page = Page(browser.new_page(viewport={"width": 1280, "height": 720}, reduced_motion="reduce"))
    try:
        page.open(lab)
        _walk(page, lab, files, tmp_path)
    finally:
        lab.stop()
    assert page.said == []
    assert page.asked == []
    page.tab.close()


def _walk(page, lab, files, folder):
    page.tab.get_by_test_id("files-input").set_input_files(files)
    page.until(f"{_STEPS} === 1")
    for count, effect in enumerate(("asymmetry", "creep"), 2):
        page.until(_TRIED)
        assert page.first_card() == f"card-{effect}"
        page.click(f"add-{effect}")
        page.until(f"{_STEPS} === {count}")
    page.until("document.getElementById('sentence').textContent.includes('the noise')")
    events = lab.journal()
    steps = [event["step"] for event in events if event["do"] == "step"]
    noise = [event["noise_um"] for event in events if event["do"] == "said"][-1]
    assert steps[-1]["validation_um"] < 1.1 * noise < 0.5 * steps[0]["validation_um"]
    page.click("undo")
    page.until(f"{_STEPS} === 2")
    page.click("redo")
    page.until(f"{_STEPS} === 3")
    with page.tab.expect_download() as coming:
        page.click("take-notebook")
    coming.value.save_as(folder / "taken.ipynb")
    assert _run(folder / "taken.ipynb") == {
        step["id"]: [step["train_um"], step["validation_um"]] for step in _present(lab).values()
    }


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
    lab = Lab(tmp_path / "session")
    page = Page(browser.new_page(viewport={"width": 1280, "height": 720}, reduced_motion="reduce"))
    page.open(lab)
    page.tab.get_by_test_id("files-input").set_input_files(files)
    page.until(f"{_STEPS} === 1")
    page.click("cancel")
    page.tab.get_by_test_id("job").wait_for(state="hidden")
    bad = {"name": "bad.csv", "mimeType": "text/csv", "buffer": b"t,u,y\n0,1,2\n0.1,none,2\n"}
    page.tab.get_by_test_id("files-input").set_input_files([bad])
    page.tab.get_by_test_id("refused-bad.csv").wait_for()
    assert "line 3" in page.text("refused-bad.csv")
    page.click("discard-bad.csv")
    page.click("columns")
    page.tab.get_by_test_id("unit-time").fill("fortnights")
    page.click("apply-columns")
    page.until("document.getElementById('alert-text').textContent.includes('fortnights')")
    page.until(f"{_STEPS} === 1")  # what was there stays
    before = page.tab.locator("#staircase .step").first.inner_text()
    lab.die()
    page.until("document.getElementById('alert-text').textContent.includes('rdpi lab --session')")
    again = Lab(tmp_path / "session")
    try:
        page.open(again)
        page.until(f"{_STEPS} === 1")
        assert page.tab.locator("#staircase .step").first.inner_text() == before
        assert page.asked == []
    finally:
        again.stop()
        page.tab.close()
