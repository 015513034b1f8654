"""The arrays of a vector environment: lanes in blocks that fit a core's caches."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.vector.chain import Table
from rdpi_gym.envs.vector.memory import FLOAT64, LINE, fetch_line
from rdpi_gym.support.arrays import Array

Floats32: TypeAlias = NDArray[np.float32]
Flags: TypeAlias = NDArray[np.bool_]
Integers: TypeAlias = NDArray[np.int64]
Words: TypeAlias = NDArray[np.uint64]

# Rows of Lanes.numbers.
BEGUN = 0  # step of the environment at which the episode began
SATURATED = 1  # steps of the episode that were clipped
COMMAND = 2  # u(k) (V)
HELD = 3  # what the converter holds of it (V)
OFFSET = 4  # offset of the plant behind its effects (µm)
NOISE = 5  # standard deviation of the sensor (µm)
RESOLUTION = 6  # its smallest step (µm)
OMEGA = 7  # rate of phase of a sine (rad/s); NaN: the reference is a table
PHASE = 8  # its phase (rad)
AMPLITUDE = 9  # its amplitude (µm)
CENTRE = 10  # its centre (µm)
RISE = 11  # row of its smooth start
ERROR = 12  # r - y (µm) of the last two samples, in turn; the next row belongs to it
NUMBERS = 14

# Rows that a thread writes over in every block; the plant's chain takes the first six.
CHANGE = 6  # of the command (V), absolute
MEASURED = 7  # displacement as the sensor reads it (µm)
CLIPPED = 8  # 1 where the command or action was clipped
WORK = 9

# Places by which the observations slide on, one a step, before they begin at the first one again.
SLIDE = 64

# A step that no environment reaches: begun and unlimited episodes, without overflow of their sum.
NEVER = 2**61

# Lanes of a block: what one step of it reads and writes fits a second-level cache, and its rows lie
# no power of two apart, which caches take for the same place.
_BLOCK = 416
# Blocks are filled up to whole vectors, and beyond the width at which stage kernels change loops.
_MULTIPLE = 32
_ALIGNMENT = 64


class Lanes(NamedTuple):
    """Plants and episodes in N blocks of W lanes; every row of a block is contiguous."""

    p: Array  # float64[N or 1, P, W]: one block where all lanes have the same plant; see lane_by_lane
    state: Array  # float64[N, S, W]
    stage_p: Array  # float64[N or 1, P', W]: one block where all lanes have the same effects
    stage_state: Array  # float64[N, S', W]
    numbers: Array  # float64[N, NUMBERS, W]
    window_um: Array  # float64[N, preview + 1, W]: the reference from now on, a ring
    observed: Floats32  # float32[N, W D + SLIDE]: the last observations, from step % SLIDE on
    past: (
        Floats32  # float32[N, W F (H + 1) + SLIDE F]: fields of earlier samples, from past_begin on
    )
    rising: Integers  # int64[N]: first step whose newest reference is beyond all smooth starts
    ending: Integers  # int64[N]: first step at which an episode of it ends


class Sources(NamedTuple):
    """Arrays that change at resets alone."""

    stages: Table
    rises: Array  # float64[R, M]: smooth starts, sample by sample
    waves: Array  # float64[B, C]: references, as rdpi_gym.envs.vector.waves has them
    tables_um: Array  # float64[B, M]: of those that are no wave; one row without any
    ahead_um: Array  # float64[N, AHEAD, W]: next samples; empty where all are sines
    noise: Array  # float64[N, M, W]: in units of the sensor's deviation; empty without noise
    noise_rngs: Words  # uint64[N W, 8]: what it is drawn from
    noise_state: Array  # float64[N W, 3]: of coloured noise; empty of white noise
    noise_law: Array  # float64[6]: as rdpi_gym.envs.vector.random has it
    encoder: Array  # float64[F, 6]: of the layout, reciprocal
    now: Integers  # int64[F]: column of each field's value of sample k


class Law(NamedTuple):
    """Numbers of the task, the same for every lane."""

    ts_s: float
    per_scale: float  # 1 / scale_um
    low_V: float
    high_V: float
    action_scale_V: float
    places: bool  # actions are places in the range
    command_cost: float
    hold: int  # samples that the converter holds
    sensed: bool  # a sensor has noise or a resolution
    max_steps: int
    core: int  # address of the core's kernel
    step_V: float  # smallest step of the command's converter (V); 0: none
    limited: bool  # limits are stated, and costs reported
    most_change_V: float  # limit of the command's change in a sample (V)
    most_ringing_um: float  # limit of the second difference of the error (µm)
    lowest_um: float  # limits of the displacement (µm)
    highest_um: float
    share: int  # blocks of lanes that a thread has, the last perhaps fewer


class Shown(NamedTuple):
    """Result of a step: arrays of B lanes that the caller keeps."""

    observation: Floats32  # float32[B (D + F H)]
    reward: Array  # float64[B]
    truncated: Flags  # bool[B]
    info: Array  # float64[5, B]: displacement, reference, error (µm), command (V), saturated; or
    # float64[10, B]: then costs of saturation, rate, ringing, excess stroke, and their sum


class Record(NamedTuple):
    """All that a step reads and writes."""

    lanes: Lanes
    sources: Sources
    shown: Shown
    law: Law


def room(count: int, dtype: Any = np.float64) -> NDArray[Any]:
    """Return so many numbers, not filled, that begin at a cache line.

    Vector loads that straddle two lines cost twice, and JAX takes over what begins at one alone.
    """
    size = np.dtype(dtype).itemsize
    raw = np.empty(count + _ALIGNMENT // size, dtype=dtype)
    start = -raw.__array_interface__["data"][0] % _ALIGNMENT // size
    return raw[start : start + count]


def aligned(shape: tuple[int, ...], dtype: Any = np.float64) -> NDArray[Any]:
    """Return zeros that begin at a cache line, see :func:`room`."""
    size = np.dtype(dtype).itemsize
    raw = np.zeros(
        math.prod(shape) + _ALIGNMENT // size, dtype=dtype
    )  # pages come as they are used
    start = -raw.__array_interface__["data"][0] % _ALIGNMENT // size
    zeros: NDArray[Any] = raw[start : start + math.prod(shape)].reshape(shape)
    return zeros


def block_shape(lanes: int, groups: int = 1) -> tuple[int, int]:
    """Return the number of blocks and their width for so many lanes, of which one of some groups is taken.

    The width fills few blocks with the lanes that a group is likely to have: their share, and twice
    its deviation.
    """
    share = lanes / groups
    likely = min(math.ceil(share + 2.0 * math.sqrt(share * (1.0 - 1.0 / groups))), lanes)
    width = -(-likely // -(-likely // _BLOCK))
    width = -(-width // _MULTIPLE) * _MULTIPLE
    return -(-lanes // width), width


def make_lanes(
    shape: tuple[int, int],
    rows: tuple[int, int, int, int],
    layout: ObservationLayout,
    shared: tuple[bool, bool] = (False, False),
    history: int = 0,
) -> Lanes:
    """Return lanes that have not begun."""
    blocks, width = shape
    p_blocks, stage_blocks = (1 if share else blocks for share in shared)
    lanes = Lanes(
        p=aligned((p_blocks, rows[0], width)),
        state=aligned((blocks, rows[1], width)),
        stage_p=aligned((stage_blocks, rows[2], width)),
        stage_state=aligned((blocks, rows[3], width)),
        numbers=aligned((blocks, NUMBERS, width)),
        window_um=aligned((blocks, layout.preview + 1, width)),
        observed=aligned((blocks, width * layout.size + SLIDE), np.float32),
        past=aligned((blocks, past_size(width, history, len(layout.fields))), np.float32),
        rising=np.zeros(blocks, dtype=np.int64),
        ending=np.zeros(blocks, dtype=np.int64),
    )
    lanes.numbers[:, BEGUN], lanes.numbers[:, OMEGA] = NEVER, np.nan
    return lanes


def past_size(width: int, history: int, fields: int) -> int:
    """Length of a block's fields of earlier samples, with room to slide; 0 without history."""
    return (width * (history + 1) + SLIDE) * fields if history else 0


