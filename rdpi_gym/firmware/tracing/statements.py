"""Generated code: statements, forks and loops of C, and what makes a trace of them short."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

from rdpi_gym.firmware.tracing.naming import chosen, identifier
from rdpi_gym.firmware.translation.arithmetic import bare

_NAME = r"t\d+(?:__\w+)?"
LOCAL = re.compile(rf"\b{_NAME}\b")
"""Names of local variables in the text of C while it is made: a number, and what they are wished to be called."""
# Longest line that an expression is moved into.
_LINE = 110
# Fewest repetitions that become a loop, and the longest piece that is looked for.
_FEWEST, _LONGEST = 4, 80


@dataclass(frozen=True)
class Statement:
    """Lines of C."""

    text: str
    declares: str = ""
    writes: frozenset[str] = frozenset()
    keeps: bool = False


@dataclass(frozen=True)
class Fork:
    """If and else, by a condition of C."""

    condition: str
    then: tuple[Item, ...]
    otherwise: tuple[Item, ...]


@dataclass(frozen=True)
class Loop:
    """Items repeated `count` times."""

    count: int
    items: tuple[Item, ...]


Item: TypeAlias = Statement | Fork | Loop
_Block: TypeAlias = tuple[Item, ...]
_Uses: TypeAlias = Counter[str]


def _inside(item: Item, change: Callable[[_Block], _Block]) -> Item:
    """Return an item with its inner blocks changed."""
    if isinstance(item, Loop):
        return replace(item, items=change(item.items))
    if isinstance(item, Fork):
        return replace(item, then=change(item.then), otherwise=change(item.otherwise))
    return item


def lines(items: Sequence[Item], indent: str = "") -> Iterator[str]:
    """Yield the lines of C."""
    for item in items:
        if isinstance(item, Statement):
            for line in item.text.splitlines():
                yield f"{indent}{line}".rstrip()
            continue
        inner = indent + "    "
        if isinstance(item, Loop):
            yield f"{indent}for (int32_t n = 0; n < {item.count}; ++n) {{"
            yield from lines(item.items, inner)
        elif not item.then:
            yield f"{indent}if (!{_within(item.condition)}) {{"
            yield from lines(item.otherwise, inner)
        else:
            yield f"{indent}if ({bare(item.condition)}) {{"
            yield from lines(item.then, inner)
            if item.otherwise:
                yield f"{indent}}} else {{"
                yield from lines(item.otherwise, inner)
        yield f"{indent}}}"


def text_of(items: Sequence[Item]) -> str:
    """Return the text of C."""
    return "\n".join(lines(items))


def local(number: int, wished: str) -> str:
    """Return the name of a variable while code is made."""
    name = identifier(wished)
    return f"t{number}__{name}" if name else f"t{number}"


def forked(name: str, own: str) -> str:
    """Return the name of a variable on the other side of a fork."""
    number, *wished = name.split("__")
    return "__".join([f"{number}9{own}", *wished])


def declared(items: Sequence[Item]) -> set[str]:
    """Return the variables that code declares."""
    return set(re.findall(rf"\b(?:rdpi_real|int32_t) ({_NAME})\b", text_of(items)))


def renamed(items: Sequence[Item], names: Mapping[str, str]) -> _Block:
    """Return code with other names of variables."""

    def one(item: Item) -> Item:
        if isinstance(item, Statement):
            writes = frozenset(names.get(name, name) for name in item.writes)
            declares = names.get(item.declares, item.declares)
            return Statement(_renamed(item.text, names), declares, writes, item.keeps)
        item = _inside(item, lambda block: renamed(block, names))
        if isinstance(item, Fork):
            return replace(item, condition=_renamed(item.condition, names))
        return item

    return tuple(map(one, items))


def _renamed(text: str, names: Mapping[str, str]) -> str:
    return LOCAL.sub(lambda found: names.get(found[0], found[0]), text)


def simplified(items: _Block) -> _Block:
    """Return code without dead statements, with loops for repetitions, and few variables."""
    rolled = _rolled(_living(items))
    joined = _joined(rolled, _uses(text_of(rolled)))
    moved = _inlined(joined, _uses(text_of(joined)))
    text = text_of(moved)
    wishes = {name: name.partition("__")[2] for name in LOCAL.findall(text)}
    used = re.findall(r"\b[A-Za-z_]\w*", LOCAL.sub("", text))
    return renamed(moved, chosen(wishes, used))


def _uses(text: str) -> _Uses:
    return Counter(LOCAL.findall(text))


# Dead code.


def _living(items: _Block) -> _Block:
    """Return the items whose results are read or kept."""
    needed: set[str] = set()
    while True:
        before = len(needed)
        kept = _reached(items, needed)
        if len(needed) == before:
            return kept


def _reached(items: _Block, needed: set[str]) -> _Block:
    found: list[Item] = []
    for item in items:
        if isinstance(item, Statement):
            if item.keeps or item.writes & needed or item.declares in needed:
                needed |= set(LOCAL.findall(item.text))
                found.append(item)
            continue
        assert isinstance(item, Fork)  # loops are found later
        then, otherwise = _reached(item.then, needed), _reached(item.otherwise, needed)
        if then or otherwise:
            needed |= set(LOCAL.findall(item.condition))
            found.append(replace(item, then=then, otherwise=otherwise))
    return tuple(found)


# Repetitions as loops.


def _rolled(items: _Block) -> _Block:
    """Return code with pieces that are repeated, but for the names that they declare, as loops."""
    found: list[Item] = []
    plain = [LOCAL.sub("t", text_of([item])) for item in items]
    at = 0
    while at < len(items):
        loop = _repetition(items, plain, at)
        found.append(_inside(items[at], _rolled) if loop is None else loop)
        at += 1 if loop is None else loop.count * len(loop.items)
    return tuple(found)


def _repetition(items: _Block, plain: Sequence[str], at: int) -> Loop | None:
    """Return the loop that begins at a place; `plain`: texts without names of variables."""
    for length in range(3, min(_LONGEST, (len(items) - at) // _FEWEST) + 1):
        rest = plain[at + length : at + _FEWEST * length]
        if plain[at] != rest[0] or plain[at : at + (_FEWEST - 1) * length] != rest:
            continue
        first = items[at : at + length]
        text, count = _piece(first), 1
        while _piece(items[at + count * length : at + (count + 1) * length]) == text:
            count += 1
        end = at + count * length
        if count >= _FEWEST and not declared(items[at:end]) & _uses(text_of(items[end:])).keys():
            return Loop(count, first)
    return None


def _piece(items: _Block) -> str:
    """Return the text of a piece with its own variables counted."""
    text, own = text_of(items), declared(items)
    found = [name for name in dict.fromkeys(LOCAL.findall(text)) if name in own]
    return _renamed(text, {name: f"own{k}" for k, name in enumerate(found)})


# Neighbouring loops joined to one, and arrays that one loop alone uses made numbers.

_LOOP = re.compile(r"for \(int32_t i = 0; i < (\d+); \+\+i\) \{\n((?:    [^\n]*;\n)+)\}")
_SET_ELEMENT = re.compile(r"    ([\w>.-]+)\[([^\]]+)\] = (.*);")
_ELEMENT = re.compile(r"([A-Za-z][\w>.-]*)\[([^\]]+)\]")
_ARRAY = re.compile(rf"(rdpi_real|int32_t) ({_NAME})\[\d+\];")


def _joined(items: _Block, uses: _Uses) -> _Block:
    found: list[Item] = []
    for item in items:
        now = _inside(item, lambda block: _joined(block, uses))
        if isinstance(now, Statement):
            # arrays are declared before the loops that come before them
            before = (k for k in range(len(found) - 1, -1, -1) if not _array_of(found[k]))
            at = next(before, None)
            one = None if at is None else _one_loop(found[at], now)
            if at is not None and one is not None:
                del found[at]
                now = one
        found.append(now)
    kinds = {array[2]: array[1] for item in found if (array := _array_of(item))}
    return _with_numbers(found, kinds, uses)


def _array_of(item: Item) -> re.Match[str] | None:
    return _ARRAY.fullmatch(item.text) if isinstance(item, Statement) else None


def _one_loop(one: Item, other: Statement) -> Statement | None:
    """Return two loops as one; None where an element would be made in another order."""
    if not isinstance(one, Statement):
        return None
    first, second = _LOOP.fullmatch(one.text), _LOOP.fullmatch(other.text)
    if first is None or second is None or first[1] != second[1]:
        return None
    before, after = _accesses(first[2]), _accesses(second[2])
    if before is None or after is None:
        return None
    if not all(_keep_order(x, y) for x in before for y in after):
        return None
    text = f"for (int32_t i = 0; i < {first[1]}; ++i) {{\n{first[2]}{second[2]}}}"
    return Statement(text, "", one.writes | other.writes, one.keeps or other.keeps)


def _accesses(body: str) -> list[tuple[str, str, bool]] | None:
    """Return array, index and whether it is written, of all elements; None: not only assignments."""
    found = []
    for line in body.splitlines():
        parts = _SET_ELEMENT.fullmatch(line)
        if parts is None:
            return None
        found.append((parts[1], parts[2], True))
        found += [(array, index, False) for array, index in _ELEMENT.findall(parts[3])]
    return found


def _keep_order(one: tuple[str, str, bool], other: tuple[str, str, bool]) -> bool:
    """Whether two accesses keep their order where their loops run together."""
    if one[0] != other[0] or not (one[2] or other[2]):
        return True
    x, y = (re.fullmatch(r"(?:(\d+) \+ )?i", each[1]) for each in (one, other))
    if x is None or y is None:
        return one[1] == other[1]
    # an element that both touch has to come up in the first loop no later than in the second
    return int(x[1] or 0) >= int(y[1] or 0)


def _with_numbers(items: list[Item], kinds: Mapping[str, str], uses: _Uses) -> _Block:
    """Make arrays that one loop alone reads and writes, an element at a time, numbers within it."""
    gone: set[str] = set()
    found: list[Item] = []
    for item in items:
        loop = _LOOP.fullmatch(item.text) if isinstance(item, Statement) else None
        if loop is None or not isinstance(item, Statement):
            found.append(item)
            continue
        body, own = loop[2], set[str]()
        for name in sorted(set(LOCAL.findall(body)) & kinds.keys()):
            element = _only_element(name, body)
            if element is None or uses[name] != 1 + _uses(body)[name]:
                continue
            own.add(name)
            body = body.replace(f"    {element} = ", f"    {kinds[name]} {name} = ", 1)
            body = body.replace(element, name)
        gone |= own
        each = tuple(Statement(line.strip()) for line in body.splitlines())
        short = lines(_inlined(each, _uses(body), _LINE - 4), "    ")
        text = "\n".join([f"for (int32_t i = 0; i < {loop[1]}; ++i) {{", *short, "}"])
        found.append(Statement(text, "", item.writes - own, item.keeps))
    return tuple(
        item for item in found if not (isinstance(item, Statement) and item.declares in gone)
    )


def _only_element(name: str, body: str) -> str | None:
    """Return the one element of an array that lines set once and then read; None: more than that."""
    rows = body.splitlines()
    elements = set(re.findall(rf"\b{name}\[[^\]]+\]", body))
    sets = [at for at, line in enumerate(rows) if line.startswith(f"    {name}[")]
    reads = [at for at, line in enumerate(rows) if name in LOCAL.findall(line.split(" = ", 1)[1])]
    if len(elements) != 1 or len(sets) != 1 or any(at <= sets[0] for at in reads):
        return None
    return str(elements.pop())


# Expressions moved into the one statement that reads them.

_SET = re.compile(rf"({_NAME}) = [^\n]*;")
_SCALAR = re.compile(rf"(?:rdpi_real|int32_t) ({_NAME}) = (.*);", re.DOTALL)


def _inlined(items: _Block, uses: _Uses, longest: int = _LINE) -> _Block:
    found: list[Item] = []
    for item in items:
        now = item
        while found and (merged := _merged(found[-1], now, uses, longest)) is not None:
            found.pop()
            now = merged
        found.append(_inside(now, lambda block: _inlined(block, uses)))
    return tuple(found)


def _merged(before: Item, item: Item, uses: _Uses, longest: int) -> Item | None:
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
    scalar = _SCALAR.fullmatch(before.text)
    if scalar is None or uses[scalar[1]] != 2:
        return None
    name, expression = scalar[1], _within(scalar[2])
    into = item.condition if isinstance(item, Fork) else item.text
    if name not in LOCAL.findall(into):
        return None
    if isinstance(item, Fork):
        return replace(item, condition=_put(into, name, expression))
    if "\n" in into or re.search(rf"&{name}\b", into):
        return None
    text = _put(into, name, expression)
    return replace(item, text=text) if len(LOCAL.sub("t00", text)) <= longest else None


def _within(expression: str) -> str:
    """Return an expression as part of another one."""
    called = re.match(r"\w+(?=\()", expression)
    arguments = expression[called.end() :] if called else expression
    if re.fullmatch(r"[\w.>\[\]-]+", expression) or bare(arguments) != arguments:
        return expression
    return f"({expression})"


def _put(text: str, name: str, expression: str) -> str:
    """Return a text with an expression in place of a name, in parentheses where it needs them."""
    found = re.search(rf"(= |return |\(|, )?\b{name}\b(?=([;,)]?))", text)
    assert found is not None
    whole = found[1] is not None and found[2] and (found[1], found[2]) != ("= ", ")")
    put = bare(expression) if whole else expression
    return f"{text[: found.start()]}{found[1] or ''}{put}{text[found.end() :]}"
