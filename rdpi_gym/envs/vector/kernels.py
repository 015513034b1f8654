"""One step of many lanes: command, plant, reference, sensor, observation, reward.

Loops are short and over few rows each, so that they compile to vector instructions. They index
arrays of all blocks rather than take views of rows, and pass arrays rather than named tuples: numba
counts the references of every view and of every field that it hands to another function.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange

from rdpi_gym.envs.vector.chain import Table, run_chain
from rdpi_gym.envs.vector.commands import command_block
from rdpi_gym.envs.vector.lanes import (
    BEGUN,
    CHANGE,
    COMMAND,
    MEASURED,
    NOISE,
    OFFSET,
    RESOLUTION,
    SATURATED,
    SLIDE,
    Flags,
    Floats32,
    Integers,
    Law,
)
from rdpi_gym.envs.vector.sines import sample_references
from rdpi_gym.support.arrays import Array


@njit(cache=True)
def encode(value: float, zero: float, per_unit: float, limit: float) -> np.float32:
    """Return a value in units of the observation, within its bounds."""
    place = (value - zero) * per_unit
    place = place if place < limit else limit
    return np.float32(place if place > -limit else -limit)


@njit(cache=True)
def add_offsets(n: int, row: int, numbers: Array, work: Array) -> None:
    """Add the offsets behind the effects (µm) to the displacements in a row of `work`."""
    for b in range(work.shape[1]):
        work[row, b] += numbers[n, OFFSET, b]


@njit(cache=True)
def read_sensors(n: int, step: int, row: int, numbers: Array, noise: Array, work: Array) -> None:
    """Read the displacements (µm) in a row of `work`: noise, then rounding to the resolution."""
    lane, width = n * work.shape[1], work.shape[1]
    for b in range(width):
        work[MEASURED, b] = work[row, b]
    for b in range(min(width, len(noise) - lane)):
        if numbers[n, NOISE, b] > 0.0:
            sample = (step - int(numbers[n, BEGUN, b])) % noise.shape[1]
            work[MEASURED, b] += noise[lane + b, sample] * numbers[n, NOISE, b]
    for b in range(width):
        resolution = numbers[n, RESOLUTION, b]
        if resolution > 0.0:
            work[MEASURED, b] = np.rint(work[MEASURED, b] / resolution) * resolution


@njit(cache=True)
def _slide(n: int, size: int, observed: Floats32) -> None:
    for i in range(size):
        observed[n, i] = observed[n, SLIDE + i]


@njit(cache=True)
def _observe(
    n: int,
    at: int,
    ring: int,
    row: int,
    law: Law,
    work: Array,
    numbers: Array,
    window_um: Array,
    observed: Floats32,
) -> None:
    middle, per_half = 0.5 * (law.low_V + law.high_V), 2.0 / (law.high_V - law.low_V)
    size = window_um.shape[1] + 2
    for b in range(work.shape[1]):
        last = at + (b + 1) * size - 1
        reference = window_um[n, ring, b]
        observed[n, last - 2] = encode(reference, law.centre_um, law.per_scale, law.limit)
        observed[n, last - 1] = encode(work[row, b], law.centre_um, law.per_scale, law.limit)
        observed[n, last] = encode(numbers[n, COMMAND, b], middle, per_half, 1.0)


@njit(cache=True)
def _show(n: int, at: int, size: int, observed: Floats32, observation: Floats32) -> None:
    last, shown = observed[n, at : at + size], observation[n * size : (n + 1) * size]
    for i in range(len(shown)):
        shown[i] = last[i]


@njit(cache=True)
def _report_errors(n: int, row: int, ring: int, work: Array, window_um: Array, info: Array) -> None:
    shown = info[:, n * work.shape[1] : (n + 1) * work.shape[1]]
    for b in range(shown.shape[1]):
        shown[0, b] = work[row, b]
        shown[1, b] = window_um[n, ring, b]
        shown[2, b] = window_um[n, ring, b] - work[row, b]


@njit(cache=True)
def _report_commands(n: int, numbers: Array, info: Array) -> None:
    shown = info[:, n * numbers.shape[2] : (n + 1) * numbers.shape[2]]
    for b in range(shown.shape[1]):
        shown[3, b] = numbers[n, COMMAND, b]
        shown[4, b] = numbers[n, SATURATED, b]


@njit(cache=True)
def report(
    n: int, row: int, ring: int, work: Array, numbers: Array, window_um: Array, info: Array
) -> None:
    """Fill the info of a block.

    Parameters
    ----------
    n
        Number of the block.
    row, ring
        Rows of `work` and of `window_um` with displacements and references (µm).
    work : float64[WORK, W]
        Read.
    numbers, window_um
        Of :class:`rdpi_gym.envs.vector.lanes.Lanes`.
    info : float64[5, B]
        Filled for the lanes of the block.
    """
    _report_errors(n, row, ring, work, window_um, info)
    _report_commands(n, numbers, info)


@njit(cache=True)
def _reward(n: int, law: Law, work: Array, info: Array, reward: Array) -> None:
    first, end = n * work.shape[1], (n + 1) * work.shape[1]
    error, own, per_change = (
        info[2, first:end],
        reward[first:end],
        law.command_cost / (law.high_V - law.low_V),
    )
    for b in range(len(own)):
        own[b] = -abs(error[b]) * law.per_scale - per_change * work[CHANGE, b]


@njit(cache=True)
def _end(n: int, step: int, max_steps: int, numbers: Array, truncated: Flags) -> None:
    first = n * numbers.shape[2]
    for b in range(min(numbers.shape[2], len(truncated) - first)):
        truncated[first + b] = step - int(numbers[n, BEGUN, b]) >= max_steps


@njit(cache=True)
def show_block(
    n: int,
    step: int,
    row: int,
    law: Law,
    work: Array,
    numbers: Array,
    window_um: Array,
    observed: Floats32,
    rising: Integers,
    ending: Integers,
    stages: Table,
    rises: Array,
    references_um: Array,
    noise: Array,
    observation: Floats32,
    reward: Array,
    truncated: Flags,
    info: Array,
) -> None:
    """Write what a step shows of a block whose displacements (µm) stand in a row of `work`.

    Parameters
    ----------
    n, step
        As :func:`rdpi_gym.envs.vector.commands.command_block`.
    row
        Of `work`.
    law
        Numbers of the task.
    work : float64[WORK, W]
        Written over.
    numbers, window_um, observed, rising, ending
        Of :class:`rdpi_gym.envs.vector.lanes.Lanes`; references and observations move on.
    stages, rises, references_um, noise
        The fields of :class:`rdpi_gym.envs.vector.lanes.Sources`.
    observation, reward, truncated, info
        The fields of :class:`rdpi_gym.envs.vector.lanes.Shown`, filled for the lanes of the block;
        `truncated` only where an episode ends.
    """
    rows = window_um.shape[1]
    if len(stages):
        add_offsets(n, row, numbers, work)
    # In the ring r(k + preview) takes the place of r(k-1).
    now, newest, ahead = step % rows, (step - 1) % rows, step + rows - 1
    value = window_um[n, newest]
    sample_references(n, ahead, ahead < rising[n], law.ts_s, numbers, rises, references_um, value)
    measured = row
    if law.sensed:
        read_sensors(n, step, row, numbers, noise, work)
        measured = MEASURED
    at, size = step % SLIDE, work.shape[1] * (rows + 2)
    if at == 0:
        _slide(n, size, observed)
    _observe(n, at, newest, measured, law, work, numbers, window_um, observed)
    _show(n, at, size, observed, observation)
    report(n, row, now, work, numbers, window_um, info)
    _reward(n, law, work, info, reward)
    if step >= ending[n]:
        _end(n, step, law.max_steps, numbers, truncated)


@njit(cache=True)
def _advance_blocks(
    begin: int,
    end: int,
    step: int,
    actions: Array,
    base_V: Array,
    work: Array,
    p: Array,
    state: Array,
    stage_p: Array,
    stage_state: Array,
    numbers: Array,
    window_um: Array,
    observed: Floats32,
    rising: Integers,
    ending: Integers,
    stages: Table,
    rises: Array,
    references_um: Array,
    noise: Array,
    observation: Floats32,
    reward: Array,
    truncated: Flags,
    info: Array,
    *numbers_of_law: Any,
) -> None:
    law = Law(*numbers_of_law)
    for n in range(begin, end):
        command_block(n, step, actions, base_V, law, work, numbers)
        row = run_chain(
            p[min(n, len(p) - 1)], state[n], stages,
            stage_p[min(n, len(stage_p) - 1)], stage_state[n], law.ts_s, work,
        )  # fmt: skip
        show_block(
            n, step, row, law, work, numbers, window_um, observed, rising, ending, stages, rises,
            references_um, noise, observation, reward, truncated, info,
        )  # fmt: skip


@njit(cache=True)
def advance(
    blocks: int, step: int, actions: Array, base_V: Array, work: Array, *parts: Any
) -> None:
    """Take one step of all lanes.

    Parameters
    ----------
    blocks
        Number of blocks of lanes.
    step, actions, base_V
        As :func:`rdpi_gym.envs.vector.commands.command_block`.
    work : float64[threads, WORK, W]
        Written over.
    parts
        The fields of `Lanes`, `Sources`, `Shown` and `Law`, one after the other: passed as named
        tuples, they would cost three times as much to read.
    """
    _advance_blocks(0, blocks, step, actions, base_V, work[0], *parts)


@njit(cache=True, parallel=True)
def advance_parallel(
    blocks: int, step: int, actions: Array, base_V: Array, work: Array, *parts: Any
) -> None:
    """Take the step of :func:`advance`, each thread of `work` with its share of the blocks."""
    threads = len(work)
    for thread in prange(threads):
        begin, end = thread * blocks // threads, (thread + 1) * blocks // threads
        _advance_blocks(begin, end, step, actions, base_V, work[thread], *parts)
