"""One step of many lanes: command, plant, reference, sensor reading, observation, reward.

Loops are short and over few rows each, so that they compile to vector instructions. They index
arrays of all blocks rather than take views of rows, and pass arrays rather than named tuples: numba
counts the references of every view and of every field that it hands to another function.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange
from numba.np.unsafe.ndarray import to_fixed_tuple

from rdpi_gym.envs.layout import COLUMN, FIELDS, LIMIT, SPAN, ZERO, field_values
from rdpi_gym.envs.vector.chain import run_chain
from rdpi_gym.envs.vector.lanes import (
    BEGUN,
    CHANGE,
    CLIPPED,
    COMMAND,
    ERROR,
    HELD,
    MEASURED,
    NOISE,
    OFFSET,
    RESOLUTION,
    SATURATED,
    SLIDE,
    Flags,
    Floats32,
    Integers,
    Lanes,
    Law,
    Record,
    Shown,
    Sources,
    past_begin,
    past_room,
    table_row,
)
from rdpi_gym.envs.vector.memory import (
    FLOAT32,
    LINE,
    copy_bytes,
    copy_float32,
    fetch_line,
    uncounted,
)
from rdpi_gym.envs.vector.random import draw_noise
from rdpi_gym.envs.vector.waves import sample_ahead, sample_references
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
        work[CLIPPED, b] = 0.0 if within == place else 1.0
        numbers[n, SATURATED, b] += work[CLIPPED, b]


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
        work[CLIPPED, b] = 0.0 if (within == place) & (u == wanted) else 1.0
        numbers[n, SATURATED, b] += work[CLIPPED, b]


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
def _round_commands(step_V: float, work: Array) -> None:
    """Round what drives the plants (V) to the converter's smallest step."""
    for b in range(work.shape[1]):
        work[0, b] = np.rint(work[0, b] / step_V) * step_V


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
    if law.step_V > 0.0:
        _round_commands(law.step_V, work)


_FIELDS = len(FIELDS)
# Where the fields of each part of a record begin, one after the other.
_SOURCES = len(Lanes._fields)
_SHOWN = _SOURCES + len(Sources._fields)
_LAW = _SHOWN + len(Shown._fields)


@njit(cache=True)
def encode(value: float, zero: float, span: float, limit: float) -> np.float32:
    """Encoded value of a field, by the reciprocal table of an ObservationLayout."""
    place = (value - zero) * span
    if limit < np.inf:  # else NaN stays NaN
        place = place if place < limit else limit
        place = place if place > -limit else -limit
    return np.float32(place)


@njit(cache=True)
def add_offsets(n: int, row: int, numbers: Array, work: Array) -> None:
    """Add the offsets behind the effects (µm) to the displacements in a row of `work`."""
    for b in range(work.shape[1]):
        work[row, b] += numbers[n, OFFSET, b]


@njit(cache=True)
def _add_noise(n: int, sample: int, row: int, numbers: Array, noise: Array, work: Array) -> None:
    for b in range(min(work.shape[1], noise.shape[2])):
        work[MEASURED, b] = work[row, b] + noise[n, sample, b] * numbers[n, NOISE, b]


@njit(cache=True)
def read_sensors(n: int, row: int, sample: int, numbers: Array, noise: Array, work: Array) -> None:
    """Read the displacements (µm) in a row of `work`: noise, then rounding to the resolution."""
    if len(noise):
        _add_noise(n, sample, row, numbers, noise, work)
    else:
        for b in range(work.shape[1]):
            work[MEASURED, b] = work[row, b]
    for b in range(work.shape[1]):
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
    newest: int,
    now: int,
    row: int,
    encoder: Array,
    work: Array,
    numbers: Array,
    window_um: Array,
    observed: Floats32,
) -> None:
    size = (observed.shape[1] - SLIDE) // work.shape[1]
    # As tuples, the table stays in registers.
    columns = to_fixed_tuple(encoder[:, COLUMN], _FIELDS)
    zeros = to_fixed_tuple(encoder[:, ZERO], _FIELDS)
    spans = to_fixed_tuple(encoder[:, SPAN], _FIELDS)
    limits = to_fixed_tuple(encoder[:, LIMIT], _FIELDS)
    for b in range(work.shape[1]):
        values = field_values(
            window_um[n, newest, b], window_um[n, now, b], work[row, b], numbers[n, COMMAND, b]
        )
        for i in range(len(values)):
            column = int(columns[i])
            if column >= 0:
                observed[n, at + b * size + column] = encode(
                    values[i], zeros[i], spans[i], limits[i]
                )


@njit(cache=True)
def _show(n: int, at: int, size: int, observed: Floats32, observation: Floats32) -> None:
    last, shown = observed[n, at : at + size], observation[n * size : (n + 1) * size]
    for i in range(len(shown)):
        shown[i] = last[i]


# How far ahead (bytes) lines are fetched: the latency of a shared cache.
_AHEAD = 4096


