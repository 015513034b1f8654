"""What lanes do with actions: commands within the range, and what the converter holds of them."""

from __future__ import annotations

from numba import njit

from rdpi_gym.envs.vector.lanes import BEGUN, CHANGE, COMMAND, HELD, SATURATED, Law
from rdpi_gym.support.arrays import Array


@njit(cache=True)
def _place_commands(n: int, actions: Array, law: Law, work: Array, numbers: Array) -> None:
    low, high = law.low_V, law.high_V
    span, own = high - low, actions[n * work.shape[1] : (n + 1) * work.shape[1]]
    for b in range(len(own)):
        place = own[b]
        within = place if place < 1.0 else 1.0
        within = within if within > -1.0 else -1.0
        u = low + 0.5 * (within + 1.0) * span
        u = u if u < high else high
        work[CHANGE, b] = abs(u - numbers[n, COMMAND, b])
        numbers[n, COMMAND, b] = u
        numbers[n, SATURATED, b] += 0.0 if within == place else 1.0


@njit(cache=True)
def _add_commands(
    n: int, actions: Array, bases: Array, law: Law, work: Array, numbers: Array
) -> None:
    low, high, scale_V = law.low_V, law.high_V, law.action_scale_V
    own = actions[n * work.shape[1] : (n + 1) * work.shape[1]]
    for b in range(len(own)):
        place = own[b]
        within = place if place < 1.0 else 1.0
        within = within if within > -1.0 else -1.0
        wanted = bases[b] + within * scale_V
        u = wanted if wanted > low else low
        u = u if u < high else high
        work[CHANGE, b] = abs(u - numbers[n, COMMAND, b])
        numbers[n, COMMAND, b] = u
        numbers[n, SATURATED, b] += 0.0 if (within == place) & (u == wanted) else 1.0


@njit(cache=True)
def _convert(n: int, step: int, hold: int, work: Array, numbers: Array) -> None:
    if hold == 1:
        for b in range(work.shape[1]):
            work[0, b] = numbers[n, COMMAND, b]
        return
    for b in range(work.shape[1]):
        if (step - int(numbers[n, BEGUN, b])) % hold == 0:
            numbers[n, HELD, b] = numbers[n, COMMAND, b]
        work[0, b] = numbers[n, HELD, b]


@njit(cache=True)
def command_block(
    n: int, step: int, actions: Array, base_V: Array, law: Law, work: Array, numbers: Array
) -> None:
    """Read the actions of a block: row 0 of `work` gets what drives its plants (V)."""
    if law.places:
        _place_commands(n, actions, law, work, numbers)
    else:
        first, end = n * work.shape[1], (n + 1) * work.shape[1]
        bases = base_V[first:end] if len(base_V) else numbers[n, COMMAND]
        _add_commands(n, actions, bases, law, work, numbers)
    _convert(n, step, law.hold, work, numbers)
