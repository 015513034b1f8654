"""References of many lanes by formula: sines, and samples of other waves."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from rdpi_gym.envs.vector.lanes import (
    AMPLITUDE,
    BEGUN,
    CENTRE,
    OMEGA,
    PHASE,
    RISE,
    Integers,
    Words,
    fetch_rows,
    table_row,
)
from rdpi_gym.envs.vector.memory import FLOAT64, LINE, fetch_line
from rdpi_gym.envs.vector.random import next_uniform, seed_generator
from rdpi_gym.envs.vector.sines import sines
from rdpi_gym.support.arrays import Array


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
    if not len(taken_um) or _has_formula(n, numbers):
        _phases(n, float(step), ts, numbers, value)
        sines(value)
        _scale(n, numbers, value)
        if rising:
            _rise(n, step, rises, numbers, value)
    if len(taken_um):
        _take(n, row, numbers, taken_um, value)


@njit(cache=True)
def _has_formula(n: int, numbers: Array) -> bool:
    """Whether a lane of a block has a sine that is had by formula, not from a table."""
    count = 0
    for b in range(numbers.shape[2]):
        count += 0 if np.isnan(numbers[n, OMEGA, b]) else 1
    return count > 0


class Drawn(NamedTuple):
    """Draws of m episodes."""

    factors: Array  # float64[m, K]: of the core's numbers; empty without randomisation
    levels: Integers  # int64[m, L]: of the effects' parameters; empty without randomisation
    choice: Integers  # int64[m]: of the references
    position: Array  # float64[m]: between the lowest and the highest frequency
    signal_seed: Integers  # int64[m]
    noise_seed: Words  # uint64[m]
    life: Array  # float64[m]: share of it that a plant has lived; empty without ageing
    change: Array  # float64[m, 2]: first sample, in steps, and place of the fraction; empty without


# Columns of a wave. In one that may be drawn NaN stands for what each episode draws.
SHAPE = 0  # one of the following
FREQUENCY = 1  # Hz
ANGLE = 2  # phase (rad)
HEIGHT = 3  # amplitude (µm)
MIDDLE = 4  # µm
START = 5  # row of its smooth start
SEED = 6  # of the phases of a multisine
LINES = 7  # how many it has
APART = 8  # multiples of the frequency between two of them
PER_PEAK = 9  # one over the largest size of their sum
FIRST = 10  # sample at which its table begins, where Python samples it
COLUMNS = 11  # from here on the phases of the lines (rad)

# Shapes: where all are sines they are had sample by sample, otherwise some samples at a time; the last
# shape is of a table that Python fills.
SINE, TRIANGLE, MULTISINE, SAMPLED = 0.0, 1.0, 2.0, 3.0

AHEAD = 64
"""Samples that are had at a time."""
# A grid of so many points to the period of the highest line misses at most 2 % of a peak.
_POINTS, _NEAR, _NEWTON = 16, 0.98, 4


@njit(cache=True)
def _place_wave(
    low_hz: float, high_hz: float, table: Array, choice: int, position: float, seed: int,
    wave: Array,
) -> None:  # fmt: skip
    """Draw what is left to draw of a wave."""
    row = min(choice, len(table) - 1)
    for i in range(COLUMNS):
        wave[i] = table[row, i]
    if np.isnan(wave[FREQUENCY]):
        wave[FREQUENCY] = low_hz
        if low_hz < high_hz:
            wave[FREQUENCY] = low_hz * (high_hz / low_hz) ** position
    if np.isnan(wave[SEED]):
        wave[SEED] = float(seed)
    if wave[SHAPE] == MULTISINE:
        draw_lines(wave)


@njit(cache=True)
def draw_lines(wave: Array) -> None:
    """Draw the phases of a multisine, and find its peak."""
    phases = wave[COLUMNS : COLUMNS + int(wave[LINES])]
    rng = np.empty(4, dtype=np.uint64)
    seed_generator(np.uint64(wave[SEED]), rng)
    for i in range(len(phases)):
        phases[i] = 2.0 * np.pi * next_uniform(rng)
    wave[PER_PEAK] = 1.0 / _peak(phases, wave[APART])


@njit(cache=True)
def make_turns(columns: int) -> Array:
    """Return room for what :func:`fill_wave` keeps from lane to lane, of waves of so many columns."""
    turns = np.zeros((2 + 4 * max(1, columns - COLUMNS), AHEAD))
    for j in range(AHEAD):
        turns[1, j] = float(j)
    return turns


@njit(cache=True)
def fill_wave(
    wave: Array, table_um: Array, first: int, ts_s: float, rises: Array, turns: Array,
    samples_um: Array,
) -> None:  # fmt: skip
    """Take samples (µm) of a wave."""
    if wave[SHAPE] == SAMPLED:
        begin, last = first - int(wave[FIRST]), len(table_um) - 1
        for k in range(len(samples_um)):
            samples_um[k] = table_um[min(begin + k, last)]
        return
    if wave[SHAPE] == SINE:
        _sine(wave, float(first), ts_s, samples_um)
    lines = int(wave[LINES])
    if lines and (
        turns[0, 0] != wave[FREQUENCY] or turns[0, 1] != wave[APART] or turns[0, 2] < lines
    ):
        _keep_turns(wave, ts_s, turns)
    for begin in range(0, len(samples_um), AHEAD):
        samples = samples_um[begin : begin + AHEAD]
        if lines:
            _multisine(wave, ts_s * (first + begin), turns, samples)
        elif wave[SHAPE] == TRIANGLE:
            _triangle(wave, float(first + begin), ts_s, turns[1], samples)
    rise, last = rises[int(wave[START])], rises.shape[1] - 1
    if first < last:
        for k in range(len(samples_um)):
            samples_um[k] *= rise[min(first + k, last)]


@njit(cache=True)
def _sine(wave: Array, first: float, ts_s: float, samples_um: Array) -> None:
    """Samples by the operations of the formula, in their order."""
    omega, phase, height, middle = _omega(wave), wave[ANGLE], wave[HEIGHT], wave[MIDDLE]
    for k in range(len(samples_um)):
        samples_um[k] = omega * (ts_s * (first + float(k))) + phase
    sines(samples_um)
    for k in range(len(samples_um)):
        samples_um[k] = middle + height * samples_um[k]


@njit(cache=True)
def _omega(wave: Array) -> float:
    omega: float = 2.0 * np.pi * wave[FREQUENCY]
    return omega


@njit(cache=True)
def _triangle(wave: Array, first: float, ts_s: float, count: Array, samples_um: Array) -> None:
    begin = wave[ANGLE] / (2.0 * np.pi) + 0.25
    frequency, middle, height = wave[FREQUENCY], wave[MIDDLE], wave[HEIGHT]
    for k in range(len(samples_um)):
        cycles = frequency * (ts_s * (first + count[k])) + begin
        part = cycles - np.floor(cycles)
        samples_um[k] = middle + height * (1.0 - 4.0 * abs(part - 0.5))


@njit(cache=True)
def _rate(wave: Array, i: int) -> float:
    """Rate of phase of a line (rad/s)."""
    rate: float = 2.0 * np.pi * wave[FREQUENCY] * (1.0 + i * wave[APART])
    return rate


@njit(cache=True)
def _keep_turns(wave: Array, ts_s: float, turns: Array) -> None:
    """Keep sine and cosine of what each line turns within a stretch, below two rows of their own."""
    lines = int(wave[LINES])
    for i in range(lines):
        sine, cosine = turns[2 + 2 * i], turns[3 + 2 * i]
        for j in range(AHEAD):
            sine[j] = _rate(wave, i) * (ts_s * turns[1, j])
            cosine[j] = sine[j] + 0.5 * np.pi
        sines(sine)
        sines(cosine)
    turns[0, 0], turns[0, 1], turns[0, 2] = wave[FREQUENCY], wave[APART], float(lines)


@njit(cache=True)
def _multisine(wave: Array, first_s: float, turns: Array, samples_um: Array) -> None:
    lines = int(wave[LINES])
    now = turns[len(turns) - 2 * (-(-lines // AHEAD)) :].reshape(-1)
    sine, cosine = now[:lines], now[lines : 2 * lines]
    for i in range(lines):
        sine[i] = _rate(wave, i) * first_s + wave[COLUMNS + i]
        cosine[i] = sine[i] + 0.5 * np.pi
    sines(sine)
    sines(cosine)
    height = wave[HEIGHT] * wave[PER_PEAK]
    samples_um[:] = wave[MIDDLE]
    for i in range(lines):
        _add_line(height * sine[i], height * cosine[i], turns, 2 + 2 * i, samples_um)


@njit(cache=True)
def _add_line(sine: float, cosine: float, turns: Array, row: int, total: Array) -> None:
    for j in range(len(total)):
        total[j] += sine * turns[row + 1, j] + cosine * turns[row, j]


@njit(cache=True)
def _peak(phases: Array, apart: float) -> float:
    """Return the largest size of a sum of sines: on a grid, sharpened by Newton's method."""
    highest = 1.0 + (len(phases) - 1) * apart
    points = _POINTS * int(highest)
    size, line = np.zeros(points), np.empty(points)
    for i in range(len(phases)):
        for j in range(points):
            line[j] = 2.0 * np.pi * (1.0 + i * apart) * j / points + phases[i]
        sines(line)
        size += line
    size = np.abs(size)
    peak = size.max()
    least = _NEAR * peak
    for j in range(points):
        if size[j] < least or size[j] < size[j - 1] or size[j] < size[(j + 1) % points]:
            continue
        x = 2.0 * np.pi * j / points
        for _ in range(_NEWTON):
            slope = curvature = 0.0
            for i in range(len(phases)):
                harmonic = 1.0 + i * apart
                angle = harmonic * x + phases[i]
                slope += harmonic * math.cos(angle)
                curvature -= harmonic**2 * math.sin(angle)
            x -= slope / curvature
        value = 0.0
        for i in range(len(phases)):
            value += math.sin((1.0 + i * apart) * x + phases[i])
        peak = max(peak, abs(value))
    return float(peak)


