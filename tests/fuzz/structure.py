"""Attacks on the structure of a document: each of its integers, types, keys and headers in turn.

A `Document` is a valid file as a tree of JSON types, with what writes the tree as bytes, and with
the integers that stand in the bytes. A place of it, and one of the values that the place may hold
instead, make an attack. All attacks of the documents of a reader have a number: case K of seed S is
one of them, each at most once, and beyond the last two at a time.
"""

from __future__ import annotations

import math
import struct
import zipfile
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from itertools import accumulate
from random import Random
from typing import Any

INTEGERS = (-1, 0, 1, 10**9, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63)
TYPES: tuple[Any, ...] = (None, True, 0.5, "a", [], {})
DTYPES: tuple[Any, ...] = (
    "|S5", "<M8[s]", "<m8[ns]", "<c16", "|O", "<U7", "|V8", "|b1", ">f8", "<f2", "<i8", "<u8", "<U0", "|V0",
    "<f8,<f8", [("a", "<f8")], [("a", "|O")], [("a", [("b", "<f8", (2**20, 2**20))])], "(2,)<f8",
    "|V2000000000", "<U500000000", "|S2147483647", "<f8, ", "f" * 1000, "__import__('os')",
)  # fmt: skip
REMOVED = object()
RIGHT = -3
"""In a header: the number that is right, worked out when the file is written."""
Tree = Any
Word = tuple[int, int]
"""Where an integer begins in a file, and how many bytes it has."""
Files = Mapping[str, bytes]


@dataclass(frozen=True)
class Document:
    """A valid file, and how it is made."""

    tree: Tree  # its content, of JSON types; None: bytes alone
    build: Callable[[Tree], bytes]
    files: Callable[[Tree, bytes], Files]  # of the tree and its bytes, the words replaced
    words: Callable[[bytes], Sequence[Word]] = lambda content: ()  # integers of the headers
    is_text: bool = False

    @cached_property
    def places(self) -> list[tuple[Any, Sequence[Any]]]:
        """Places, each with what may stand there instead: a path in the tree, or a word."""
        found: list[tuple[Any, Sequence[Any]]] = list(_tree_places(self.tree, ()))
        words = self.words(self.build(deepcopy(self.tree)))
        found += [((k, word[1]), _fitting(word[1])) for k, word in enumerate(words)]
        return found

    def attacked(self, changes: Sequence[tuple[Any, Any]]) -> Files:
        """Write the files with what stands at some places replaced."""
        tree = deepcopy(self.tree)
        for path, value in changes:
            if path[:1] == ("tree",):
                tree = _replaced(tree, path[1:], value)
        content = bytearray(self.build(tree))
        words = [(path, value) for path, value in changes if path[:1] != ("tree",)]
        places = self.words(bytes(content)) if words else ()
        for (number, size), value in words:
            if number < len(places):  # else another change took it out
                at = places[number][0]
                content[at : at + size] = (value % 2 ** (8 * size)).to_bytes(size, "little")
        return self.files(tree, bytes(content))


def shuffled(seed: int, count: int, number: int) -> int:
    """Return one of so many numbers, each once in an order that a seed decides."""
    rng = Random(f"order/{seed}")
    step = rng.randrange(1, count + 1)
    while math.gcd(step, count) > 1:
        step += 1
    return (rng.randrange(count) + step * number) % count


class Attacks:
    """All attacks on the documents of a reader."""

    def __init__(self, documents: Sequence[Document]) -> None:
        self.documents = documents
        self._places = [
            (k, place, values) for k, each in enumerate(documents) for place, values in each.places
        ]
        self._ends = list(accumulate(len(values) for _, _, values in self._places))

    def __len__(self) -> int:
        return self._ends[-1]

    def case(self, seed: int, number: int) -> Files:
        """Write the files of a case: the documents as they are, then each attack once, then pairs."""
        if number < len(self.documents):
            return self.documents[number].attacked(())
        number -= len(self.documents)
        count = len(self)
        if number < count:
            which, place, value = self._attack(shuffled(seed, count, number))
            return self.documents[which].attacked([(place, value)])
        rng = Random(f"pairs/{seed}/{number}")
        which, place, value = self._attack(rng.randrange(count))
        others = self.documents[which].places
        other, values = rng.choice(others)
        return self.documents[which].attacked([(place, value), (other, rng.choice(values))])

    def _attack(self, number: int) -> tuple[int, Any, Any]:
        at = bisect_right(self._ends, number)
        which, place, values = self._places[at]
        return which, place, values[number - self._ends[at]]


def _fitting(size: int) -> list[int]:
    """Integers that differ in so many bytes."""
    return list({value % 2 ** (8 * size): value for value in INTEGERS}.values())


def _tree_places(value: Any, path: tuple[Any, ...]) -> Iterator[tuple[Any, Sequence[Any]]]:
    if path:
        other = [each for each in TYPES if type(each) is not type(value)]
        key = path[-1]
        if key == "descr":
            other += DTYPES
        elif type(value) in (int, float):
            other += INTEGERS
        elif isinstance(value, str) and value.lstrip("-").isdigit():
            other += map(str, INTEGERS)
        yield ("tree", *path), (REMOVED, *other, [value])
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _tree_places(inner, (*path, key))
        yield ("tree", *path, "unknown"), (1,)
    elif isinstance(value, list):
        # of a long list of numbers the ends stand for all
        shown = range(len(value)) if len(value) <= 4 else (0, len(value) - 1)
        for k in shown:
            yield from _tree_places(value[k], (*path, k))


