"""A page of results as text, the data of its figures unpacked."""

import gzip
import re
from base64 import b64decode
from pathlib import Path

_DATA = re.compile(r'(?<=type="text/plain" id=")(f\d+-data">)([^<]*)')


def figures(page: str) -> list[str]:
    """Return the JSON of each figure of a page."""
    return [gzip.decompress(b64decode(packed)).decode() for _, packed in _DATA.findall(page)]


def read_page(path: Path) -> str:
    """Return a page with its figures in JSON."""
    text = path.read_text(encoding="utf-8")
    shown = iter(figures(text))
    return _DATA.sub(lambda found: f"{found[1]}{next(shown)}", text)


def words_of(page: str) -> list[str]:
    """Return the words of a page that a reader meets once everything is unfolded; marks are none."""
    shown = re.sub(r"<(script|style)\b.*?</\1>", "", page, flags=re.DOTALL)
    return [each for each in re.sub(r"<[^>]+>", " ", shown).split() if re.search(r"\w", each)]
