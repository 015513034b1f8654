"""Pages from templates: files are written, commands run, pictures drawn, numbers filled in."""

from __future__ import annotations

import operator
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json, write_atomic
from rdpi_gym.support.words import joined

TEMPLATES = {path.stem: path for path in sorted((Path(__file__).parent / "templates").glob("*.md"))}
"""Templates by the name of their page."""
ELISION = "..."
_PROGRAMS = {
    "rdpi": [sys.executable, "-m", "rdpi_gym"],
    "python": [sys.executable],
    "head": ["head"],
}
_FEWEST_ELIDED = 4
_RECORD = re.compile(r"  \S.* \(\w+\): \d+ samples")


class Session:
    """A folder in which commands run one after the other."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._listed: list[list[str]] = []

    def run(self, command: str) -> list[str]:
        """Run a command and return the lines that it prints.

        The list of the records, which most outputs have, is printed once; after that an ellipsis
        stands for it.
        """
        program, *words = shlex.split(command)
        if program not in _PROGRAMS:
            raise InputError(f"{command!r}: a page runs {', '.join(_PROGRAMS)} and nothing else")
        # a page in text has a width of its own; what the user's terminal is set to does not matter
        environment = {**os.environ, "COLUMNS": "110", "NO_COLOR": "1", "PYTHONPATH": _checkout()}
        done = subprocess.run(
            [*_PROGRAMS[program], *words],
            cwd=self.folder, env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode != 0:
            said = done.stderr.strip().splitlines()[-1:] or [f"status {done.returncode}"]
            raise InputError(f"{command}: {said[0]}")
        lines = [line.rstrip() for line in done.stdout.rstrip().splitlines()]
        # of several empty lines one is enough
        lines = [line for k, line in enumerate(lines) if line or (k and lines[k - 1])]
        place = _list_of_records(lines)
        listed = lines[place]
        if len(listed) >= _FEWEST_ELIDED and listed in self._listed:
            return [*lines[: place.start], ELISION, *lines[place.stop :]]
        self._listed.append(listed)
        return lines


def _checkout() -> str:
    """Python's path, with the checkout first: modules are imported from the session's folder too."""
    return os.pathsep.join(
        [str(Path(__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
    )


def _list_of_records(lines: Sequence[str]) -> slice:
    """Find the title of a data set and the indented lines about its records."""
    for k, line in enumerate(lines[1:]):
        if _RECORD.match(line):
            return slice(k, k + 1 + len([*takewhile(_is_indented, lines[k + 1 :])]))
    return slice(0, 0)


def _is_indented(line: str) -> bool:
    return line.startswith("  ")


_QUOTE = re.compile(r"\{\{(?P<file>[^:{}]+):(?P<key>[^:{}]+)(?::(?P<form>[^:{}]*))?\}\}")
_CLAIM = re.compile(r"<!-- claim: (?P<file>[^:]+):(?P<key>\S+) (?P<sign>[=<>~!]) (?P<value>.+) -->")
_SIGNS: dict[str, Callable[[Any, Any], bool]] = {
    "=": operator.eq,
    "<": operator.lt,
    ">": operator.gt,
    "~": operator.contains,
    "!": lambda found, wanted: wanted not in found,
}
_FORMATS = {
    "compare.json": "rdpi-compare",
    "model.json": "rdpi-plant",
    "discovery.json": "rdpi-discovery",
    "diagnosis.json": "rdpi-diagnosis",
    "add.json": "rdpi-add",
    "truth.json": "rdpi-truth",
}


def look_up(work: Path, file: str, key: str) -> Any:
    """Return a value of a file of results."""
    path = work / file
    value: Any = read_json(path, _FORMATS.get(path.name, path.stem), 1)
    try:
        return _member(value, key.split("."))
    except (KeyError, IndexError, TypeError, ValueError):
        raise InputError(f"{file} has no {key}; the template quotes it") from None


def _member(value: Any, keys: list[str]) -> Any:
    if not keys:
        return value
    first, rest = keys[0], keys[1:]
    if first == "*":
        return [_member(each, rest) for each in value]
    return _member(value[int(first)] if isinstance(value, list) else value[first], rest)


def quoted(line: str, work: Path) -> str:
    """Fill the numbers and names of a line of prose in: ``{{file:key:format}}``.

    A list of names is joined in words.
    """

    def fill(match: re.Match[str]) -> str:
        value = look_up(work, match["file"], match["key"])
        if isinstance(value, list):
            return joined(value)
        return format(value, match["form"] or "")

    return _QUOTE.sub(fill, line)


def is_claim(line: str) -> bool:
    """True if a line of a template is a claim."""
    return line.startswith("<!-- claim:")


def contradiction(line: str, work: Path) -> str | None:
    """Hold a claim of the prose against the results, and say where they contradict it."""
    match = _CLAIM.fullmatch(line)
    if match is None:
        raise InputError(f"{line!r} cannot be read; write <!-- claim: FILE:KEY = VALUE -->")
    found = look_up(work, match["file"], match["key"])
    if isinstance(found, list):
        found = ", ".join(map(str, found))
    wanted = float(match["value"]) if isinstance(found, int | float) else match["value"]
    if _SIGNS[match["sign"]](found, wanted):
        return None
    return f"{match['file']}: {match['key']} is {found}, the prose says {match['sign']} {wanted}"


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
