"""Command line of the effects' pages."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

import studies.effect_pages
from rdpi_gym.support.command_line import Options
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.progress import progress_bar
from studies.effect_pages.panels import panels_of
from studies.effect_pages.picture import effect_picture
from studies.effect_pages.study import PICTURES, bare_records, study_effect
from studies.effect_pages.text import page_texts
from studies.effect_pages.tracking import TABLE, tracking_table
from studies.png import small_png

OUT = Path(__file__).parents[2] / "docs" / "effects"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the pages and their pictures."""
    options = Options("effect_pages", studies.effect_pages.__doc__, out=OUT)
    options.add_argument(
        "--text-only",
        action="store_true",
        help="pages alone, from the committed table of tracking errors",
    )
    return options.run(arguments, _run)


def _run(options: Namespace) -> None:
    if not options.text_only:
        write_atomic(TABLE, tracking_table().to_csv(index=False, float_format="%.6g"))
    for name, text in page_texts().items():
        write_atomic(options.out / name, text)
    if options.text_only:
        return
    without = bare_records()
    with progress_bar() as show:
        for number, (name, picture) in enumerate(PICTURES.items()):
            show("drawing", number, len(PICTURES))
            panels = panels_of(picture, study_effect(name, picture.values, without))
            write_atomic(options.out / f"{name}.png", small_png(effect_picture(panels)))
    print(f"{len(PICTURES)} effects: {options.out}")


if __name__ == "__main__":
    sys.exit(main())
