"""Pictures for pages: small PNG files, and the browser without a window, with the laboratory's page in it."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

import numpy as np
from PIL import Image

from rdpi_gym.support.errors import InputError

COLOURS = 128
"""Colours of a small picture: those that fill most of it; all others go to the nearest."""


def small_png(picture: bytes) -> bytes:
    """Return a PNG picture with few colours: lines on paper take less than half of the bytes."""
    pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(np.int32)
    height, width, _ = pixels.shape
    found, place, counts = np.unique(
        pixels.reshape(-1, 3), axis=0, return_inverse=True, return_counts=True
    )
    common = found[np.argsort(-counts, kind="stable")[:COLOURS]]
    distance = np.sum((found[:, None, :] - common[None, :, :]) ** 2, axis=2)
    nearest = np.argmin(distance, axis=1).astype(np.uint8)
    few = Image.frombytes("P", (width, height), nearest[place.ravel()].tobytes())
    few.putpalette(common.astype(np.uint8).tobytes())
    return _written(few)


def screen_png(picture: bytes) -> bytes:
    """Return a PNG picture of a screen with 256 colours, rare ones of thin lines among them."""
    whole = Image.open(io.BytesIO(picture)).convert("RGB")
    few = whole.quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    return _written(few)


def _written(picture: Image.Image) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, "PNG", optimize=True)
    return stream.getvalue()


_PATIENCE_S, _LOOK_MS, _ASK_MS = 300.0, 20, 200
_BEARER = "'Bearer ' + localStorage.getItem('rdpi-lab-token')"
_OWN = re.compile(r"(http://127\.0\.0\.1:\d+/|data:|blob:)")


@contextmanager
def chromium() -> Iterator[Any]:
    """Open Chromium, without a window."""
    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise InputError("pictures need Playwright: pip install '.[test]'") from None
    if path is None:
        raise InputError("pictures need Chromium; on Debian, apt-get install chromium")
    with sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=path)
        try:
            yield found
        finally:
            found.close()


WIDTH_PX, _TIMEOUT_MS = 980, 60_000
# The figure of a section; of several, the one with that number or under that name.
_DRAW = """async ([section, choice, width]) => {
  const sections = [...document.querySelectorAll("section")];
  const found = sections.find((each) => each.querySelector("h2").textContent === section);
  if (!found) return "no section";
  const option = [...found.querySelectorAll("option")].find((o) => o.textContent === choice);
  const boxes = found.querySelectorAll(".figure");
  const box = option ? document.getElementById(option.value) : boxes[(Number(choice) || 1) - 1];
  if (!box || (choice && !option && !Number(choice))) return "no figure";
  const packed = atob(document.getElementById(box.dataset.figure).textContent);
  const bytes = new Blob([Uint8Array.from(packed, (letter) => letter.charCodeAt(0))]);
  const text = new Response(bytes.stream().pipeThrough(new DecompressionStream("gzip"))).text();
  const figure = JSON.parse(await text);
  // what a picture cannot do: buttons
  const layout = {...figure.layout, updatemenus: []};
  return Plotly.toImage({data: figure.data, layout: layout},
                        {format: "png", width: width, height: figure.layout.height});
}"""


def figure_png(browser: Any, page: Path, section: str, choice: str = "") -> bytes:
    """Return one figure of a page of results as a small PNG file."""
    if not page.is_file():
        raise InputError(f"{page} is missing; the template takes a picture from it")
    tab = browser.new_page()
    try:
        tab.set_default_timeout(_TIMEOUT_MS)
        tab.goto(page.resolve().as_uri())
        tab.wait_for_function("window.Plotly || !document.getElementById('plotly')")
        drawn = str(tab.evaluate(_DRAW, [section, choice, WIDTH_PX]))
    finally:
        tab.close()
    head, comma, data = drawn.partition(",")
    if not comma:
        raise InputError(f"{page} has {head} {section!r} {choice!r}; the template draws it")
    return small_png(base64.b64decode(data))


class LabProcess:
    """`rdpi lab` in a process of its own on the folder of a session; a browser opens its `address`."""

    def __init__(self, session: Path, sources: Sequence[Path] = ()) -> None:
        self.session = session
        command = [sys.executable, "-m", "rdpi_gym", "lab", *map(str, sources)]
        self._process = subprocess.Popen(
            [*command, "--no-browser", "--session", str(session)],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        found = re.search(r"http://\S+", self._process.stdout.readline())
        if found is None:
            raise InputError("rdpi lab printed no address; what it said stands above")
        self.address = found[0]

    def __enter__(self) -> Self:
        """Let it run as long as it is needed."""
        return self

    def __exit__(self, *_: object) -> None:
        """End it where it still runs."""
        self.stop()

    def journal(self) -> list[dict[str, Any]]:
        """Return what the journal of the session holds."""
        text = (self.session / "journal.jsonl").read_text(encoding="utf-8")
        return [json.loads(line) for line in text.splitlines()]

    def stop(self) -> None:
        """Ask the server to end; one that is dead stays so."""
        self._process.terminate()
        self._ended()

    def die(self) -> None:
        """Kill the server, as a power failure would."""
        self._process.kill()
        self._ended()

    def _ended(self) -> None:
        self._process.wait()
        assert self._process.stdout is not None
        self._process.stdout.close()


class LabPage:
    """The laboratory's page in a browser: lines of its console, and requests to other machines."""

    def __init__(self, browser: Any, dark: bool = False) -> None:
        self.tab = browser.new_page(
            viewport={"width": 1280, "height": 720},
            reduced_motion="reduce",
            color_scheme="dark" if dark else "light",
        )
        self.said: list[str] = []
        self.asked: list[str] = []
        self.tab.set_default_timeout(1000 * _PATIENCE_S)
        self.tab.on("console", lambda message: self.said.append(message.text))
        self.tab.on("pageerror", lambda error: self.said.append(str(error)))
        self.tab.on("request", self._request)

    def __enter__(self) -> Self:
        """Show it as long as it is needed."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the page."""
        self.tab.close()

    def _request(self, request: Any) -> None:
        if not _OWN.match(request.url):
            self.asked.append(request.url)

    def open(self, lab: LabProcess) -> None:
        """Go to the address of a laboratory, and wait until its page takes files."""
        self.tab.goto(lab.address, wait_until="commit")
        self.tab.get_by_test_id("bring").wait_for(state="attached")
        self.until("document.body.classList.contains('loaded')")

    def until(self, told: str, look_ms: int = _LOOK_MS) -> None:
        """Wait until an expression is true.

        The page's policy forbids the browser's own way to wait.
        """
        began = time.monotonic()
        while not self.tab.evaluate(told):
            if time.monotonic() > began + _PATIENCE_S:
                raise InputError(f"the page waited too long for {told}")
            self.tab.wait_for_timeout(look_ms)

    def until_steps(self, count: int) -> None:
        """Wait until the staircase has that many steps."""
        self.until(f"document.querySelectorAll('#staircase .step:not(.later)').length === {count}")

    def until_state(self, of_state: str) -> None:
        """Wait until something is true of the state ``s`` that the server tells."""
        self.until(
            f"fetch('/api/state', {{headers: {{Authorization: {_BEARER}}}}}).then(r => r.json())"
            f".then(s => Boolean({of_state}))",
            _ASK_MS,
        )

    def until_tried(self) -> None:
        """Wait until every candidate of the present step was tried."""
        self.until_state(
            "s.ranking && s.ranking.step === s.current && s.ranking.cards.length > 0 && "
            "s.ranking.cards.every(c => ['tried', 'failed', 'final'].includes(c.state))"
        )

    def until_ranked(self) -> None:
        """Wait until the ranking of the present step has ended."""
        self.until_state(
            "s.ranking && s.ranking.step === s.current && s.ranking.status === 'done' && !s.job"
        )

    def drop(self, files: Sequence[Path | dict[str, Any]]) -> None:
        """Give files to the page, as if they were dropped on it."""
        self.tab.get_by_test_id("files-input").set_input_files(list(files))

    def click(self, name: str) -> None:
        """Press what has that mark."""
        self.tab.get_by_test_id(name).click()

    def text(self, name: str) -> str:
        """Return what stands in what has that mark."""
        return str(self.tab.get_by_test_id(name).inner_text())

    @property
    def first_card(self) -> str:
        """The effect whose card stands first."""
        mark = self.tab.locator("#cards > li").first.get_attribute("data-testid")
        return str(mark).removeprefix("card-")

    def picture(self) -> bytes:
        """Return what is seen, as a PNG file."""
        return bytes(self.tab.screenshot())
