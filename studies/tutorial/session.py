"""Commands as a reader types them: run in a folder, with what they print."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from itertools import takewhile
from pathlib import Path

from rdpi_gym.support.errors import InputError

ELISION = "..."
_PROGRAMS = {
    "rdpi": [sys.executable, "-m", "rdpi_gym"],
    "python": [sys.executable],
    "head": ["head"],
}
_FEWEST_ELIDED = 4
_RECORD = re.compile(r"  \S.* \(\w+\): \d+ samples")


class Session:
    """A folder in which commands run one after the other.

    Parameters
    ----------
    folder
        The folder.
    variables
        What stands for a ``$NAME`` in a command; printed paths that begin with it show the name.
    """

    def __init__(self, folder: Path, variables: Mapping[str, Path]) -> None:
        self.folder = folder
        self._variables = variables
        self._listed: list[list[str]] = []

    def run(self, command: str) -> list[str]:
        """Run a command and return the lines that it prints.

        The list of the records, which most outputs have, is printed once; after that an ellipsis
        stands for it.
        """
        program, *words = shlex.split(command)
        if program not in _PROGRAMS:
            raise InputError(f"{command!r}: a page runs {', '.join(_PROGRAMS)} and nothing else")
        for name, path in self._variables.items():
            words = [word.replace(f"${name}", str(path)) for word in words]
        # a page in text has a width of its own; what the user's terminal is set to does not matter
        environment = {**os.environ, "COLUMNS": "110", "NO_COLOR": "1", "PYTHONPATH": _checkout()}
        done = subprocess.run(
            [*_PROGRAMS[program], *words],
            cwd=self.folder, env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode != 0:
            said = done.stderr.strip().splitlines()[-1:] or [f"status {done.returncode}"]
            raise InputError(f"{command}: {said[0]}")
        lines = [self._shown(line) for line in done.stdout.rstrip().splitlines()]
        # of several empty lines one is enough
        lines = [line for k, line in enumerate(lines) if line or (k and lines[k - 1])]
        place = _list_of_records(lines)
        listed = lines[place]
        if len(listed) >= _FEWEST_ELIDED and listed in self._listed:
            return [*lines[: place.start], ELISION, *lines[place.stop :]]
        self._listed.append(listed)
        return lines

    def _shown(self, line: str) -> str:
        for name, path in self._variables.items():
            line = line.replace(str(path), f"${name}")
        return line.rstrip()


def _checkout() -> str:
    """Python's path, with the checkout first: modules are imported from the session's folder too."""
    return os.pathsep.join(
        [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
    )


def _list_of_records(lines: Sequence[str]) -> slice:
    """Find the title of a data set and the indented lines about its records."""
    for k, line in enumerate(lines[1:]):
        if _RECORD.match(line):
            return slice(k, k + 1 + len([*takewhile(_is_indented, lines[k + 1 :])]))
    return slice(0, 0)


def _is_indented(line: str) -> bool:
    return line.startswith("  ")