@njit(cache=True, inline="always")
def past_room(size: int, width: int, fields: int) -> int:
    """Length of what one lane keeps of earlier samples, one more than it shows."""
    return (size - SLIDE * fields) // width


@njit(cache=True, inline="always")
def past_begin(step: int, fields: int) -> int:
    """Place in a block's past where that of its first lane begins; it slides down, a sample a step.

    Before it stands what is shown now.
    """
    return (SLIDE - step % SLIDE) * fields


def unshared(lanes: Lanes) -> Lanes:
    """Return the same lanes with parameters of their own for each block."""
    blocks = len(lanes.state)

    def own(shared: Array) -> Array:
        if len(shared) == blocks:
            return shared
        each: Array = aligned((blocks, *shared.shape[1:]))
        each[:] = shared
        return each

    return lanes._replace(p=own(lanes.p), stage_p=own(lanes.stage_p))


@njit(cache=True)
def lane_by_lane(p: Array, together: int) -> Array:
    """Return the parameters of a block from a row on to the last but two, of each lane together.

    They are ``(W, K)`` in the place of ``(K, W)``, for a core that picks among many.
    """
    count = len(p) - 2 - together
    own: Array = p[together : len(p) - 2].reshape(p.shape[1], count)
    return own


@njit(cache=True)
def place_parameters(column: Array, together: int, p: Array) -> None:
    """Fill a block with the parameters of one plant."""
    for row in range(len(p)):
        p[row] = column[row]
    own = lane_by_lane(p, together)
    for b in range(len(own)):
        own[b] = column[together : len(p) - 2]


