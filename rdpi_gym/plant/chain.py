"""The order of the chain from the command to the displacement: one list, and the walk along it.

Plant, Jacobian and vector environment walk this list. The fused kernel of the vector environment is
a twin of it, which tests hold against it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, TypeAlias, get_args

Place: TypeAlias = Literal["input", "derivative", "rate", "memory", "core", "hysteresis", "output"]

CHAIN: tuple[Place, ...] = get_args(Place)
"""The places in their order. The hysteresis core has two of its own: ``derivative`` takes the rate
of the command, Eq. 5, and ``core`` makes a displacement of command and rate, Eq. 3 and 4. The
others are slots of effects."""

COMMAND, RATE, DISPLACEMENT = 0, 1, 2
"""The signals that run along the chain: command (V), its rate (V/s), displacement (µm)."""

ACTS_ON: Mapping[Place, int] = {
    "input": COMMAND,
    "derivative": RATE,
    "rate": RATE,
    "core": DISPLACEMENT,
    "hysteresis": DISPLACEMENT,
    "output": DISPLACEMENT,
}
"""The signal that a place replaces. What stands in ``memory`` replaces none: it sets the state of
the core before the first sample."""

FRONT: tuple[Place, ...] = CHAIN[: CHAIN.index("core")]
BEHIND: tuple[Place, ...] = CHAIN[CHAIN.index("core") + 1 :]

Link: TypeAlias = Callable[[Sequence[Any]], Any]
"""``link(signals)`` returns the new value of the signal that its place acts on."""

Walk: TypeAlias = list[tuple[int, Link]]


def in_order(links: Mapping[Place, Sequence[Link]], places: Sequence[Place] = CHAIN) -> Walk:
    """Return the links of some places in the chain's order, each with the signal that it replaces."""
    return [(ACTS_ON[place], link) for place in places for link in links.get(place, ())]


def walk(order: Walk, signals: list[Any]) -> list[Any]:
    """Run links one after the other; `signals` are changed in place and returned."""
    for signal, link in order:
        signals[signal] = link(signals)
    return signals
