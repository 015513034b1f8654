"""Command line of the pages that walk through the laboratory."""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

import studies.tutorial
from rdpi_gym.measurement import example_folder
from rdpi_gym.support.command_line import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from studies.tutorial.pictures import browser
from studies.tutorial.session import Session
from studies.tutorial.template import fill

OUT = Path(__file__).parents[2] / "docs"
TEMPLATES = {path.stem: path for path in sorted(Path(__file__).parent.glob("*.md"))}
"""Templates by the name of their page."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the pages."""
    options = Options("tutorial", studies.tutorial.__doc__, out=OUT)
    options.add_argument("pages", nargs="*", help="names of pages; all by default")
    return options.run(arguments, _run)


def _run(options: Namespace) -> None:
    for name in options.pages or TEMPLATES:
        if name not in TEMPLATES:
            raise InputError(f"no page is named {name!r}; known are {', '.join(TEMPLATES)}")
        print(make_page(name, options.out))


def make_page(name: str, out: Path) -> Path:
    """Make one page and its pictures."""
    with tempfile.TemporaryDirectory() as folder, browser() as chromium:
        session = Session(Path(folder), {"PICMA": example_folder("picma")})
        page, pictures = fill(
            TEMPLATES[name].read_text(encoding="utf-8"), session, chromium.picture
        )
    for path, picture in pictures.items():
        write_atomic(out / path, picture)
    return write_atomic(out / f"{name}.md", page)


if __name__ == "__main__":
    sys.exit(main())
