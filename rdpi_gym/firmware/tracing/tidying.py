"""Generated code made shorter: repetitions as loops, loops joined, expressions where they are read."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from rdpi_gym.firmware.tracing.joining import joined
from rdpi_gym.firmware.tracing.statements import (
    LOCAL,
    Fork,
    Item,
    Loop,
    Statement,
    declared,
    lines,
    put,
    renamed_in,
    within,
)

# Longest line that an expression is moved into.
_LINE = 110


def tidied(items: tuple[Item, ...]) -> tuple[Item, ...]:
    """Return the code with repetitions as loops, expressions where they alone are read, names counted anew."""
    shorter = joined(_rolled(items))
    moved = _inlined(shorter, _uses(shorter))
    names: dict[str, str] = {}
    for line in lines(moved):
        for name in LOCAL.findall(line):
            names.setdefault(name, f"t{len(names)}")
    return tuple(item.renamed(names) for item in moved)


# Fewest repetitions that become a loop, and the longest piece that is looked for.
_FEWEST, _LONGEST = 4, 80


def _rolled(items: tuple[Item, ...]) -> tuple[Item, ...]:
    """Return the code with pieces that are repeated, but for names of what they declare, as loops."""
    found: list[Item] = []
    plain = [LOCAL.sub("t", "\n".join(lines([item]))) for item in items]
    at = 0
    while at < len(items):
        item = items[at]
        loop, length = _repetition(items, plain, at)
        if loop is not None:
            found.append(loop)
            at += loop.count * length
            continue
        if isinstance(item, Fork):
            item = replace(item, then=_rolled(item.then), otherwise=_rolled(item.otherwise))
        found.append(item)
        at += 1
    return tuple(found)


def _repetition(items: tuple[Item, ...], plain: Sequence[str], at: int) -> tuple[Loop | None, int]:
    """Return what begins at a place as a loop, and the length of its piece; `plain`: texts without names."""
    for length in range(3, min(_LONGEST, (len(items) - at) // _FEWEST) + 1):
        rest = plain[at + length : at + _FEWEST * length]
        if plain[at] != rest[0] or plain[at : at + (_FEWEST - 1) * length] != rest:
            continue
        first = items[at : at + length]
        text, count = _piece(first), 1
        while _piece(items[at + count * length : at + (count + 1) * length]) == text:
            count += 1
        end = at + count * length
        if count < _FEWEST:
            continue
        own = declared(items[at:end])
        later = {name for line in lines(items[end:]) for name in LOCAL.findall(line)}
        if not own & later:
            return Loop(count, first), length
    return None, 0


def _piece(items: tuple[Item, ...]) -> str:
    """Return the text of a piece in which what it declares is counted."""
    text = "\n".join(lines(items))
    names: dict[str, str] = dict.fromkeys(declared(items), "")
    for name in LOCAL.findall(text):
        if names.get(name) == "":
            names[name] = f"own{sum(1 for each in names.values() if each)}"
    return renamed_in(text, names)


def _uses(items: Sequence[Item]) -> dict[str, int]:
    found: dict[str, int] = {}
    for line in lines(items):
        for name in LOCAL.findall(line):
            found[name] = found.get(name, 0) + 1
    return found


_SET = re.compile(r"(t\d+) = [^\n]*;")
_SCALAR = re.compile(r"(?:rdpi_real|int32_t) (t\d+) = (.*);", re.DOTALL)


def _inlined(items: Sequence[Item], uses: dict[str, int]) -> tuple[Item, ...]:
    found: list[Item] = []
    for item in items:
        now = item
        while found and (merged := _merged(found[-1], now, uses)) is not None:
            found.pop()
            now = merged
        if isinstance(now, Loop):
            now = replace(now, items=_inlined(now.items, uses))
        elif isinstance(now, Fork):
            then, otherwise = _inlined(now.then, uses), _inlined(now.otherwise, uses)
            now = replace(now, then=then, otherwise=otherwise)
        found.append(now)
    return tuple(found)


def _merged(before: Item, item: Item, uses: dict[str, int]) -> Item | None:
    """Return an item with the expression of the statement before it inside; None where that cannot be."""
    if not isinstance(before, Statement) or before.keeps or len(before.writes) > 1:
        return None
    if isinstance(item, Loop):
        return None
    if isinstance(item, Statement) and not before.writes and before.declares:
        begun = _SET.fullmatch(item.text)  # declared, and set right behind
        named = begun is not None and begun[1] == before.declares
        if named and _SCALAR.fullmatch(before.text) and item.text.count(before.declares) == 1:
            kind = before.text.split()[0]
            return replace(item, text=f"{kind} {item.text}", declares=before.declares)
    said = _SCALAR.fullmatch(before.text)
    if said is None or uses[said[1]] != 2:
        return None
    name, expression = said[1], within(said[2])
    if isinstance(item, Fork):
        if not re.search(rf"\b{name}\b", item.condition):
            return None
        return replace(item, condition=put(item.condition, name, expression))
    if "\n" in item.text or re.search(rf"&{name}\b", item.text):
        return None
    if not re.search(rf"\b{name}\b", item.text):
        return None
    text = put(item.text, name, expression)
    return replace(item, text=text) if len(text) <= _LINE else None
