"""Ways in which a file goes wrong: by a fault, by a wrong program, and by intent."""

from __future__ import annotations

import os
import struct
from collections.abc import Sequence
from copy import deepcopy
from pathlib import Path
from random import Random
from typing import Any

from tests.fuzz.structure import Document, Files

DEEP = 5_000
NUMBERS = (
    "nan", "inf", "-inf", "1e400", "-1e400", "1e308", "1e-400", "-0", "0", "1_000", "0x1F", "1,5",
    "１２", "1e", "--1", "+", ".", "1.2.3", "9" * 400, "9" * 5_000, "1e9", "-1", "1e15", "3.5",
)  # fmt: skip
TOKENS = (
    *NUMBERS, ",", ";", "\t", " ", "\n", "\r", "\r\n", '"', "'", "#", "%", "=", "[", "]", "{", "}",
    ":", "-", "&a ", "*a", "!!python/object/apply:os.system ", "\0", "\x1b[2J", "\x85", "\u2028",
    "\u202e", "\ufeff", "os:system", "a" * 300, "x." * 50, "[" * DEEP, "{" * DEEP, "\\", "\\u0000",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, False, -1, 0, 1, 2, 7, 2**31, 2**63, 10**30, 10**400, -0.0, 1e-300, 1e308, 0.5,
    float("nan"), float("inf"), "", "a", "a" * 3_000, "1.0", "\x1b[2J", "two\nlines", "\ud800",
    "os:system", "notes:open_me", "learned:x", "../x", [], {}, [[]], [1, "a"], [0.0] * 3_000, {"a": 1},
    {"effect": "creep"}, {"signal": "sum", "parts": []}, "creep", "P10",
)  # fmt: skip
WORDS = (0, 1, 2, 3, 7, 8, 9, 12, 14, 15, 40, 128, 2**16, 2**31 - 1, 2**31, 2**32 - 1)
LONG = "9" * 200_000


def text(rng: Random, content: str, times: int = 3) -> bytes:
    """Change a text in one to `times` places, and at times its encoding."""
    for _ in range(rng.randint(1, times)):
        at = rng.randrange(len(content) + 1)
        end = min(len(content), at + rng.choice((0, 0, 1, 1, 3, 20, 200)))
        what = rng.randrange(9)
        if what <= 2:
            content = content[:at] + rng.choice(TOKENS) + content[end:]
        elif what == 3:
            content = content[:at] + content[end:]
        elif what == 4:
            content = content[:end] + content[at:end] * rng.choice((1, 2, 30)) + content[end:]
        elif what == 5:
            content = content[:at]
        elif what == 6:
            lines = content.splitlines(keepends=True) or [""]
            i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
            lines[i], lines[j] = lines[j], lines[i]
            content = "".join(lines)
        elif what == 7:
            content = _number(rng, content)
        else:
            content = content[:at] + chr(rng.randrange(0x250)) + content[end:]
    if rng.random() < 0.01:
        at = rng.randrange(len(content) + 1)
        content = content[:at] + LONG + content[at:]
    encodings = ("utf-8",) * 40 + ("utf-16", "utf-16-be", "latin-1", "utf-8-sig", "utf-32")
    raw = content.encode(rng.choice(encodings), errors="replace")
    return binary(rng, raw, 1) if rng.random() < 0.1 else raw


def _number(rng: Random, content: str) -> str:
    """Replace one number of the text by another that is none, or too many."""
    digits = [i for i, c in enumerate(content) if c.isdigit()]
    if not digits:
        return content
    start = end = rng.choice(digits)
    while start > 0 and content[start - 1] in "0123456789.-+e":
        start -= 1
    while end < len(content) and content[end] in "0123456789.-+e":
        end += 1
    return content[:start] + rng.choice(NUMBERS) + content[end:]


