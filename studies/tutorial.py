"""The pages that walk through the laboratory, made by running the commands that they show.

A template holds prose, commands and the names of pictures. `python -m studies.tutorial` runs the
commands in an empty folder, puts what they print below them, takes the pictures from the pages that
they write (in Chromium), fills the numbers of the prose in, and refuses where a result contradicts a
claim of the prose. Nothing is written by hand.
"""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from functools import partial
from pathlib import Path

from rdpi_gym.support.command import Options
from studies.chromium import chromium, figure_png
from studies.pages import TEMPLATES, Session, fill
from studies.runner import Files, Study, names_of

OUT = Path(__file__).parents[1] / "docs"
PAGES = ("own-effect", "tutorial")


def _files(options: Namespace) -> Files:
    files: dict[str, str | bytes] = {}
    for name in names_of("page", options.pages, PAGES):
        files |= make_page(name)
    return files


def make_page(name: str) -> dict[str, str | bytes]:
    """Return a page and its pictures by their paths."""
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        session = Session(Path(folder))
        template = TEMPLATES[name].read_text(encoding="utf-8")
        page, pictures = fill(template, session, partial(figure_png, browser))
    return {**pictures, f"{name}.md": page}


def _more(options: Options) -> None:
    options.add_argument("pages", nargs="*", help="names of pages; all by default")


main = Study("tutorial", __doc__, _files, OUT, more=_more)

if __name__ == "__main__":
    sys.exit(main())
