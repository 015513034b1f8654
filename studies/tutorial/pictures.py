"""Figures of a page of results as pictures, drawn by the browser that a reader would use."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rdpi_gym.support.errors import InputError
from studies.chromium import chromium
from studies.png import small_png

WIDTH_PX = 980
_TIMEOUT_MS = 60_000

# The figure of a section; of several, the one with that number or under that name.
_DRAW = """([section, choice, width]) => {
  const sections = [...document.querySelectorAll("section")];
  const found = sections.find((each) => each.querySelector("h2").textContent === section);
  if (!found) return "no section";
  const option = [...found.querySelectorAll("option")].find((o) => o.textContent === choice);
  const boxes = found.querySelectorAll(".figure");
  const box = option ? document.getElementById(option.value) : boxes[(Number(choice) || 1) - 1];
  if (!box || (choice && !option && !Number(choice))) return "no figure";
  const figure = JSON.parse(document.getElementById(box.dataset.figure).textContent);
  // what a picture cannot do: buttons
  const layout = {...figure.layout, updatemenus: []};
  return Plotly.toImage({data: figure.data, layout: layout},
                        {format: "png", width: width, height: figure.layout.height});
}"""


class Browser:
    """A browser that is open."""

    def __init__(self, chromium: Any) -> None:
        self._chromium = chromium

    def picture(self, page: Path, section: str, choice: str = "") -> bytes:
        """Return one figure of a page as a PNG file."""
        if not page.is_file():
            raise InputError(f"{page} is missing; the template takes a picture from it")
        tab = self._chromium.new_page()
        try:
            tab.set_default_timeout(_TIMEOUT_MS)
            tab.goto(page.resolve().as_uri())
            drawn = str(tab.evaluate(_DRAW, [section, choice, WIDTH_PX]))
        finally:
            tab.close()
        head, comma, data = drawn.partition(",")
        if not comma:
            raise InputError(f"{page} has {head} {section!r} {choice!r}; the template draws it")
        return small_png(base64.b64decode(data))


@contextmanager
def browser() -> Iterator[Browser]:
    """Open Chromium, without a window."""
    with chromium() as found:
        yield Browser(found)
