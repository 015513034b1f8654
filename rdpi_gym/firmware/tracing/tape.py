"""The record of a trace: statements of C, and a fork wherever the traced code decides by a number."""

from __future__ import annotations

import itertools
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from types import FrameType

from rdpi_gym.firmware.tracing.statements import (
    LOCAL,
    Fork,
    Item,
    Statement,
    declared,
    forked,
    local,
    renamed,
    simplified,
    text_of,
)
from rdpi_gym.support.errors import InputError

# Ends of code that forks lead to: each is traced for itself.
_MOST_ENDS = 48


@dataclass(frozen=True)
class _Decision:
    condition: str


class Tape:
    """One run of the traced code, with the answers to its first decisions given."""

    def __init__(self, answers: Sequence[bool] = ()) -> None:
        self._answers = iter(answers)
        self._count = itertools.count()
        self._known: dict[str, bool] = {}
        self.events: list[Statement | _Decision] = []

    def fresh(self, wished: str = "") -> str:
        """Return a name that no variable has, which holds what it is wished to be called."""
        return local(next(self._count), wished)

    def write(
        self, text: str, declares: str = "", writes: Sequence[str] = (), keeps: bool = False
    ) -> None:
        """Write a statement; see :class:`~rdpi_gym.firmware.tracing.statements.Statement`."""
        changed = set(writes) - {declares}
        self._known = {
            condition: answer
            for condition, answer in self._known.items()
            if not changed & set(LOCAL.findall(condition))
        }
        self.events.append(Statement(text, declares, frozenset(writes), keeps))

    def decide(self, condition: str) -> bool:
        """Return the answer of this run to a condition."""
        if condition in self._known:
            return self._known[condition]
        answer = next(self._answers, True)
        self.events.append(_Decision(condition))
        if LOCAL.search(condition):
            self._known[condition] = answer
        return answer


def recorded(run: Callable[[Tape], None]) -> tuple[Item, ...]:
    """Return the code of a run, which is repeated once for each end that its decisions lead to.

    What both sides of a fork end with is written once, behind it; what nothing reads is left out.
    """
    return simplified(_grown(run, (), 0, itertools.count(1), itertools.count()))


_OURS = ("/rdpi_gym/firmware/", "/numpy/", "/numba/", "/torch/")


def placed(frames: Iterable[tuple[FrameType, int]]) -> str:
    """Return file and line of the last of frames that is of the traced code."""
    found = "the controller"
    for frame, line in frames:
        name = frame.f_code.co_filename.replace("\\", "/")
        if not name.startswith("<") and not any(part in name for part in _OURS):
            found = f"{'/'.join(name.split('/')[-2:])}:{line}"
    return found


def _run(run: Callable[[Tape], None], answers: tuple[bool, ...]) -> list[Statement | _Decision]:
    tape = Tape(answers)
    try:
        run(tape)
    except InputError:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        if isinstance(error.__cause__, InputError):  # NumPy's word for it
            raise error.__cause__ from error
        place = placed(traceback.walk_tb(error.__traceback__))
        raise InputError(f"{place}: {error}, which has no C") from error
    return tape.events


def _grown(
    run: Callable[[Tape], None],
    answers: tuple[bool, ...],
    seen: int,
    ends: Iterator[int],
    copies: Iterator[int],
) -> tuple[Item, ...]:
    """Return the code behind the first `seen` events, with a fork at each decision."""
    events = _run(run, answers)[seen:]
    statements = itertools.takewhile(lambda event: isinstance(event, Statement), events)
    common: tuple[Item, ...] = tuple(event for event in statements if isinstance(event, Statement))
    if len(common) == len(events):
        if next(ends) > _MOST_ENDS:
            raise InputError(
                f"the controller decides by numbers that are known only as it runs, in more than {_MOST_ENDS} ways; write the decision as np.where"
            )
        return common
    decision = events[len(common)]
    assert isinstance(decision, _Decision)
    behind = seen + len(common) + 1
    then = _grown(run, (*answers, True), behind, ends, copies)
    otherwise = _grown(run, (*answers, False), behind, ends, copies)
    # both runs count their variables alike: those of one side get names of their own
    own = f"{next(copies)}".zfill(3)
    otherwise = renamed(otherwise, {name: forked(name, own) for name in declared(otherwise)})
    shared = _shared_end(then, otherwise)
    at = len(then) - shared
    then, end, otherwise = then[:at], then[at:], otherwise[: len(otherwise) - shared]
    fork = () if then == otherwise else (Fork(decision.condition, then, otherwise),)
    return (*common, *fork, *end)


def _shared_end(one: Sequence[Item], other: Sequence[Item]) -> int:
    """Number of items that both end with, but for the names of what these declare."""
    best, alike, back = 0, dict[str, str](), dict[str, str]()
    made: set[str] = set()
    for count, both in enumerate(zip(reversed(one), reversed(other), strict=False), start=1):
        a, b = (text_of([item]) for item in both)
        if LOCAL.sub("t", a) != LOCAL.sub("t", b):
            break
        pairs = zip(LOCAL.findall(a), LOCAL.findall(b), strict=True)
        if any(alike.setdefault(x, y) != y or back.setdefault(y, x) != x for x, y in pairs):
            break
        made |= declared(both[:1])
        if all(x == y or x in made for x, y in alike.items()):
            best = count
    return best