@njit(cache=True)
def _fetch_samples(
    n: int, b: int, ahead: int, numbers: Array, waves: Array, tables_um: Array
) -> None:
    """Fetch the samples of a lane whose reference is no wave, for the step that takes them."""
    lane = n * numbers.shape[2] + b
    if waves[lane, SHAPE] == SAMPLED:
        begin = ahead - int(numbers[n, BEGUN, b]) - int(waves[lane, FIRST])
        first = tables_um.ctypes.data + FLOAT64 * (lane * tables_um.shape[1] + begin)
        for place in range(0, FLOAT64 * AHEAD + LINE, LINE):
            fetch_line(first + place)


@njit(cache=True)
def sample_ahead(
    n: int, ahead: int, ts_s: float, numbers: Array, rises: Array, waves: Array, tables_um: Array,
    ahead_um: Array,
) -> None:  # fmt: skip
    """Take the samples of a block's waves from a step on that is its first row's."""
    width = ahead_um.shape[2]
    samples, turns = np.empty(AHEAD), make_turns(waves.shape[1])
    end = min(width, len(waves) - n * width)
    for b in range(end):
        fetch_rows(n, 0, b, end, ahead_um)
        if b + 1 < end:
            _fetch_samples(n, b + 1, ahead, numbers, waves, tables_um)
        wave = waves[n * width + b]
        if wave[SHAPE] == SINE and not np.isnan(numbers[n, OMEGA, b]):
            continue
        own = tables_um[n * width + b if wave[SHAPE] == SAMPLED else 0]
        fill_wave(wave, own, ahead - int(numbers[n, BEGUN, b]), ts_s, rises, turns, samples)
        for k in range(AHEAD):
            ahead_um[n, k, b] = samples[k]


