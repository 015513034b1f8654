"""The references of a block of lanes at one step: sines by formula, others as they were sampled."""

from __future__ import annotations

import numpy as np
from numba import njit

from rdpi_gym.envs.vector.lanes import (
    AMPLITUDE,
    BEGUN,
    CENTRE,
    OMEGA,
    PHASE,
    RISE,
)
from rdpi_gym.support.arrays import Array

# π in parts of 24 bits: whole multiples of the first two are exact.
_PI_A = float(np.float32(np.pi))
_PI_B = float(np.float32(np.pi - _PI_A))
_PI_C = (np.pi - _PI_A - _PI_B) + 1.2246467991473532e-16
_TAYLOR = tuple((-1.0) ** k / float(np.prod(np.arange(1.0, 2 * k + 2))) for k in range(10))


@njit(cache=True, fastmath={"contract"})
def sines(x: Array) -> None:
    """Replace x by sin x, within two units in the last place; the loop runs on vector units."""
    for b in range(len(x)):
        half_turns = np.rint(x[b] * (1.0 / np.pi))
        r = x[b] - half_turns * _PI_A
        r -= half_turns * _PI_B
        r -= half_turns * _PI_C
        s = r * r
        total = _TAYLOR[9]
        total = total * s + _TAYLOR[8]
        total = total * s + _TAYLOR[7]
        total = total * s + _TAYLOR[6]
        total = total * s + _TAYLOR[5]
        total = total * s + _TAYLOR[4]
        total = total * s + _TAYLOR[3]
        total = total * s + _TAYLOR[2]
        total = total * s + _TAYLOR[1]
        odd = 0.5 * half_turns - np.floor(0.5 * half_turns)  # 0 or 1/2
        x[b] = (r + r * s * total) * (1.0 - 4.0 * odd)


@njit(cache=True)
def _phases(n: int, now: float, ts: float, numbers: Array, value: Array) -> None:
    for b in range(len(value)):
        elapsed_s = ts * (now - numbers[n, BEGUN, b])
        value[b] = numbers[n, OMEGA, b] * elapsed_s + numbers[n, PHASE, b]


@njit(cache=True)
def _scale(n: int, numbers: Array, value: Array) -> None:
    for b in range(len(value)):
        value[b] = numbers[n, CENTRE, b] + numbers[n, AMPLITUDE, b] * value[b]


@njit(cache=True)
def _rise(n: int, step: int, rises: Array, numbers: Array, value: Array) -> None:
    for b in range(len(value)):
        # Lanes that only fill the block up have not begun.
        k = max(min(step - int(numbers[n, BEGUN, b]), rises.shape[1] - 1), 0)
        value[b] *= rises[int(numbers[n, RISE, b]), k]


@njit(cache=True)
def _take(n: int, row: int, numbers: Array, taken_um: Array, value: Array) -> None:
    for b in range(min(len(value), taken_um.shape[2])):
        taken = taken_um[n, row, b]  # outside a branch, which every other lane would take
        value[b] = taken if np.isnan(numbers[n, OMEGA, b]) else value[b]


@njit(cache=True)
def sample_references(
    n: int,
    step: int,
    rising: bool,
    ts: float,
    numbers: Array,
    rises: Array,
    row: int,
    taken_um: Array,
    value: Array,
) -> None:
    """Fill `value` with r (µm) of a block at a step of the environment."""
    _phases(n, float(step), ts, numbers, value)
    sines(value)
    _scale(n, numbers, value)
    if rising:
        _rise(n, step, rises, numbers, value)
    if len(taken_um):
        _take(n, row, numbers, taken_um, value)
