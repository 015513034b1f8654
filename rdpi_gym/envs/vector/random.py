"""NumPy's default generators for many lanes at once: its numbers, without an object for each lane.

A generator object costs microseconds to make, and every episode has three. Here a lane's generator
is a row ``uint64[4]``: the high and low half of PCG64's state and of its increment. A test holds
every function against ``numpy.random``, whose seeding and bit generator are stable by its policy.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic
from numba.np.random import _constants as ziggurat

from rdpi_gym.envs.draw_laws import MAINS_HZ, NOISE_BLOCK, NoiseLaw
from rdpi_gym.envs.vector.lanes import Integers, Words, aligned, fetch_rows, table_row
from rdpi_gym.envs.vector.sines import sines
from rdpi_gym.support.arrays import Array

Word: TypeAlias = np.uint64

_LOW32 = np.uint64(0xFFFFFFFF)
_16, _32 = np.uint64(16), np.uint64(32)
_ONE = np.uint64(1)
# numpy/random/bit_generator.pyx: the hash of SeedSequence, with 32 bit words.
_INIT_A, _MULT_A = np.uint64(0x43B0D7E5), np.uint64(0x931E8875)
_INIT_B, _MULT_B = np.uint64(0x8B51F9DD), np.uint64(0x58F38DED)
_MIX_L, _MIX_R = np.uint64(0xCA01F9DD), np.uint64(0x4973F715)
# numpy/random/src/pcg64: the multiplier of the 128 bit congruential generator.
_PCG_HIGH, _PCG_LOW = np.uint64(2549297995355413924), np.uint64(4865540595714422341)
# The strips of the normal density, as NumPy has them, and where its tail begins.
_KI, _WI, _FI = ziggurat.ki_double, ziggurat.wi_double, ziggurat.fi_double
_TAIL, _PER_TAIL = float(ziggurat.ziggurat_nor_r), float(ziggurat.ziggurat_nor_inv_r)
_STRIP, _BITS52 = np.uint64(0xFF), np.uint64(0x000FFFFFFFFFFFFF)


@njit(cache=True)
def _hashed(word: Word, constant: Word, factor: Word) -> tuple[Word, Word]:
    """Return a hashed word and the next constant."""
    following = (constant * factor) & _LOW32
    word = ((word ^ constant) * following) & _LOW32
    return word ^ (word >> _16), following


@intrinsic
def _high_product(typing: Any, a: Any, b: Any) -> Any:
    """Return the upper half of a product of two words: one instruction, and numba has none for it."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        wide = ir.IntType(128)
        product = builder.mul(*(builder.zext(each, wide) for each in arguments))
        return builder.trunc(builder.lshr(product, ir.Constant(wide, 64)), ir.IntType(64))

    return types.uint64(types.uint64, types.uint64), build


@njit(cache=True, inline="always")
def _moved(high: Word, low: Word, more: Word, less: Word) -> tuple[Word, Word]:
    """Return the next state: times the multiplier, plus the increment, modulo 2^128."""
    next_low = low * _PCG_LOW + less
    next_high = _high_product(low, _PCG_LOW) + high * _PCG_LOW + low * _PCG_HIGH + more
    return next_high + (_ONE if next_low < less else np.uint64(0)), next_low


@njit(cache=True, inline="always")
def _word(high: Word, low: Word) -> Word:
    """Return the 64 bits that a state stands for."""
    word, turn = high ^ low, high >> np.uint64(58)
    return (word >> turn) | (word << ((np.uint64(64) - turn) & np.uint64(63)))


@njit(cache=True)
def _step(rng: Words) -> None:
    rng[0], rng[1] = _moved(rng[0], rng[1], rng[2], rng[3])


@njit(cache=True)
def seed_generator(seed: Word, rng: Words) -> None:
    """Fill `rng` with the state of ``numpy.random.default_rng(seed)``."""
    pool = np.zeros(4, dtype=np.uint64)
    pool[0], pool[1] = seed & _LOW32, seed >> _32
    constant = _INIT_A
    for i in range(4):
        pool[i], constant = _hashed(pool[i], constant, _MULT_A)
    for source in range(4):
        for target in range(4):
            if source != target:
                value, constant = _hashed(pool[source], constant, _MULT_A)
                mixed = (_MIX_L * pool[target] - _MIX_R * value) & _LOW32
                pool[target] = mixed ^ (mixed >> _16)
    words = np.empty(4, dtype=np.uint64)
    constant = _INIT_B
    for i in range(4):
        first, constant = _hashed(pool[(2 * i) % 4], constant, _MULT_B)
        second, constant = _hashed(pool[(2 * i + 1) % 4], constant, _MULT_B)
        words[i] = first | (second << _32)
    rng[0] = rng[1] = np.uint64(0)
    rng[2] = (words[2] << _ONE) | (words[3] >> np.uint64(63))
    rng[3] = (words[3] << _ONE) | _ONE
    _step(rng)
    low = rng[1] + words[1]
    rng[0] += words[0] + (_ONE if low < words[1] else np.uint64(0))
    rng[1] = low
    _step(rng)


