"""What a page quotes from files of results, and what it claims about them."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json
from rdpi_gym.support.words import joined

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
    """Whether a line of a template is a claim."""
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