@njit(cache=True)
def table_row(n: int, share: int, step: int, rows: int) -> int:
    """Row for a step in a table of a block, drawn anew after its last; blocks do so at other steps.

    Those that are in the same place of the shares of the threads do so at the same step: a thread
    that draws alone is one for which the others wait.
    """
    return (step + n % share * rows // share) % rows


_A_LINE = LINE // FLOAT64


@njit(cache=True)
def fetch_rows(n: int, row: int, b: int, end: int, table: Array) -> None:
    """Fetch a part of the lines that rows of a block's table have for the next eight lanes after lane `b`.

    A table is filled lane by lane, so that every row is another line: each of eight lanes fetches an
    eighth of them, and computes meanwhile.
    """
    rows, width = table.shape[1], table.shape[2]
    following, part = b - b % _A_LINE + _A_LINE, -(-rows // _A_LINE)
    first = part * (b % _A_LINE)
    if following < end:
        begin = table.ctypes.data + FLOAT64 * (n * rows * width + following)
        for k in range(max(row, first), min(rows, first + part)):
            fetch_line(begin + FLOAT64 * width * k)


@njit(cache=True)
def scatter(
    first: int, end: int, step: int, together: int, fresh: Lanes, observation: Floats32,
    indices: Integers, lanes: Lanes,
) -> None:  # fmt: skip
    """Put lanes that have just begun, in one block of their own, in their places."""
    blocks, _, width = lanes.state.shape
    at, size = step % SLIDE, (lanes.observed.shape[1] - SLIDE) // width
    shown = len(observation) // len(indices)
    earlier = shown - size
    fields = (lanes.past.shape[1] - width * earlier) // (width + SLIDE)
    begin, kept = past_begin(step, fields), earlier + fields
    for j in range(first, end):
        n, b = indices[j] // width, indices[j] % width
        if len(lanes.p) == blocks:
            _copy_lane(fresh.p, j, lanes.p[n], b, 0, together)
            _copy_lane(fresh.p, j, lanes.p[n], b, lanes.p.shape[1] - 2, lanes.p.shape[1])
            own, given = lane_by_lane(lanes.p[n], together), lane_by_lane(fresh.p[0], together)
            for i in range(own.shape[1]):
                own[b, i] = given[j, i]
        if len(lanes.stage_p) == blocks:
            _copy_lane(fresh.stage_p, j, lanes.stage_p[n], b, 0, lanes.stage_p.shape[1])
        _copy_lane(fresh.state, j, lanes.state[n], b, 0, lanes.state.shape[1])
        _copy_lane(fresh.stage_state, j, lanes.stage_state[n], b, 0, lanes.stage_state.shape[1])
        _copy_lane(fresh.numbers, j, lanes.numbers[n], b, 0, lanes.numbers.shape[1])
        _copy_lane(fresh.window_um, j, lanes.window_um[n], b, 0, lanes.window_um.shape[1])
        for i in range(size):
            lanes.observed[n, at + b * size + i] = observation[j * shown + i]
        for i in range(earlier):
            lanes.past[n, begin + b * kept + i] = observation[j * shown + size + i]
        for i in range(fields):  # at a beginning as shown before
            lanes.past[n, begin + b * kept - fields + i] = observation[j * shown + size + i]


@njit(cache=True, parallel=True)
def scatter_parallel(
    threads: int, step: int, together: int, fresh: tuple[Any, ...], observation: Floats32,
    indices: Integers, lanes: tuple[Any, ...],
) -> None:  # fmt: skip
    """Do as :func:`scatter` for all lanes that begin, each thread with its share of them.

    Numba hands tuples to threads, and no named ones: `fresh` and `lanes` are the fields of their
    :class:`Lanes`.
    """
    count = len(indices)
    for thread in prange(threads):
        first, end = thread * count // threads, (thread + 1) * count // threads
        scatter(first, end, step, together, Lanes(*fresh), observation, indices, Lanes(*lanes))


@njit(cache=True)
def note_begun(step: int, indices: Integers, lanes: Lanes, max_steps: int, rise: int) -> None:
    """Note in the blocks of lanes that begin at a step until when one rises, and when one ends."""
    blocks, _, width = lanes.state.shape
    changed = np.zeros(blocks, dtype=np.bool_)
    for lane in indices:
        changed[lane // width] = True
    for n in range(blocks):
        if changed[n]:
            lanes.rising[n] = max(lanes.rising[n], step + rise)
            lanes.ending[n] = int(lanes.numbers[n, BEGUN].min()) + max_steps


@njit(cache=True)
def _copy_lane(fresh: Array, j: int, block: Array, b: int, first: int, end: int) -> None:
    for row in range(first, end):
        block[row, b] = fresh[0, row, j]
