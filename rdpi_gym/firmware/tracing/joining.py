"""Loops over the same elements joined to one, and arrays that live in one loop alone made numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from rdpi_gym.firmware.tracing.statements import (
    LOCAL,
    Fork,
    Item,
    Loop,
    Statement,
    lines,
    put,
    within,
)

_LOOP = re.compile(r"for \(int32_t i = 0; i < (\d+); \+\+i\) \{\n((?:    [^\n]*;\n)+)\}")
_SET = re.compile(r"    ([\w>.-]+)\[([^\]]+)\] = (.*);")
_ELEMENT = re.compile(r"([A-Za-z][\w>.-]*)\[([^\]]+)\]")
_ARRAY = re.compile(r"(rdpi_real|int32_t) (t\d+)\[\d+\];")
# Longest line that an expression is moved into.
_LINE = 110
_STEPS = re.compile(r"(?:(\d+) \+ )?i")


def joined(items: Sequence[Item]) -> tuple[Item, ...]:
    r"""Return the code with neighbouring loops joined where each element is made as it was."""
    uses: dict[str, int] = {}
    for line in lines(items):
        for name in LOCAL.findall(line):
            uses[name] = uses.get(name, 0) + 1
    return _joined(items, uses)


def _joined(items: Sequence[Item], uses: dict[str, int]) -> tuple[Item, ...]:
    found: list[Item] = []
    for item in items:
        now: Item = item
        if isinstance(now, Fork):
            then, otherwise = _joined(now.then, uses), _joined(now.otherwise, uses)
            now = replace(now, then=then, otherwise=otherwise)
        elif isinstance(now, Loop):
            now = replace(now, items=_joined(now.items, uses))
        else:
            # arrays are declared before the loops that come before them
            at = _last_that_is_no_declaration(found)
            before = found[at] if at is not None else None
            one = _join(before, now) if isinstance(before, Statement) else None
            if at is not None and one is not None:
                found[at : at + 1] = []
                now = one
        found.append(now)
    kinds = {
        said[2]: said[1]
        for item in found
        if isinstance(item, Statement) and (said := _ARRAY.fullmatch(item.text))
    }
    return _with_numbers(found, kinds, uses)


def _last_that_is_no_declaration(items: Sequence[Item]) -> int | None:
    for at in range(len(items) - 1, -1, -1):
        item = items[at]
        if not (isinstance(item, Statement) and _ARRAY.fullmatch(item.text)):
            return at
    return None


@dataclass(frozen=True)
class _Access:
    array: str
    index: str
    writes: bool


def _accesses(body: str) -> list[_Access] | None:
    """Return what elements lines read and write; None where a line is no assignment to an element."""
    found = []
    for line in body.splitlines():
        said = _SET.fullmatch(line)
        if said is None:
            return None
        found.append(_Access(said[1], said[2], True))
        found += [_Access(array, index, False) for array, index in _ELEMENT.findall(said[3])]
    return found


def _join(one: Statement, other: Statement) -> Statement | None:
    first, second = _LOOP.fullmatch(one.text), _LOOP.fullmatch(other.text)
    if first is None or second is None or first[1] != second[1]:
        return None
    before, after = _accesses(first[2]), _accesses(second[2])
    if before is None or after is None:
        return None
    if not all(_may_mix(x, y) for x in before for y in after):
        return None
    text = f"for (int32_t i = 0; i < {first[1]}; ++i) {{\n{first[2]}{second[2]}}}"
    return Statement(text, "", one.writes | other.writes, one.keeps or other.keeps)


def _may_mix(one: _Access, other: _Access) -> bool:
    """Whether two accesses keep their order where their loops run together, the first one first."""
    if one.array != other.array or not (one.writes or other.writes):
        return True
    x, y = _STEPS.fullmatch(one.index), _STEPS.fullmatch(other.index)
    if x is None or y is None:
        return one.index == other.index
    # an element that both touch has to come up in the first loop no later than in the second
    return int(x[1] or 0) >= int(y[1] or 0)


def _with_numbers(
    items: list[Item], kinds: dict[str, str], uses: dict[str, int]
) -> tuple[Item, ...]:
    """Make arrays that one loop alone reads and writes, an element at a time, numbers within it."""
    gone: set[str] = set()
    found: list[Item] = []
    for item in items:
        said = _LOOP.fullmatch(item.text) if isinstance(item, Statement) else None
        if said is None or not isinstance(item, Statement):
            found.append(item)
            continue
        body, own = said[2], set[str]()
        for name in sorted(set(LOCAL.findall(body)) & set(kinds)):
            element = _only_element(name, body)
            if element is None or uses[name] != 1 + len(re.findall(rf"\b{name}\b", body)):
                continue
            own.add(name)
            body = body.replace(f"    {element} = ", f"    {kinds[name]} {name} = ", 1)
            body = body.replace(element, name)
        gone |= own
        text = f"for (int32_t i = 0; i < {said[1]}; ++i) {{\n{_moved(body)}}}"
        found.append(Statement(text, "", item.writes - own, item.keeps))
    return tuple(
        item for item in found if not (isinstance(item, Statement) and item.declares in gone)
    )


def _only_element(name: str, body: str) -> str | None:
    """Return the one element of an array that lines set once and then read; None: more than that."""
    elements = set(re.findall(rf"\b{name}\[[^\]]+\]", body))
    sets = [at for at, line in enumerate(body.splitlines()) if line.startswith(f"    {name}[")]
    reads = [
        at
        for at, line in enumerate(body.splitlines())
        if re.search(rf"\b{name}\b", line.split(" = ", 1)[1])
    ]
    if len(elements) != 1 or len(sets) != 1 or any(at <= sets[0] for at in reads):
        return None
    return str(elements.pop())


def _moved(body: str) -> str:
    """Put what a line makes into the next one, where that alone reads it."""
    found: list[str] = []
    for line in body.splitlines():
        now = line
        while found:
            said = re.fullmatch(r"    (?:rdpi_real|int32_t) (t\d+) = (.*);", found[-1])
            if said is None or len(re.findall(rf"\b{said[1]}\b", body)) != 2:
                break
            if not re.search(rf"\b{said[1]}\b", now):
                break
            moved = put(now, said[1], within(said[2]))
            if len(moved) > _LINE:
                break
            found.pop()
            now = moved
        found.append(now)
    return "".join(f"{line}\n" for line in found)
