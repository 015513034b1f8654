"""Ten pictures of work in the laboratory, for its page in the docs: `python -m studies.lab_pictures`.

The laboratory is started as a user starts it, its page is opened in a browser of 1280 by 720 points,
and what is pressed is what a user presses: an exercise with two hidden effects, and the measured
records of a PICMA stack.
"""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rdpi_gym.support.command import Options
from rdpi_gym.support.files import write_atomic
from studies.chromium import LabPage, LabProcess, chromium, screen_png

OUT = Path(__file__).parents[1] / "docs" / "lab"
EXERCISE, RECORD, MEASURED = "loops-open", "sine-50hz", "picma"
_SETTLE_MS = 900  # plots that were just told something


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the pictures."""
    return Options("lab_pictures", __doc__, out=OUT).run(arguments, _run)


def _run(asked: Namespace) -> None:
    with (
        chromium() as browser,
        tempfile.TemporaryDirectory(prefix="rdpi-lab-") as scratch,
    ):
        _exercise(browser, Path(scratch) / "exercise", asked.out)
        _measured(browser, Path(scratch) / "measured", asked.out)


def _exercise(browser: Any, session: Path, out: Path) -> None:
    with LabProcess(session) as lab, LabPage(browser) as page:
        page.open(lab)
        page.tab.get_by_test_id(f"example-{EXERCISE}").wait_for()
        _keep(page, out / "1-bring.png")
        page.click(f"example-{EXERCISE}")
        page.until_steps(1)
        page.until("document.querySelectorAll('#cards > li').length > 2")
        _keep(page, out / "2-cards-arrive.png")
        page.until_ranked()
        page.click(f"record-{RECORD}")
        _brush(page, 0.3, 0.45)
        _keep(page, out / "3-brush.png")
        page.click("clear-brush")
        page.tab.get_by_test_id(f"card-{page.first_card}").hover()
        _keep(page, out / "4-ranked.png")
        for count in (2, 3):
            page.click(f"add-{page.first_card}")
            page.until_steps(count)
            if count == 2:
                _keep(page, out / "5-one-added.png")
                page.until_tried()
        page.until_ranked()
        _keep(page, out / "6-the-noise.png")
        page.click("kind-triangle")
        page.click("simulate")
        page.until_state("s.payoff")
        page.tab.get_by_test_id("payoff-result").scroll_into_view_if_needed()
        _keep(page, out / "8-what-it-buys.png")
        page.tab.mouse.wheel(0, -5000)
        _hold(page)
        _keep(page, out / "7-a-parameter.png")


def _measured(browser: Any, session: Path, out: Path) -> None:
    with LabProcess(session) as lab, LabPage(browser, dark=True) as page:
        page.open(lab)
        page.click(f"example-{MEASURED}")
        page.until_steps(1)
        page.until_ranked()
        _keep(page, out / "9-measured.png")
        page.tab.get_by_test_id("left").scroll_into_view_if_needed()
        page.tab.mouse.wheel(0, 2000)
        _keep(page, out / "10-what-is-left.png")


def _brush(page: LabPage, first: float, last: float) -> None:
    box = page.tab.get_by_test_id("trace").bounding_box()
    left, width = box["x"] + 46, box["width"] - 56
    middle = box["y"] + 0.5 * box["height"]
    page.tab.mouse.move(left + first * width, middle)
    page.tab.mouse.down()
    page.tab.mouse.move(left + last * width, middle, steps=4)
    page.tab.mouse.up()
    page.tab.mouse.move(640, 20)  # what is pointed at would say its numbers over the picture


def _hold(page: LabPage) -> None:
    """Take the first slider with the mouse, and move it a little."""
    slider = page.tab.locator("input[type=range]:visible").first
    box, place = slider.bounding_box(), slider.evaluate("s => s.value / s.max")
    middle = box["y"] + 0.5 * box["height"]
    at = box["x"] + 8 + place * (box["width"] - 16)
    page.tab.mouse.move(at, middle)
    page.tab.mouse.down()
    page.tab.mouse.move(at + 6, middle, steps=3)


def _keep(page: LabPage, path: Path) -> None:
    page.tab.wait_for_timeout(_SETTLE_MS)
    print(write_atomic(path, screen_png(page.picture())), flush=True)


if __name__ == "__main__":
    sys.exit(main())
