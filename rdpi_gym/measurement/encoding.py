"""Bytes of a text file to lines: UTF-8, or UTF-16 with its byte-order mark, nothing guessed."""

from __future__ import annotations

import codecs
from pathlib import Path

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import open_regular, read_bytes

LARGEST_TEXT = 2**30
"""Most bytes of a text file that is read: some ten million samples."""
_MARKS = (
    (codecs.BOM_UTF8, "UTF-8"),
    (codecs.BOM_UTF16_LE, "UTF-16-LE"),
    (codecs.BOM_UTF16_BE, "UTF-16-BE"),
)


def read_lines(path: Path, largest: int = LARGEST_TEXT) -> list[str]:
    r"""Read the lines of a text file, whatever ends them (``\n``, ``\r\n`` or ``\r``)."""
    return _lines(_text(path, read_bytes(path, largest), True))


def read_head(path: Path, most: int) -> list[str]:
    r"""Read the first whole lines of a text file, as :func:`read_lines` does."""
    with open_regular(path) as stream:
        raw = stream.read(most + 1)
    is_whole = len(raw) <= most
    lines = _lines(_text(path, raw[:most], is_whole))
    return lines if is_whole else lines[:-1] or lines


def _text(path: Path, raw: bytes, is_whole: bool) -> str:
    mark, encoding = next((pair for pair in _MARKS if raw.startswith(pair[0])), (b"", "UTF-8"))
    try:
        text = codecs.getincrementaldecoder(encoding)().decode(raw[len(mark) :], is_whole)
    except UnicodeDecodeError as error:
        before = error.object[: error.start].decode(encoding)
        raise InputError(
            f"{path}, {_place(before)} (byte {len(mark) + error.start}): "
            f"not {encoding} text; save the file as UTF-8"
        ) from None
    if "\0" in text:
        raise InputError(
            f"{path}, {_place(text[: text.index(chr(0))])}: a NUL character, so this is no UTF-8 "
            "text; save the file as UTF-8, or as UTF-16 with its byte-order mark"
        )
    return text


def _lines(text: str) -> list[str]:
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _place(text_before: str) -> str:
    lines = _lines(text_before)
    return f"line {len(lines)}, column {len(lines[-1]) + 1}"