@njit(cache=True)
def _slide_past(n: int, fields: int, past: Floats32) -> None:
    room = SLIDE * fields
    for i in range(past.shape[1] - room - 1, -1, -1):
        past[n, room + i] = past[n, i]


@njit(cache=True)
def show_with_past(
    n: int, at: int, begin: int, width: int, observed: Floats32, past: Floats32, now: Integers,
    keeps: bool, observation: Floats32,
) -> None:  # fmt: skip
    """Write the last observations of a block with what was shown before, and keep of them what is now."""
    fields = len(now)
    size, room = (observed.shape[1] - SLIDE) // width, past_room(past.shape[1], width, fields)
    earlier = room - fields
    row = size + earlier
    lanes = min(width, len(observation) // row - n * width)
    to = observation.ctypes.data + FLOAT32 * (n * width * row)
    shown = observed.ctypes.data + FLOAT32 * (n * observed.shape[1] + at)
    then = past.ctypes.data + FLOAT32 * (n * past.shape[1] + begin)
    for _ in range(lanes):
        for i in range(0, FLOAT32 * row, LINE):
            fetch_line(to + _AHEAD + i)
        copy_bytes(to, shown, FLOAT32 * size)
        copy_bytes(to + FLOAT32 * size, then, FLOAT32 * earlier)
        if keeps:
            for i in range(fields):
                copy_float32(then + FLOAT32 * (i - fields), shown + FLOAT32 * now[i])
        to, shown, then = to + FLOAT32 * row, shown + FLOAT32 * size, then + FLOAT32 * room


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
    """Fill the info of a block."""
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
def _count_commands(n: int, most_V: float, work: Array, info: Array) -> None:
    shown = info[5:7, n * work.shape[1] : (n + 1) * work.shape[1]]
    for b in range(shown.shape[1]):
        shown[0, b] = work[CLIPPED, b]
        shown[1, b] = 1.0 if work[CHANGE, b] > most_V else 0.0


@njit(cache=True)
def _count_ringing(n: int, step: int, most_um: float, numbers: Array, info: Array) -> None:
    first, end = n * numbers.shape[2], (n + 1) * numbers.shape[2]
    error, ringing = info[2, first:end], info[7, first:end]
    last, before = ERROR + (step - 1) % 2, ERROR + step % 2
    for b in range(len(error)):
        bend = abs(error[b] - 2.0 * numbers[n, last, b] + numbers[n, before, b])
        ringing[b] = 1.0 if bend > most_um else 0.0
    for b in range(len(error)):
        numbers[n, before, b] = error[b]


@njit(cache=True)
def _count_strokes(
    n: int, row: int, low_um: float, high_um: float, work: Array, info: Array
) -> None:
    shown = info[8, n * work.shape[1] : (n + 1) * work.shape[1]]
    for b in range(len(shown)):
        y = work[row, b]
        shown[b] = 0.0 if (y >= low_um) & (y <= high_um) else 1.0


@njit(cache=True)
def _add_costs(n: int, width: int, info: Array) -> None:
    shown = info[5:10, n * width : (n + 1) * width]
    for b in range(shown.shape[1]):
        shown[4, b] = shown[0, b] + shown[1, b] + shown[2, b] + shown[3, b]


@njit(cache=True)
def _end(n: int, step: int, max_steps: int, numbers: Array, truncated: Flags) -> None:
    first = n * numbers.shape[2]
    for b in range(min(numbers.shape[2], len(truncated) - first)):
        truncated[first + b] = step - int(numbers[n, BEGUN, b]) >= max_steps


@njit(cache=True, inline="always")
def show_block(n: int, step: int, row: int, work: Array, record: Record) -> None:
    """Write what a step shows of a block whose displacements (µm) stand in a row of `work`."""
    lanes, sources, shown, law = record
    numbers, window_um, observed = lanes.numbers, lanes.window_um, lanes.observed
    rows = window_um.shape[1]
    if len(sources.stages):
        add_offsets(n, row, numbers, work)
    # In the ring r(k + preview) takes the place of r(k-1).
    now, newest, ahead = step % rows, (step - 1) % rows, step + rows - 1
    rising = ahead < lanes.rising[n]
    taken = 0
    if len(sources.ahead_um):
        taken = table_row(n, law.share, ahead, sources.ahead_um.shape[1])
        if taken == 0:
            sample_ahead(
                n, ahead, law.ts_s, numbers, sources.rises, sources.waves, sources.tables_um,
                sources.ahead_um,
            )  # fmt: skip
    sample_references(
        n, ahead, rising, law.ts_s, numbers, sources.rises, taken, sources.ahead_um,
        window_um[n, newest],
    )  # fmt: skip
    measured = row
    if law.sensed:
        sample = 0
        if len(sources.noise):
            _, samples, width = sources.noise.shape
            sample = table_row(n, law.share, step, samples)
            if sample == 0:
                draw_noise(
                    n, np.int64(0), np.int64(0), width, sources.noise_rngs, sources.noise_state, sources.noise_law,
                    sources.noise,
                )  # fmt: skip
        read_sensors(n, row, sample, numbers, sources.noise, work)
        measured = MEASURED
    at, size = step % SLIDE, observed.shape[1] - SLIDE
    past, begin = lanes.past, past_begin(step, len(sources.now))
    if at == 0:
        _slide(n, size, observed)
        _slide_past(n, len(sources.now), past)
    _observe(n, at, newest, now, measured, sources.encoder, work, numbers, window_um, observed)
    if past.shape[1]:
        show_with_past(
            n, at, begin, work.shape[1], observed, past, sources.now, True, shown.observation
        )
    else:
        _show(n, at, size, observed, shown.observation)
    report(n, row, now, work, numbers, window_um, shown.info)
    _reward(n, law, work, shown.info, shown.reward)
    if law.limited:
        _count_commands(n, law.most_change_V, work, shown.info)
        _count_ringing(n, step, law.most_ringing_um, numbers, shown.info)
        _count_strokes(n, row, law.lowest_um, law.highest_um, work, shown.info)
        _add_costs(n, work.shape[1], shown.info)
    if step >= lanes.ending[n]:
        _end(n, step, law.max_steps, numbers, shown.truncated)


@njit(cache=True)
def show_stacked(step: int, lanes: Lanes, sources: Sources, observation: Floats32) -> None:
    """Write the last observations of all lanes with their history."""
    blocks, _, width = lanes.state.shape
    for n in range(blocks):
        show_with_past(
            n, step % SLIDE, past_begin(step, len(sources.now)), width, lanes.observed, lanes.past,
            sources.now, False, observation,
        )  # fmt: skip


@njit(cache=True)
def _gather(
    places: Integers, observation: Floats32, reward: Array, truncated: Flags, info: Array,
    all_observations: Floats32, rewards: Array, all_truncated: Flags, infos: Array,
) -> None:  # fmt: skip
    lanes = len(rewards)
    row = FLOAT32 * (len(all_observations) // lanes)
    to, own = all_observations.ctypes.data, observation.ctypes.data
    for lane in range(lanes):
        copy_bytes(to + row * lane, own + row * places[0, lane], row)
    for lane in range(lanes):
        rewards[lane], all_truncated[lane] = reward[places[0, lane]], truncated[places[0, lane]]
    for i in range(len(infos)):
        for lane in range(lanes):
            infos[i, lane] = info[places[1, lane] + i * places[2, lane]]


def gather(places: Integers, parts: Shown, whole: Shown) -> None:
    """Put what groups show, one behind the other, in the order of the lanes; see ``Order``."""
    _gather(places, *parts, *whole)


# Written into both callers: on its own, the whole chain would be optimised once more before theirs.
@njit(inline="always")
def _advance_blocks(
    begin: int, end: int, step: int, actions: Array, base_V: Array, work: Array, record: Record
) -> None:
    lanes, sources, _, law = record
    for i in range(end - begin):
        # to and fro: what the last step ended with is still in the caches
        n = begin + i if step % 2 else end - 1 - i
        command_block(n, step, actions, base_V, law, work, lanes.numbers)
        row = run_chain(
            law.core, lanes.p[min(n, len(lanes.p) - 1)], lanes.state[n], sources.stages,
            lanes.stage_p[min(n, len(lanes.stage_p) - 1)], lanes.stage_state[n], law.ts_s, work,
        )  # fmt: skip
        show_block(n, step, row, work, record)


@njit(inline="always")
def _unpacked(counted: Any) -> Record:
    fields = uncounted(counted)
    return Record(
        Lanes(*fields[:_SOURCES]), Sources(*fields[_SOURCES:_SHOWN]), Shown(*fields[_SHOWN:_LAW]),
        Law(*fields[_LAW:]),
    )  # fmt: skip


@njit(cache=True)
def advance(
    blocks: int, step: int, actions: Array, base_V: Array, work: Array, fields: tuple[Any, ...]
) -> None:
    """Take one step of all lanes."""
    given = uncounted((actions, base_V, work))
    _advance_blocks(0, blocks, step, given[0], given[1], given[2][0], _unpacked(fields))


@njit(cache=True, parallel=True)
def advance_parallel(
    blocks: int, step: int, actions: Array, base_V: Array, work: Array, fields: tuple[Any, ...]
) -> None:
    """Take the step of :func:`advance`, each thread of `work` with its share of the blocks."""
    share = -(-blocks // len(work))
    for thread in prange(len(work)):
        # Unpacked by each thread: numba hands it tuples, and no named ones.
        record, given = _unpacked(fields), uncounted((actions, base_V, work))
        begin = thread * share
        end = min(begin + share, blocks)
        _advance_blocks(begin, end, step, given[0], given[1], given[2][thread], record)