@njit(cache=True)
def begin_waves(
    first: int, end: int, step: int, share: int, indices: Integers, low_hz: float, high_hz: float,
    table: Array, choice: Integers, position: Array, seed: Integers, ts_s: float, rises: Array,
    numbers: Array, waves: Array, tables_um: Array, ahead_um: Array, first_um: Array,
) -> None:  # fmt: skip
    """Choose the waves of lanes that begin, and sample those that are no sines."""
    width, shown = ahead_um.shape[2], first_um.shape[1]
    samples, turns = np.empty(shown + AHEAD), make_turns(waves.shape[1])
    for j in range(first, end):
        lane = indices[j]
        wave, n, b = waves[lane], lane // width, lane % width
        _place_wave(low_hz, high_hz, table, choice[j], position[j], seed[j], wave)
        # Beside waves of other shapes a sine is had some samples at a time as well.
        formula = wave[SHAPE] == SINE and not len(first_um)
        numbers[0, OMEGA, j] = _omega(wave) if formula else np.nan
        numbers[0, PHASE, j] = wave[ANGLE]
        numbers[0, AMPLITUDE, j], numbers[0, CENTRE, j] = wave[HEIGHT], wave[MIDDLE]
        numbers[0, RISE, j] = wave[START]
        if formula:
            continue
        row = table_row(n, share, step + shown, AHEAD)
        left = AHEAD - row if row else 0
        own = tables_um[lane if wave[SHAPE] == SAMPLED else 0]
        fill_wave(wave, own, np.int64(0), ts_s, rises, turns, samples[: shown + left])
        for k in range(shown):
            first_um[0, k, j] = samples[k]
        for k in range(left):
            ahead_um[n, row + k, b] = samples[shown + k]
