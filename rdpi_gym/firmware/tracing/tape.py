"""What a trace writes down: statements of C, and a fork wherever the traced code decides by a number."""

from __future__ import annotations

import itertools
import re
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from types import FrameType

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
from rdpi_gym.support.errors import InputError

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


# Ends of code that forks lead to: each is traced for itself.
_MOST_ENDS = 48


@dataclass(frozen=True)
class _Decision:
    condition: str


class Tape:
    """One run of the traced code, with the answers to its first decisions given.

    Parameters
    ----------
    answers
        They; every further decision is answered by true.

    Examples
    --------
    >>> tape = Tape()
    >>> tape.write("m->state[0] = RDPI_C(0.0);", keeps=True)
    >>> tape.decide("t1")
    True
    """

    def __init__(self, answers: Sequence[bool] = ()) -> None:
        self._answers = answers
        self._given = 0
        self._count = itertools.count()
        self._known: dict[str, bool] = {}
        self.events: list[Statement | _Decision] = []

    def fresh(self) -> str:
        """Return a name that no variable has."""
        return f"t{next(self._count)}"

    def write(
        self, text: str, declares: str = "", writes: Sequence[str] = (), keeps: bool = False
    ) -> None:
        """Write a statement; see :class:`Statement`."""
        changed = set(writes) - {declares}
        self._known = {
            condition: answer
            for condition, answer in self._known.items()
            if not changed & set(LOCAL.findall(condition))
        }
        self.events.append(Statement(text, declares, frozenset(writes), keeps))

    def decide(self, condition: str) -> bool:
        """Return what this run takes a condition for."""
        if condition in self._known:
            return self._known[condition]
        answer = self._answers[self._given] if self._given < len(self._answers) else True
        self._given += 1
        self.events.append(_Decision(condition))
        if LOCAL.search(condition):
            self._known[condition] = answer
        return answer


def recorded(run: Callable[[Tape], None]) -> tuple[Item, ...]:
    r"""Return what code writes on a tape, run once for each end that its decisions lead to.

    What both sides of a fork end with is written once, behind it; what nothing reads is left out.
    """
    ends = itertools.count(1)
    items = _grown(run, (), 0, ends, itertools.count())
    return tidied(_living(items))


_OURS = ("/rdpi_gym/firmware/", "/numpy/", "/numba/", "/torch/")


def placed(frames: Iterable[tuple[FrameType, int]]) -> str:
    """Return file and line of the last of frames that is of the traced code."""
    found = "the controller"
    for frame, line in frames:
        name = frame.f_code.co_filename.replace("\\", "/")
        if not name.startswith("<") and not any(part in name for part in _OURS):
            found = f"{'/'.join(name.split('/')[-2:])}:{line}"
    return found


def place_of(error: BaseException) -> str:
    """Return file and line of the traced code in which an error came up."""
    return placed(traceback.walk_tb(error.__traceback__))


def _grown(
    run: Callable[[Tape], None],
    answers: tuple[bool, ...],
    seen: int,
    ends: Iterator[int],
    copies: Iterator[int],
) -> tuple[Item, ...]:
    tape = Tape(answers)
    try:
        run(tape)
    except InputError:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        if isinstance(error.__cause__, InputError):  # NumPy's word for it
            raise error.__cause__ from error
        raise InputError(f"{place_of(error)}: {error}, which has no C") from error
    events = tape.events[seen:]
    at = next((i for i, event in enumerate(events) if isinstance(event, _Decision)), None)
    if at is None:
        if next(ends) > _MOST_ENDS:
            raise InputError(
                f"the controller decides by numbers that are known only as it runs, in more than {_MOST_ENDS} ways; write the decision as np.where"
            )
        return tuple(event for event in events if isinstance(event, Statement))
    decision = events[at]
    assert isinstance(decision, _Decision)
    common = tuple(event for event in events[:at] if isinstance(event, Statement))
    behind = seen + at + 1
    then = _grown(run, (*answers, True), behind, ends, copies)
    otherwise = _grown(run, (*answers, False), behind, ends, copies)
    # both runs count their variables alike: those of one side get names of their own
    own = f"{next(copies)}".zfill(3)
    names = {name: f"{name}9{own}" for name in declared(otherwise)}
    otherwise = tuple(item.renamed(names) for item in otherwise)
    shared = _shared_end(then, otherwise)
    then, end = _split(then, shared)
    otherwise, _ = _split(otherwise, shared)
    fork = () if then == otherwise else (Fork(decision.condition, then, otherwise),)
    return (*common, *fork, *end)


def _split(items: tuple[Item, ...], last: int) -> tuple[tuple[Item, ...], tuple[Item, ...]]:
    at = len(items) - last
    return items[:at], items[at:]


def _shared_end(one: Sequence[Item], other: Sequence[Item]) -> int:
    """Number of items that both end with, but for the names of what these declare."""
    best, alike, back = 0, dict[str, str](), dict[str, str]()
    made: set[str] = set()
    for count, both in enumerate(zip(reversed(one), reversed(other), strict=False), start=1):
        a, b = ("\n".join(lines([item])) for item in both)
        if LOCAL.sub("t", a) != LOCAL.sub("t", b):
            break
        pairs = zip(LOCAL.findall(a), LOCAL.findall(b), strict=True)
        if any(alike.setdefault(x, y) != y or back.setdefault(y, x) != x for x, y in pairs):
            break
        made |= declared(both[:1])
        if all(x == y or x in made for x, y in alike.items()):
            best = count
    return best


def _living(items: tuple[Item, ...]) -> tuple[Item, ...]:
    """Return the statements without those that nothing comes of."""
    needed: set[str] = set()
    while True:
        before = len(needed)
        kept = _reached(items, needed)
        if len(needed) == before:
            return kept


def _reached(items: tuple[Item, ...], needed: set[str]) -> tuple[Item, ...]:
    found: list[Item] = []
    for item in items:
        if isinstance(item, Statement):
            if item.keeps or item.writes & needed or item.declares in needed:
                needed |= item.names
                found.append(item)
            continue
        assert isinstance(item, Fork)  # loops are found later
        then, otherwise = _reached(item.then, needed), _reached(item.otherwise, needed)
        if then or otherwise:
            needed |= set(LOCAL.findall(item.condition))
            found.append(replace(item, then=then, otherwise=otherwise))
    return tuple(found)
