"""One step of many lanes: command, plant, reference, sensor, observation, reward.

Loops are short and over few rows each, so that they compile to vector instructions. What takes
views of rows is compiled without reference counts: counting costs as much as a dozen lanes a row.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange

from rdpi_gym.arrays import Array
from rdpi_gym.envs.vector_chain import run_chain
from rdpi_gym.envs.vector_lanes import (
    AMPLITUDE,
    BEGUN,
    CENTRE,
    COMMAND,
    FIRST,
    HELD,
    NOISE,
    OFFSET,
    OMEGA,
    PHASE,
    RESOLUTION,
    RISE,
    SATURATED,
    Flags,
    Floats32,
    Lanes,
    Law,
    Scratch,
    Shown,
    Sources,
)

_ROWS = {"cache": True}
# Ends of the named tuples in the arguments of a step.
_LANES = len(Lanes._fields)
_SOURCES = _LANES + len(Sources._fields)
_LAW = _SOURCES + len(Law._fields)
_SCRATCH = _LAW + len(Scratch._fields)
# Rows of the scratch that the chain leaves alone.
_CHANGE, _MEASURED = 6, 7

# π in parts of 24 bits: whole multiples of the first two are exact.
_PI_A = float(np.float32(np.pi))
_PI_B = float(np.float32(np.pi - _PI_A))
_PI_C = (np.pi - _PI_A - _PI_B) + 1.2246467991473532e-16
_TAYLOR = tuple((-1.0) ** k / float(np.prod(np.arange(1.0, 2 * k + 2))) for k in range(10))


@njit(cache=True, fastmath={"contract"})
def sines(x: Array) -> None:
    """Replace x by sin x, within two units in the last place; the loop runs on vector units.

    Parameters
    ----------
    x : float64[W]
        Arguments (rad), below 1e8; sines on return.
    """
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
def _place_commands(
    actions: Array, low: float, high: float, command: Array, saturated: Array, change: Array
) -> None:
    span = high - low
    for b in range(len(actions)):
        place = actions[b]
        within = place if place < 1.0 else 1.0
        within = within if within > -1.0 else -1.0
        u = low + 0.5 * (within + 1.0) * span
        u = u if u < high else high
        change[b] = abs(u - command[b])
        command[b] = u
        saturated[b] += 0.0 if within == place else 1.0


@njit(cache=True)
def _add_commands(
    actions: Array,
    base_V: Array,
    scale_V: float,
    low: float,
    high: float,
    command: Array,
    saturated: Array,
    change: Array,
) -> None:
    for b in range(len(actions)):
        place = actions[b]
        within = place if place < 1.0 else 1.0
        within = within if within > -1.0 else -1.0
        wanted = base_V[b] + within * scale_V
        u = wanted if wanted > low else low
        u = u if u < high else high
        change[b] = abs(u - command[b])
        command[b] = u
        saturated[b] += 0.0 if within == place and u == wanted else 1.0


@njit(cache=True)
def _convert(step: int, hold: int, begun: Array, command: Array, held: Array, u: Array) -> None:
    """Fill `u` (V) with what the converter holds of the commands."""
    if hold == 1:
        for b in range(len(u)):
            u[b] = command[b]
        return
    for b in range(len(u)):
        if (step - int(begun[b])) % hold == 0:
            held[b] = command[b]
        u[b] = held[b]


@njit(cache=True)
def _phases(now: float, ts: float, begun: Array, omega: Array, phase: Array, value: Array) -> None:
    for b in range(len(value)):
        value[b] = omega[b] * (ts * (now - begun[b])) + phase[b]


@njit(cache=True)
def _scale(amplitude: Array, centre: Array, value: Array) -> None:
    for b in range(len(value)):
        value[b] = centre[b] + amplitude[b] * value[b]


@njit(**_ROWS)
def sample_references(
    n: int, step: int, rising: bool, numbers: Array, sources: Sources, ts: float, value: Array
) -> None:
    """Fill `value` with r (µm) of a block at a step of the environment."""
    begun, omega = numbers[n, BEGUN], numbers[n, OMEGA]
    _phases(float(step), ts, begun, omega, numbers[n, PHASE], value)
    sines(value)
    _scale(numbers[n, AMPLITUDE], numbers[n, CENTRE], value)
    if rising:
        rises, rise = sources.rises, numbers[n, RISE]
        for b in range(len(value)):
            # Lanes that only fill the block up have not begun.
            k = max(min(step - int(begun[b]), rises.shape[1] - 1), 0)
            value[b] *= rises[int(rise[b]), k]
    tables_um, lane = sources.references_um, n * len(value)
    for b in range(min(len(value), len(tables_um) - lane)):
        if np.isnan(omega[b]):
            value[b] = tables_um[lane + b, step - int(begun[b]) - int(numbers[n, FIRST, b])]


@njit(cache=True)
def _read_sensors(
    n: int, step: int, numbers: Array, noise: Array, y: Array, measured: Array
) -> None:
    """Fill the readings (µm): noise, then rounding to the resolution."""
    for b in range(len(y)):
        measured[b] = y[b]
    lane = n * len(y)
    for b in range(min(len(y), len(noise) - lane)):
        if numbers[n, NOISE, b] > 0.0:
            sample = (step - int(numbers[n, BEGUN, b])) % noise.shape[1]
            measured[b] += noise[lane + b, sample] * numbers[n, NOISE, b]
    for b in range(len(y)):
        resolution = numbers[n, RESOLUTION, b]
        if resolution > 0.0:
            measured[b] = np.rint(measured[b] / resolution) * resolution


@njit(cache=True)
def encode(value: Array, zero: float, per_unit: float, column: Floats32) -> None:
    """Fill a column with values in units of the observation."""
    for b in range(len(column)):
        column[b] = (value[b] - zero) * per_unit


@njit(**_ROWS)
def encode_present(
    n: int,
    step: int,
    numbers: Array,
    sources: Sources,
    law: Law,
    y: Array,
    measured: Array,
    columns: Floats32,
) -> None:
    """Fill rows 1 and 2 of `columns`: the reading of displacements `y` (µm), and the command."""
    if law.sensed:
        _read_sensors(n, step, numbers, sources.noise, y, measured)
        encode(measured, law.centre_um, law.per_scale, columns[1])
    else:
        encode(y, law.centre_um, law.per_scale, columns[1])
    middle, per_half = 0.5 * (law.low_V + law.high_V), 2.0 / (law.high_V - law.low_V)
    encode(numbers[n, COMMAND], middle, per_half, columns[2])


@njit(cache=True)
def _move_left(observed: Floats32, shown: Floats32) -> None:
    for i in range(len(shown) - 1):
        shown[i] = observed[i + 1]


@njit(cache=True)
def _put_last(columns: Floats32, size: int, shown: Floats32) -> None:
    for b in range(len(shown) // size):
        shown[(b + 1) * size - 3] = columns[0, b]
        shown[(b + 1) * size - 2] = columns[1, b]
        shown[(b + 1) * size - 1] = columns[2, b]


@njit(cache=True)
def _keep(shown: Floats32, observed: Floats32) -> None:
    for i in range(len(shown)):
        observed[i] = shown[i]


@njit(cache=True)
def _report_error(
    reference: Array, y: Array, displacement: Array, now: Array, error: Array
) -> None:
    for b in range(len(error)):
        displacement[b] = y[b]
        now[b] = reference[b]
        error[b] = reference[b] - y[b]


@njit(cache=True)
def _report_command(command: Array, saturated: Array, command_V: Array, count: Array) -> None:
    for b in range(len(count)):
        command_V[b] = command[b]
        count[b] = saturated[b]


@njit(**_ROWS)
def report(
    n: int, first: int, last: int, now: Array, y: Array, numbers: Array, info: Array
) -> None:
    """Fill the info of a block from its references and displacements (µm)."""
    _report_error(now, y, info[0, first:last], info[1, first:last], info[2, first:last])
    _report_command(
        numbers[n, COMMAND], numbers[n, SATURATED], info[3, first:last], info[4, first:last]
    )


@njit(cache=True)
def _reward(
    error: Array, change: Array, per_scale: float, per_change: float, reward: Array
) -> None:
    for b in range(len(error)):
        reward[b] = -abs(error[b]) * per_scale - per_change * change[b]


@njit(cache=True)
def _end(step: int, max_steps: int, begun: Array, truncated: Flags) -> None:
    for b in range(len(truncated)):
        truncated[b] = step - int(begun[b]) >= max_steps


@njit(**_ROWS)
def command_block(
    n: int, step: int, actions: Array, base_V: Array, lanes: Lanes, law: Law, work: Array
) -> None:
    """Read the actions of a block: row 0 of `work` gets what drives its plants (V).

    Parameters
    ----------
    n, step
        Number of the block, and step of the environment that these actions lead to.
    actions : float64[B]
        Actions, finite.
    base_V : float64[B]
        Commands (V) that are corrected; empty where actions are places or increments.
    lanes, law
        Commands and counts of clipped steps change.
    work : float64[8, W]
        Written over.
    """
    numbers, width = lanes.numbers, work.shape[1]
    first = n * width
    last = min(first + width, len(actions))
    command, saturated, change = numbers[n, COMMAND], numbers[n, SATURATED], work[_CHANGE]
    chosen = actions[first:last]
    if law.places:
        _place_commands(chosen, law.low_V, law.high_V, command, saturated, change)
    else:
        base = base_V[first:last] if len(base_V) else command
        _add_commands(
            chosen, base, law.action_scale_V, law.low_V, law.high_V, command, saturated, change
        )
    _convert(step, law.hold, numbers[n, BEGUN], command, numbers[n, HELD], work[0])


@njit(**_ROWS)
def show_block(
    n: int,
    step: int,
    row: int,
    lanes: Lanes,
    sources: Sources,
    law: Law,
    work: Array,
    columns: Floats32,
    out: Shown,
) -> None:
    """Write what a step shows of a block whose displacements (µm) stand in a row of `work`.

    Parameters
    ----------
    n, step
        As :func:`command_block`.
    row
        Of `work`.
    lanes, sources, law
        References and observations move on.
    work, columns : float64[8, W], float32[3, W]
        Written over.
    out
        Filled for the lanes of the block; `truncated` only where an episode ends.
    """
    numbers, window_um, info = lanes.numbers, lanes.window_um, out.info
    width, rows = work.shape[1], window_um.shape[1]
    size = rows + 2
    first = n * width
    last = min(first + width, len(out.reward))
    y = work[row]
    if len(sources.stages):
        for b in range(width):
            y[b] += numbers[n, OFFSET, b]
    # Rows of r(k) and of r(k-1), which makes room for r(k + preview), in the ring.
    now, newest, ahead = window_um[n, step % rows], window_um[n, (step - 1) % rows], step + rows - 1
    sample_references(n, ahead, ahead < lanes.rising[n], numbers, sources, law.ts_s, newest)
    encode(newest, law.centre_um, law.per_scale, columns[0])
    encode_present(n, step, numbers, sources, law, y, work[_MEASURED], columns)
    observed, shown = lanes.observed[n], out.observation[first * size : last * size]
    # Moved as one row, every lane's preview goes one to the left; the rest is written over.
    _move_left(observed, shown)
    _put_last(columns, size, shown)
    _keep(shown, observed)
    report(n, first, last, now, y, numbers, info)
    per_change = law.command_cost / (law.high_V - law.low_V)
    error, reward = info[2, first:last], out.reward[first:last]
    _reward(error, work[_CHANGE], law.per_scale, per_change, reward)
    if step >= lanes.ending[n]:
        _end(step, law.max_steps, numbers[n, BEGUN], out.truncated[first:last])


@njit(inline="always")
def _advance_block(
    n: int,
    step: int,
    actions: Array,
    base_V: Array,
    lanes: Lanes,
    sources: Sources,
    law: Law,
    work: Array,
    columns: Floats32,
    out: Shown,
) -> None:
    command_block(n, step, actions, base_V, lanes, law, work)
    row = run_chain(
        lanes.p[min(n, len(lanes.p) - 1)], lanes.state[n], sources.stages,
        lanes.stage_p[min(n, len(lanes.stage_p) - 1)], lanes.stage_state[n], law.ts_s, work,
    )  # fmt: skip
    show_block(n, step, row, lanes, sources, law, work, columns, out)


@njit(**_ROWS)
def advance(step: int, actions: Array, base_V: Array, *parts: Any) -> None:
    """Take one step of all lanes.

    Parameters
    ----------
    step, actions, base_V
        As :func:`command_block`.
    parts
        The fields of `Lanes`, `Sources`, `Law`, `Scratch` and `Shown`, one after the other: passed
        as named tuples, they would cost three times as much to read.
    """
    lanes, sources = Lanes(*parts[:_LANES]), Sources(*parts[_LANES:_SOURCES])
    law, scratch = Law(*parts[_SOURCES:_LAW]), Scratch(*parts[_LAW:_SCRATCH])
    out, work, columns = Shown(*parts[_SCRATCH:]), scratch.work[0], scratch.columns[0]
    for n in range(len(lanes.state)):
        _advance_block(n, step, actions, base_V, lanes, sources, law, work, columns, out)


@njit(cache=True, parallel=True)
def advance_parallel(step: int, actions: Array, base_V: Array, *parts: Any) -> None:
    """Take the step of :func:`advance`, each thread of `Scratch` with its share of the blocks."""
    lanes, sources = Lanes(*parts[:_LANES]), Sources(*parts[_LANES:_SOURCES])
    law, scratch = Law(*parts[_SOURCES:_LAW]), Scratch(*parts[_LAW:_SCRATCH])
    out = Shown(*parts[_SCRATCH:])
    blocks, threads = len(lanes.state), len(scratch.work)
    for thread in prange(threads):
        work, columns = scratch.work[thread], scratch.columns[thread]
        for n in range(thread * blocks // threads, (thread + 1) * blocks // threads):
            _advance_block(n, step, actions, base_V, lanes, sources, law, work, columns, out)
