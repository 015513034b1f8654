"""The constant arrays of generated code, named after what holds them in Python."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.firmware.program import Table

# How deep attributes of attributes are looked through for names.
_DEEPEST = 6
ROOMS = ("baselines", "rdpi_gym")
# Words that cannot name a field of a struct, in C or where C++ reads the header.
_WORDS = frozenset(
    {
        "and",
        "auto",
        "bool",
        "break",
        "case",
        "catch",
        "char",
        "class",
        "const",
        "continue",
        "default",
        "delete",
        "do",
        "double",
        "else",
        "enum",
        "explicit",
        "export",
        "extern",
        "false",
        "float",
        "for",
        "friend",
        "goto",
        "if",
        "inline",
        "int",
        "long",
        "mutable",
        "namespace",
        "new",
        "not",
        "operator",
        "or",
        "private",
        "protected",
        "public",
        "register",
        "restrict",
        "return",
        "short",
        "signed",
        "sizeof",
        "static",
        "struct",
        "switch",
        "template",
        "this",
        "throw",
        "true",
        "try",
        "typedef",
        "typename",
        "union",
        "unsigned",
        "using",
        "virtual",
        "void",
        "volatile",
        "while",
        "xor",
    }
)


class Tables:
    """Constant arrays, each once.

    Parameters
    ----------
    names
        Arrays that have a name, with it.

    Examples
    --------
    >>> tables = Tables([("_rest_V", np.array([1.0, 2.0]))])
    >>> tables.named(np.array([[1.0], [2.0]])), tables.named(np.array([3.0]))
    ('rest_v', 'table_1')
    >>> [table.values.tolist() for table in tables.all]
    [[1.0, 2.0], [3.0]]
    """

    def __init__(self, names: Sequence[tuple[str, NDArray[Any]]] = ()) -> None:
        self._wanted: dict[bytes, str] = {}
        for name, array in names:
            self._wanted.setdefault(_content(array), name)
        self._found: dict[bytes, Table] = {}

    @property
    def all(self) -> list[Table]:
        """Those that were asked for, in that order."""
        return list(self._found.values())

    def named(self, array: NDArray[Any]) -> str:
        """Return the name of the table of an array's numbers, row by row."""
        content = _content(array)
        if content not in self._found:
            name = _identifier(self._wanted.get(content, ""))
            taken = {table.name for table in self._found.values()}
            if not name:
                name = f"table_{len(self._found)}"
            while name in taken:
                name += f"_{len(self._found)}"
            values = np.ascontiguousarray(array, dtype=np.float64).ravel()
            self._found[content] = Table(name, values.copy())
        return self._found[content].name


def _content(array: NDArray[Any]) -> bytes:
    return np.ascontiguousarray(array, dtype=np.float64).tobytes()


def _identifier(name: str) -> str:
    plain = re.sub(r"\W", "_", name.strip("_").lower(), flags=re.ASCII)
    return plain if re.fullmatch(r"[a-z]\w*", plain) and plain not in _WORDS else ""


def attributes(root: object) -> Iterator[tuple[object, str, Any]]:
    """Yield what an object of this package holds and what that holds: holder, name, value."""
    seen: set[int] = set()
    level: list[object] = [root]
    for _ in range(_DEEPEST):
        below: list[object] = []
        for holder in level:
            if id(holder) in seen:
                continue
            seen.add(id(holder))
            if isinstance(holder, Mapping):
                below += holder.values()
            elif isinstance(holder, (list, tuple)):
                below += holder
            elif type(holder).__module__.split(".")[0] in ROOMS and hasattr(holder, "__dict__"):
                for name, value in list(vars(holder).items()):
                    yield holder, name, value
                    below.append(value)
        level = below


def named_arrays(root: object) -> list[tuple[str, NDArray[Any]]]:
    """Return the arrays that an object holds, with the names of what holds them.

    Of its attributes, of tuples among these, and of the modules of the classes that it is made of.
    """
    found: list[tuple[str, Any]] = []
    kinds: dict[type, None] = dict.fromkeys(type(root).__mro__)
    for holder, name, value in attributes(root):
        kinds |= dict.fromkeys(type(holder).__mro__)
        found.append((name, value))
        if isinstance(value, tuple):
            found += [(f"{name}_{i}", each) for i, each in enumerate(value)]
    for module in dict.fromkeys(kind.__module__ for kind in kinds):
        if module.split(".")[0] in ROOMS:
            found += vars(sys.modules[module]).items()
    return [
        (name, value)
        for name, value in found
        if isinstance(value, np.ndarray) and value.size > 1 and value.dtype.kind in "fiub"
    ]
