"""Start of episodes in lanes: draws, the plant at rest, the first sample."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit, prange

from rdpi_gym.envs.layout import COLUMN, LIMIT, SPAN, ZERO, field_values
from rdpi_gym.envs.truth import EFFECT_LEVELS
from rdpi_gym.envs.vector.kernels import (
    add_offsets,
    encode,
    read_sensors,
    report,
)
from rdpi_gym.envs.vector.lanes import (
    BEGUN,
    COMMAND,
    ERROR,
    HELD,
    MEASURED,
    NEVER,
    NOISE,
    OFFSET,
    RESOLUTION,
    Integers,
    Lanes,
    Law,
    Shown,
    Sources,
    Words,
    place_parameters,
)
from rdpi_gym.envs.vector.random import (
    begin_noise,
    draw_reference,
    next_below,
    next_seed,
    next_uniform,
    seed_generator,
)
from rdpi_gym.envs.vector.waves import Drawn, begin_waves, sample_references
from rdpi_gym.plant.cores.play import play
from rdpi_gym.support.arrays import Array


class Column(NamedTuple):
    """A plant as the lanes hold it."""

    p: Array  # float64[P]: as rdpi_gym.plant.cores.base packs it
    together: int  # first of them that stand together, see lane_by_lane
    stage_p: Array  # float64[P']
    turns_V: Array  # float64[K]: commands at which it turned before the episode, in order
    offset_um: float  # behind its effects
    noise_um: float
    resolution_um: float


@njit(cache=True)
def seed_generators(seeds: Words, indices: Integers, generators: Words) -> None:
    """Begin the generators of some lanes anew, each from its own seed."""
    for j in range(len(indices)):
        seed_generator(seeds[j], generators[indices[j]])


@njit(cache=True)
def draw_seeds(generators: Words, indices: Integers, kinds: int, seeds: Words) -> None:
    """Draw the seeds of plant, reference and noise of episodes, and which nominal plant each has."""
    rng, none = np.empty(4, dtype=np.uint64), (False, np.uint64(0))
    for j in range(len(indices)):
        for i in range(3):
            seeds[j, i] = next_seed(generators[indices[j]])
        seeds[j, 3] = np.uint64(0)
        if kinds > 1:
            seed_generator(seeds[j, 0], rng)
            seeds[j, 3] = np.uint64(next_below(rng, kinds, none)[0])


@njit(cache=True)
def draw_episodes(
    seeds: Words, choices: int, kinds: int, half_width: float, beginnings: int, drawn: Drawn
) -> None:
    """Draw what the single environment draws at a reset, for some lanes of one nominal plant."""
    rng = np.empty(4, dtype=np.uint64)
    low, high = 1.0 - half_width, 1.0 + half_width
    for j in range(len(seeds)):
        drawn.noise_seed[j] = seeds[j, 2]
        seed_generator(seeds[j, 0], rng)
        _, held = next_below(rng, kinds, (False, np.uint64(0)))
        for i in range(drawn.factors.shape[1]):
            drawn.factors[j, i] = low + (high - low) * next_uniform(rng)
        for i in range(drawn.levels.shape[1]):
            drawn.levels[j, i] = int(next_uniform(rng) * EFFECT_LEVELS)
        if len(drawn.life):
            drawn.life[j] = next_uniform(rng)
        if len(drawn.change):
            first, held = next_below(rng, beginnings, held)
            drawn.change[j, 0] = first
            drawn.change[j, 1] = next_uniform(rng)
        seed_generator(seeds[j, 1], rng)
        drawn.choice[j], drawn.position[j], drawn.signal_seed[j] = draw_reference(rng, choices)


@njit(cache=True)
def place_plants(step: int, rest_V: float, column: Column, drawn: Drawn, fresh: Lanes) -> None:
    """Put plants as a column has them, without memory, into a block of lanes that begin at a step."""
    state, numbers = fresh.state[0], fresh.numbers[0]
    place_parameters(column.p, column.together, fresh.p[0])
    for row in range(len(column.stage_p)):
        fresh.stage_p[0, row] = column.stage_p[row]
    fresh.stage_state[:] = np.nan
    fresh.numbers[:] = 0.0
    for b in range(state.shape[1]):
        state[0, b], state[1, b] = rest_V, 0.0
        numbers[BEGUN, b] = step if b < len(drawn.choice) else NEVER
        numbers[COMMAND, b] = numbers[HELD, b] = rest_V
        numbers[OFFSET, b] = column.offset_um
        numbers[NOISE, b] = column.noise_um
        numbers[RESOLUTION, b] = column.resolution_um


@njit(cache=True)
def scale_packed(gains: int, gaps_V: Array, factors: Array, fresh: Lanes) -> None:
    """Multiply the parameters of lanes that begin: gains, gaps between thresholds, and the rest."""
    p, rest = fresh.p[0], gains + len(gaps_V)
    for b in range(len(factors)):
        threshold = 0.0
        for i in range(gains):
            p[i, b] *= factors[b, i]
        for i in range(len(gaps_V)):
            threshold += gaps_V[i] * factors[b, gains + i]
            p[gains + i, b] = threshold
        for i in range(rest, factors.shape[1]):
            p[i, b] *= factors[b, i]


@njit(cache=True)
def settle_plays(rest_V: float, turns_V: Array, fresh: Lanes) -> None:
    """Set the play states that a rest at `rest_V` leaves of earlier turns (V)."""
    p, state = fresh.p[0], fresh.state[0]
    n = len(state) - 2
    for b in range(state.shape[1]):
        for i in range(n):
            r, x = p[n + 1 + i, b], 0.0
            if b < turns_V.shape[1]:
                for turn in turns_V[:, b]:
                    x = play(x, turn - r, turn + r)
            state[2 + i, b] = play(x, rest_V - r, rest_V + r)


@njit(cache=True, parallel=True)
def begin_signals_parallel(
    threads: int, count: int, waves: tuple[Any, ...], noise: tuple[Any, ...]
) -> None:
    """Begin references and noise of all lanes that begin, each thread with its share of them."""
    for thread in prange(threads):
        first, end = thread * count // threads, (thread + 1) * count // threads
        begin_waves(first, end, *waves)
        begin_noise(first, end, *noise)


@njit(cache=True)
def show_first(
    step: int,
    row: int,
    fresh: Lanes,
    sources: Sources,
    law: Law,
    work: Array,
    out: Shown,
) -> None:
    """Write what the first sample of a block shows; displacements (µm) stand in a row of `work`."""
    numbers, window_um, info, observation = (
        fresh.numbers,
        fresh.window_um,
        out.info,
        out.observation,
    )
    lanes, rows, encoder = info.shape[1], window_um.shape[1], sources.encoder
    size, fields = len(observation) // lanes, len(sources.now)
    own = int(encoder[:, COLUMN].max()) + 1
    # not literals: each would compile what is called once more
    lane, rising = np.int64(0), np.bool_(True)
    if len(sources.stages):
        add_offsets(lane, row, numbers, work)
    measured = row
    if law.sensed:
        read_sensors(lane, row, lane, numbers, sources.noise, work)
        measured = MEASURED
    begin = int(encoder[0, COLUMN]) - rows + 1
    for j in range(rows):
        ring = (step + j) % rows
        sample_references(
            lane, step + j, rising, law.ts_s, numbers, sources.rises, j, sources.ahead_um,
            window_um[0, ring],
        )  # fmt: skip
        for b in range(lanes):
            observation[b * size + begin + j] = encode(
                window_um[0, ring, b], encoder[0, ZERO], encoder[0, SPAN], encoder[0, LIMIT]
            )
    now, newest = step % rows, (step - 1) % rows
    for b in range(lanes):
        values = field_values(
            window_um[0, newest, b], window_um[0, now, b], work[measured, b], numbers[0, COMMAND, b]
        )
        if len(values) != len(encoder):
            raise RuntimeError("this kernel was compiled for other fields; delete its __pycache__")
        for i in range(len(values)):
            column = int(encoder[i, COLUMN])
            if column >= 0:
                observation[b * size + column] = encode(
                    values[i], encoder[i, ZERO], encoder[i, SPAN], encoder[i, LIMIT]
                )
        for i in range(own, size):
            observation[b * size + i] = observation[b * size + sources.now[(i - own) % fields]]
    report(lane, row, step % rows, work, numbers, window_um, info)
    for b in range(lanes):
        numbers[0, ERROR, b] = numbers[0, ERROR + 1, b] = info[2, b]
        for i in range(5, len(info)):
            info[i, b] = 0.0