def binary(rng: Random, raw: bytes, times: int = 3) -> bytes:
    """Change bytes in one to `times` places: bits, bytes, aligned numbers, pieces, the end."""
    content = bytearray(raw)
    for _ in range(rng.randint(1, times)):
        if not content:
            break
        at = rng.randrange(len(content))
        what = rng.randrange(8)
        if what == 0:
            content[at] ^= 1 << rng.randrange(8)
        elif what == 1:
            content[at] = rng.randrange(256)
        elif what <= 4:
            at, form = (at // 4 * 4, "<I") if what < 4 else (at // 8 * 8, "<Q")
            word = rng.choice((*WORDS, rng.getrandbits(8), rng.getrandbits(31)))
            if what == 4:
                word = rng.choice((word, 2**63, 2**64 - 1, rng.getrandbits(40)))
            content[at : at + struct.calcsize(form)] = struct.pack(form, word)
        elif what == 5:
            del content[at : at + rng.choice((1, 2, 4, 8, 100))]
        elif what == 6:
            piece = content[at : at + rng.choice((1, 4, 8, 64))]
            content[at:at] = piece * rng.choice((1, 1, 20))
        else:
            del content[at:]
    return bytes(content)


def document(rng: Random, value: Any, times: int = 3) -> Any:
    """Change a JSON value in one to `times` places: values, keys, what is missing or too much."""
    changed = deepcopy(value)
    for _ in range(rng.randint(1, times)):
        places = _places(changed)
        if not places:
            return _value(rng)
        parent, key = rng.choice(places)
        what = rng.randrange(8)
        if what <= 3:
            parent[key] = _value(rng)
        elif what == 4:
            parent[key] = _other(rng, parent[key])
        elif what == 5:
            del parent[key]
        elif what == 6 and isinstance(parent, dict):
            name = rng.choice(("name", "__class__", "self", "parts", "effect", "x" * 2_000, "\x1b"))
            parent[name] = _value(rng)
        else:
            parent[key] = [parent[key]] * rng.choice((1, 2, 40))
    return changed


def damaged(rng: Random, made: Document) -> Files:
    """Write a document whose tree, or whose bytes, are changed."""
    tree, changed = made.tree, made.tree is not None and rng.random() < 0.6
    if changed:
        tree = document(rng, tree)
    if not isinstance(tree, type(made.tree)):
        tree = type(made.tree)()  # all that it held is gone
    raw = made.build(deepcopy(tree))
    if made.is_text and rng.random() < 0.02:
        deep = rng.choice((40, 60, 900, 20_000))
        raw = raw.replace(b"null", b"[" * deep + b"]" * deep, 1)
    if not changed or rng.random() < 0.25:
        times = 2 if changed else 3
        raw = text(rng, raw.decode(), times) if made.is_text else binary(rng, raw, times)
    return made.files(tree, raw)


def special(rng: Random, paths: Sequence[Path]) -> None:
    """Put something in a file's place, at times, that is no file."""
    if rng.random() > 0.01:
        return
    path = rng.choice(paths)
    path.unlink()
    what = rng.randrange(5)
    if what == 0:
        os.mkfifo(path)
    elif what == 1:
        path.mkdir()
    else:
        path.symlink_to(("/dev/zero", "/dev/tty", "nowhere")[what - 2])


def nested(depth: int) -> list[Any]:
    """Make a list in a list, and so on."""
    found: list[Any] = []
    for _ in range(depth):
        found = [found]
    return found


def _value(rng: Random) -> Any:
    return deepcopy(rng.choice(VALUES))


def _other(rng: Random, value: Any) -> Any:
    if isinstance(value, float) or (type(value) is int and abs(value) < 2**63):
        return value * rng.choice((-1, 0, 2, 10, 0.5, 1e3, 1e-3, 1e12)) + rng.choice((0, 1, 1e-9))
    if isinstance(value, list):
        return [*reversed(value), _value(rng)]
    if isinstance(value, dict):
        return {**value, **{key: _value(rng) for key in list(value)[:2]}}
    return _value(rng)


def _places(value: Any) -> list[tuple[Any, Any]]:
    found: list[tuple[Any, Any]] = []
    left = [value]
    while left:
        item = left.pop()
        keys = list(item) if isinstance(item, dict) else range(len(item))
        for key in keys:
            found.append((item, key))
            if isinstance(item[key], dict | list):
                left.append(item[key])
    return found