@njit(cache=True)
def next_word(rng: Words) -> Word:
    """Return the next 64 bits of a generator."""
    _step(rng)
    word: Word = _word(rng[0], rng[1])
    return word


@njit(cache=True)
def next_seed(rng: Words) -> Word:
    """Return what ``rng.integers(2**63)`` does."""
    word: Word = next_word(rng)
    return word >> _ONE


@njit(cache=True)
def next_uniform(rng: Words) -> float:
    """Return what ``rng.random()`` does."""
    word: Word = next_word(rng)
    return float(word >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit(cache=True)
def _beyond(rng: Words, negative: bool) -> float:
    """Return a number of the tail (Marsaglia, 1964)."""
    while True:
        x = -_PER_TAIL * math.log1p(-next_uniform(rng))
        y = -math.log1p(-next_uniform(rng))
        if y + y > x * x:
            return -(_TAIL + x) if negative else _TAIL + x


@njit(cache=True)
def _normal_of(word: Word, rng: Words) -> float:
    """Return a standard normal number that begins with a word, where the quick way ends."""
    while True:
        strip = word & _STRIP
        magnitude = (word >> np.uint64(9)) & _BITS52
        x: float = float(np.int64(magnitude)) * _WI[strip]
        if (word >> np.uint64(8)) & _ONE:
            x = -x
        if magnitude < _KI[strip]:
            return x
        if strip == 0:
            far: float = _beyond(rng, (magnitude >> np.uint64(8)) & _ONE == _ONE)
            return far
        step = _FI[strip - _ONE] - _FI[strip]
        if step * next_uniform(rng) + _FI[strip] < math.exp(-0.5 * x * x):
            return x
        word = next_word(rng)


@njit(cache=True)
def draw_normals(rng: Words, numbers: Array) -> None:
    """Fill `numbers` as ``rng.standard_normal`` does: the ziggurat of Marsaglia and Tsang (2000)."""
    high, low, more, less = rng[0], rng[1], rng[2], rng[3]
    for k in range(len(numbers)):
        high, low = _moved(high, low, more, less)
        word = _word(high, low)
        strip = word & _STRIP
        magnitude = (word >> np.uint64(9)) & _BITS52
        if magnitude < _KI[strip]:  # of 99 in 100
            x = float(np.int64(magnitude)) * _WI[strip]
            numbers[k] = -x if (word >> np.uint64(8)) & _ONE else x
            continue
        rng[0], rng[1] = high, low
        numbers[k] = _normal_of(word, rng)
        high, low = rng[0], rng[1]
    rng[0], rng[1] = high, low


@njit(cache=True)
def next_below(rng: Words, bound: int, held: tuple[bool, Word]) -> tuple[int, tuple[bool, Word]]:
    """Return what ``rng.integers(bound)`` does, and the half of a word that is left for the next.

    Whole numbers take 32 bits: the low half of a word first, then the high half that is left.
    """
    left, word = held
    if bound <= 1:
        return 0, held
    several = np.uint64(bound)  # Lemire's method
    rejected = (np.uint64(4294967296) - several) % several
    while True:
        bits = word >> _32
        if not left:
            word = next_word(rng)
            bits = word & _LOW32
        left = not left
        product = bits * several
        if (product & _LOW32) >= rejected:
            return int(product >> _32), (left, word)


@njit(cache=True)
def draw_reference(rng: Words, choices: int) -> tuple[int, float, int]:
    """Return ``rng.integers(choices), rng.random(), rng.integers(2**31)`` of a fresh generator."""
    index, held = next_below(rng, choices, (False, np.uint64(0)))
    position: float = next_uniform(rng)
    left, word = held
    bits = (word >> _32) if left else (next_word(rng) & _LOW32)
    return index, position, int(bits >> _ONE)


SAMPLES = 32
"""Numbers that a lane draws at a time: its generator stays in registers meanwhile."""


# Coloured noise: columns of a lane's state, and entries of its law.
COUNT, HUM_RAD, WANDER = range(3)  # samples drawn, phase of the mains, last of the low-pass
WHITE_SHARE, WANDER_SHARE, HUM_SHARE, POLE, GAIN, MAINS_RAD = range(
    6
)  # the last one per second; then ts_s


@njit(cache=True)
def _begin_coloured(rng: Words, state: Array, first: Array) -> None:
    """Draw what coloured noise begins with, of a generator that has just been seeded."""
    state[COUNT] = 0.0
    state[HUM_RAD] = 2.0 * math.pi * next_uniform(rng[:4])
    draw_normals(rng[:4], first[:1])
    state[WANDER] = first[0]
    for i in range(4):
        rng[4 + i] = rng[i]


@njit(cache=True)
def _draw_coloured(
    rng: Words, state: Array, law: Array, ts_s: float, white: Array, driven: Array, hum: Array,
    numbers: Array,
) -> None:  # fmt: skip
    """Fill `numbers` as ``ColouredNoise.standard_normal`` does, whose blocks are of one length.

    Of a block the white numbers come first, then those that drive the low-pass: the second half of
    `rng` is the generator behind the white ones.
    """
    done, pole, gain = 0, law[POLE], law[GAIN]
    while done < len(numbers):
        count = int(state[COUNT])
        at = count % NOISE_BLOCK
        if at == 0:
            for i in range(4):
                rng[i] = rng[4 + i]
            for _ in range(NOISE_BLOCK // SAMPLES):
                draw_normals(rng[4:], driven)
            if pole > 0.0:
                state[WANDER] = pole * (state[WANDER] if count == 0 else state[WANDER] / pole)
        part = min(len(numbers) - done, NOISE_BLOCK - at, SAMPLES)
        draw_normals(rng[:4], white[:part])
        draw_normals(rng[4:], driven[:part])
        for j in range(part):
            hum[j] = law[MAINS_RAD] * (ts_s * (count + j)) + state[HUM_RAD]
        sines(hum[:part])
        held = state[WANDER]
        for j in range(part):
            wander = held + gain * driven[j]
            held = pole * wander
            numbers[done + j] = (
                law[WHITE_SHARE] * white[j] + law[WANDER_SHARE] * wander + law[HUM_SHARE] * hum[j]
            )
        state[WANDER] = held
        state[COUNT] += part
        done += part


@njit(cache=True)
def draw_noise(
    n: int, row: int, begin: int, end: int, rngs: Words, states: Array, law: Array, tables: Array
) -> None:
    """Draw the rows of a block's lanes from a row on, for the lanes that have a generator."""
    width, ts_s = tables.shape[2], law[len(law) - 1]
    rooms = np.empty((3, SAMPLES))
    for b in range(begin, end):
        fetch_rows(n, row, b, end, tables)
        lane = n * width + b
        if rngs[lane, 3] == 0:  # a seeded one has an odd increment
            continue
        if len(states):
            _draw_coloured(
                rngs[lane], states[lane], law, ts_s, rooms[0], rooms[1], rooms[2],
                tables[n, row:, b],
            )  # fmt: skip
        else:
            draw_normals(rngs[lane], tables[n, row:, b])


@njit(cache=True)
def begin_noise(
    first: int, end: int, step: int, share: int, indices: Integers, noise_um: float, seeds: Words,
    rngs: Words, states: Array, law: Array, tables: Array, first_noise: Array,
) -> None:  # fmt: skip
    """Seed the generators of lanes that begin at a step, and draw what is left of their blocks' rows."""
    if not len(tables):
        return
    _, rows, width = tables.shape
    for j in range(first, end):
        n, b = indices[j] // width, indices[j] % width
        row = table_row(n, share, step, rows)
        rngs[indices[j]] = 0
        if noise_um > 0.0:
            seed_generator(seeds[j], rngs[indices[j]])
            if len(states):
                _begin_coloured(rngs[indices[j]], states[indices[j]], first_noise[0, :, j])
            draw_noise(n, row, b, b + 1, rngs, states, law, tables)
        else:
            tables[n, :, b] = 0.0
        first_noise[0, 0, j] = tables[n, row, b]


class NoiseTables:
    """Noise of the lanes whose sensor has any, in units of its deviation, float64[N, S, W], and its generators.

    As :func:`draw_noise` has them; without rows until a lane has noise. `law` None is white noise.
    """

    def __init__(
        self, shape: tuple[int, int], share: int, law: NoiseLaw | None, ts_s: float
    ) -> None:
        self._blocks, self._width = shape
        self._share, self._coloured = share, law is not None
        self.rngs: Words = np.zeros((0, 8), dtype=np.uint64)
        self.states: Array = np.zeros((0, 3))
        self.tables: Array = np.zeros((0, SAMPLES, 1))
        given = NoiseLaw() if law is None else law
        pole = math.exp(-2.0 * math.pi * given.corner_hz * ts_s)
        shares = given.white, given.wander, given.hum
        mains_rad = 2.0 * math.pi * MAINS_HZ
        self.law: Array = np.array([*shares, pole, math.sqrt(1.0 - pole**2), mains_rad, ts_s])

    def ready(self, step: int, indices: Integers, noise_um: float, seeds: Words) -> tuple[Any, ...]:
        """Make room for the noise of lanes that begin at a step, once there is any."""
        if not len(self.tables) and noise_um > 0.0:
            lanes = self._blocks * self._width
            self.rngs = np.zeros((lanes, 8), dtype=np.uint64)
            self.states = np.zeros((lanes if self._coloured else 0, 3))
            self.tables = aligned((self._blocks, SAMPLES, self._width))
        rows = (1, 1, len(indices)) if len(self.tables) else (0, 1, 1)
        return (
            step, self._share, indices, noise_um, seeds, self.rngs, self.states, self.law,
            self.tables, np.empty(rows),
        )  # fmt: skip