def _replaced(tree: Tree, path: Sequence[Any], value: Any) -> Tree:
    """Replace what stands at a path, unless another change took it out."""
    parent = tree
    try:
        for key in path[:-1]:
            parent = parent[key]
        if value is REMOVED:
            del parent[path[-1]]
        else:
            parent[path[-1]] = deepcopy(value)
    except (KeyError, IndexError, TypeError):
        pass
    return tree


# NumPy's arrays, and archives


def header_of(array: Any) -> dict[str, Any]:
    """Return the header of an array as a tree."""
    own = {"descr": array.dtype.str, "shape": list(array.shape)}
    return {**own, "fortran_order": False, "version": [1, 0], "length": RIGHT}


def npy(header: Any, content: bytes) -> bytes:
    """Write an array of which the header says what it says."""
    said = header if isinstance(header, dict) else {"descr": header, "shape": [RIGHT]}
    shape = said.get("shape")
    if isinstance(shape, list):
        sides = [len(content) if side == RIGHT else side for side in shape]
        shape = "(" + "".join(f"{side!r}, " for side in sides) + ")"
    items = {key: repr(said[key]) for key in ("descr", "fortran_order", "unknown") if key in said}
    items |= {"shape": str(shape)} if "shape" in said else {}
    text = "{" + ", ".join(f"{key!r}: {value}" for key, value in sorted(items.items())) + ", }"
    raw = text.encode(errors="replace")
    raw += b" " * (-(len(raw) + 11) % 64) + b"\n"
    versions = said.get("version")
    major, minor = [
        v % 256 if isinstance(v, int) else 1
        for v in (versions if isinstance(versions, list) and len(versions) == 2 else (1, 0))
    ]
    length = said.get("length", RIGHT)
    size = length if type(length) is int and length != RIGHT else len(raw)
    form = "<H" if major == 1 else "<I"
    stated = struct.pack(form, size % 2 ** (8 * struct.calcsize(form)))
    return b"\x93NUMPY" + bytes([major, minor]) + stated + raw + content


def archive(members: Mapping[str, bytes], method: int = zipfile.ZIP_STORED) -> bytes:
    """Write an archive without the time of day."""
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w", method) as made:
        for name, content in members.items():
            made.writestr(zipfile.ZipInfo(name), content, compress_type=method)
    return stream.getvalue()


def packed_archive(members: Mapping[str, tuple[bytes, int]]) -> bytes:
    """Write an archive of members that are deflated already, their check sums left out."""
    body, index = b"", b""
    for name, (packed, size) in members.items():
        said = struct.pack("<HHHHHIIIHH", 20, 0, 8, 0, 0, 0, len(packed), size, len(name), 0)
        at = struct.pack("<HHHII", 0, 0, 0, 0, len(body))
        index += b"PK\1\2" + struct.pack("<H", 20) + said + at + name.encode()
        body += b"PK\3\4" + said + name.encode() + packed
    count = len(members)
    end = struct.pack("<HHHHIIH", 0, 0, count, count, len(index), len(body), 0)
    return body + index + b"PK\5\6" + end


_LOCAL = (4, 6, 8, (14, 4), (18, 4), (22, 4), 26, 28)
_CENTRAL = (4, 6, 8, 10, (16, 4), (20, 4), (24, 4), 28, 30, 32, 34, (38, 4), (42, 4))
_END = (4, 6, 8, 10, (12, 4), (16, 4), 20)


def zip_words(content: bytes) -> list[Word]:
    """Find the integers of the headers of an archive."""
    end = content.rindex(b"PK\5\6")
    count, _, at = struct.unpack_from("<HII", content, end + 10)
    found = _of_record(end, _END)
    for _ in range(count):
        found += _of_record(at, _CENTRAL)
        found += _of_record(struct.unpack_from("<I", content, at + 42)[0], _LOCAL)
        at += 46 + sum(struct.unpack_from("<HHH", content, at + 28))
    return found


def _of_record(start: int, fields: Sequence[int | Word]) -> list[Word]:
    pairs = [field if isinstance(field, tuple) else (field, 2) for field in fields]
    return [(start + at, size) for at, size in pairs]


def binary_words(
    content: bytes, data: Sequence[bytes], first: int = 0, sizes: Sequence[int] = ()
) -> list[Word]:
    """Find the words of a binary file: all that are aligned, and others that hold one of some sizes.

    Headers begin at `first`; the numbers `data` are none.
    """
    taken = bytearray(len(content))
    for each in data:
        at = content.find(each)
        while at >= 0:
            taken[at : at + len(each)] = b"\1" * len(each)
            at = content.find(each, at + len(each))
    found = []
    for at in range(first, len(content) - 3):
        if any(taken[at : at + 4]):
            continue
        if at % 4 == 0:
            # what is empty far and wide is read by nobody
            if any(content[max(0, at - 16) : at + 24]):
                found.append((at, 4))
                if at % 8 == 0 and at + 8 <= len(content):
                    found.append((at, 8))
        elif int.from_bytes(content[at : at + 4], "little") in sizes:
            found.append((at, 4))
    return found
