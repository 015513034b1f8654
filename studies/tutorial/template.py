"""From a template to a page: files are written, commands run, pictures drawn, numbers filled in."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from studies.tutorial.results import contradiction, is_claim, quoted
from studies.tutorial.session import Session

FENCE, CONSOLE, PROMPT = "```", "```console", "$ "
_FILE = re.compile(r"```\w+ (?P<name>\S+)")
_PICTURE = re.compile(
    r'!\[(?P<alt>[^\]]*)\]\((?P<path>\S+) "(?P<page>[^":]+): (?P<section>[^"/]+?)( / (?P<choice>[^"]+))?"\)'
)

Draw = Callable[[Path, str, str], bytes]
"""``draw(page, section, choice)``: a figure of a page of results as a PNG file."""


def fill(template: str, session: Session, draw: Draw) -> tuple[str, dict[str, bytes]]:
    """Make a page from its template.

    A block ``console`` holds commands behind a ``$``; what each prints is put below it. A block
    whose language is followed by a file name is written to that file. A picture whose title is
    ``PAGE: SECTION / FIGURE`` is drawn from that page of results. ``{{FILE:KEY:FORMAT}}`` is filled
    in from a file of results, and ``<!-- claim: FILE:KEY = VALUE -->`` must hold.
    """
    lines: list[str] = []
    wrong: list[str | None] = []
    pictures: dict[str, bytes] = {}
    for line, is_prose in _executed(template, session):
        if not is_prose:
            lines.append(line)
        elif is_claim(line):
            wrong.append(contradiction(line, session.folder))
        elif match := _PICTURE.fullmatch(line):
            page, section = session.folder / match["page"], match["section"]
            pictures[match["path"]] = draw(page, section, match["choice"] or "")
            lines.append(f"![{match['alt']}]({match['path']})")
        else:
            lines.append(quoted(line, session.folder))
    if any(wrong):
        raise InputError("; ".join(filter(None, wrong)))
    return "\n".join(lines) + "\n", pictures


def _executed(template: str, session: Session) -> list[tuple[str, bool]]:
    """Lines of the page once its blocks have run, and whether each is prose still to be filled in.

    All blocks run before any prose is read: it may quote what is computed further down.
    """
    lines: list[tuple[str, bool]] = []
    block: list[str] = []
    for line in template.splitlines():
        if block:
            block.append(line)
            if line == FENCE:
                lines += [(each, False) for each in _finished(block, session)]
                block = []
        elif line.startswith(FENCE):
            block = [line]
        else:
            lines.append((line, True))
    return lines


def _finished(block: list[str], session: Session) -> list[str]:
    if match := _FILE.fullmatch(block[0]):
        write_atomic(session.folder / match["name"], "\n".join(block[1:-1]) + "\n")
    if block[0] != CONSOLE:
        return block
    shown = [CONSOLE]
    for line in block[1:-1]:
        shown += [line, *session.run(line.removeprefix(PROMPT))]
    return [*shown, FENCE]
