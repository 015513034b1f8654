"""NumPy's default generators for many lanes at once: its numbers, without an object for each lane.

A generator object costs microseconds to make, and every episode has three. Here a lane's generator
is a row ``uint64[4]``: the high and low half of PCG64's state and of its increment. A test holds
every function against ``numpy.random``, whose seeding and bit generator are stable by its policy.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

Word: TypeAlias = np.uint64
Words: TypeAlias = NDArray[np.uint64]

_LOW32 = np.uint64(0xFFFFFFFF)
_16, _32 = np.uint64(16), np.uint64(32)
_ONE = np.uint64(1)
# numpy/random/bit_generator.pyx: the hash of SeedSequence, with 32 bit words.
_INIT_A, _MULT_A = np.uint64(0x43B0D7E5), np.uint64(0x931E8875)
_INIT_B, _MULT_B = np.uint64(0x8B51F9DD), np.uint64(0x58F38DED)
_MIX_L, _MIX_R = np.uint64(0xCA01F9DD), np.uint64(0x4973F715)
# numpy/random/src/pcg64: the multiplier of the 128 bit congruential generator.
_PCG_HIGH, _PCG_LOW = np.uint64(2549297995355413924), np.uint64(4865540595714422341)


@njit(cache=True)
def _hashed(word: Word, constant: Word, factor: Word) -> tuple[Word, Word]:
    """Return a hashed word and the next constant."""
    following = (constant * factor) & _LOW32
    word = ((word ^ constant) * following) & _LOW32
    return word ^ (word >> _16), following


@njit(cache=True)
def _step(rng: Words) -> None:
    """Move the state on: times the multiplier, plus the increment, modulo 2^128."""
    high, low = rng[0], rng[1]
    a, b = low >> _32, low & _LOW32
    c, d = _PCG_LOW >> _32, _PCG_LOW & _LOW32
    ad, bd = a * d, b * d
    middle = b * c + (bd >> _32) + (ad & _LOW32)
    carried = a * c + (ad >> _32) + (middle >> _32)
    high = carried + high * _PCG_LOW + low * _PCG_HIGH
    low = low * _PCG_LOW
    rng[1] = low + rng[3]
    rng[0] = high + rng[2] + (_ONE if rng[1] < low else np.uint64(0))


@njit(cache=True)
def seed_generator(seed: Word, rng: Words) -> None:
    """Fill `rng` with the state of ``numpy.random.default_rng(seed)``.

    Parameters
    ----------
    seed : uint64
        The seed.
    rng : uint64[4]
        Filled.
    """
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
    word, turn = rng[0] ^ rng[1], rng[0] >> np.uint64(58)
    turned: Word = (word >> turn) | (word << ((np.uint64(64) - turn) & np.uint64(63)))
    return turned


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
def draw_reference(rng: Words, choices: int) -> tuple[int, float, int]:
    """Return ``rng.integers(choices), rng.random(), rng.integers(2**31)`` of a fresh generator.

    Both whole numbers take 32 bits: the low half of a word first, then the high half that is left.
    """
    index, left, word = np.uint64(0), False, np.uint64(0)
    if choices > 1:  # Lemire's method
        several = np.uint64(choices)
        rejected = (np.uint64(4294967296) - several) % several
        while True:
            bits = word >> _32
            if not left:
                word = next_word(rng)
                bits = word & _LOW32
            left = not left
            product = bits * several
            if (product & _LOW32) >= rejected:
                index = product >> _32
                break
    position: float = next_uniform(rng)
    bits = (word >> _32) if left else (next_word(rng) & _LOW32)
    return int(index), position, int(bits >> _ONE)
