"""The noise floor: how much of a record no model can explain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.diagnosis.features.cycles import half_cycles, steady_periods
from rdpi_gym.diagnosis.notices import Statement, statement
from rdpi_gym.measurement import Record, longest_counted
from rdpi_gym.support.arrays import Array

_FEWEST = 64
_MAINS_HZ = (50.0, 60.0)
_CYCLES = 20.0
_COLOURED = 1.1
_ALIKE = 1.05
# Of what repetitions differ by, what their commands may differ by.
_SAME_COMMAND = 0.3
# A level between spectral lines counts where it is this much lower than that of differences.
_LINES = 0.8
# Noise is slower than white where differences over more samples grow, ever less, to a level.
_STRIDES, _GROWS, _LEVEL, _SLOWEST = (1, 2, 4, 8), 1.05, 0.12, 2.0
_SLOWEST_SEEN = 4.0  # times white noise, in quiet records and repetitions
_MOST = 40_000
_UNLIKE = 5.0  # times what repetitions usually differ by
# Samples for one independent value: the median of third differences of white noise is known to 2.13
# times what its standard deviation would be.
_SAMPLES_EACH = 4.5
_EXACT = 1e-6  # of the stroke: so little is no difference


def rough_part(x: Array) -> float:
    """Standard deviation of what changes from sample to sample, as if it were white noise.

    Notes
    -----
    Third differences, the weights 1, -3, 3, -1: a cubic leaves none (von Neumann's estimator,
    carried to a higher difference). The median keeps jumps out. Lines, such as those of the mains
    at a low sampling rate, are rough too: where the level between the lines of the upper half of
    the spectrum is clearly lower, that is the noise.
    """
    third = _third(x, 1)
    between = _between_lines(x)
    return between if between < _LINES * third else third


def _third(x: Array, stride: int) -> float:
    """Standard deviation of white noise that has such third differences over a stride."""
    third = x[3 * stride :] - 3.0 * x[2 * stride : -stride] + 3.0 * x[stride : -2 * stride]
    third = third - x[: -3 * stride]
    return float(np.median(np.abs(third)) / 0.6744897501960817 / math.sqrt(20.0))


def _between_lines(x: Array) -> float:
    """Standard deviation of white noise with the median of the upper half of a spectrum."""
    if x.size < _FEWEST:
        return math.inf
    window = np.hanning(x.size)
    power = np.abs(np.fft.rfft((x - x.mean()) * window)) ** 2 / float(window @ window)
    upper = power[power.size // 2 :]
    return math.sqrt(float(np.median(upper)) / math.log(2.0))


def repeat_noise(record: Record) -> float | None:
    """Standard deviation (µm) of the noise in which the repetitions of a record differ."""
    spread = _spread(record)
    return None if spread is None else _rms(spread)


def _spread(record: Record) -> Array | None:
    """Second differences of neighbouring repetitions as of white noise, ``(K, M)``, or None.

    None where their commands differ as much, or first differences are larger: noise has no memory from
    one repetition to the next, creep and drift have.
    """
    found = _repetitions(record)
    if found is None:
        return None
    starts, length = found
    measured, commands = (
        np.stack([x[start : start + length] for start in starts]) for x in (record.y_um, record.u_V)
    )
    if len(measured) > 2:
        # a repetition that is unlike all the others, a sensor that settles, tells no noise
        apart = np.std(_apart(measured, np.median(measured, axis=0)), axis=1)
        alike = apart <= max(_UNLIKE * float(np.median(apart)), _EXACT * float(np.ptp(measured)))
        measured, commands = measured[alike], commands[alike]
    if len(measured) < 3:
        return None
    first, spread = (_neighbours(measured, order) for order in (1, 2))
    if _rms(first) > _ALIKE * _rms(spread):
        return None
    of_commands = _neighbours(commands, 2)
    # a slow chirp has periods that are nearly alike: what they differ by is no noise
    gain = float(np.std(record.y_um)) / max(float(np.std(record.u_V)), 1e-300)
    return (
        None
        if gain * float(np.std(of_commands)) > _SAME_COMMAND * float(np.std(spread))
        else spread
    )


def _neighbours(rows: Array, order: int) -> Array:
    """Differences of neighbouring repetitions, as large as the noise of one."""
    return _apart(np.diff(rows, order, axis=0) / math.sqrt(math.comb(2 * order, order)), 0.0)


def _apart(rows: Array, usual: Array | float) -> Array:
    """Differences of repetitions from the usual one, offset and slope removed."""
    x = np.linspace(-1.0, 1.0, rows.shape[1])
    differ = rows - usual
    differ = differ - differ.mean(axis=1, keepdims=True)
    return np.asarray(differ - np.outer(differ @ x / (x @ x), x))


def _repetitions(record: Record) -> tuple[NDArray[np.intp], int] | None:
    if record.period is None:
        found = steady_periods(record, half_cycles(record.u_V, record.ts_s))
        if found is None or found.length < _FEWEST:
            return None
        # cut, not interpolated: interpolation would smooth the noise
        starts = (found.first + np.round(found.length * np.arange(1, found.count))).astype(np.intp)
        length = int(found.length)
    else:
        runs = [np.flatnonzero(record.period == p) for p in np.unique(record.period)][1:]
        if len(runs) < 2:
            return None
        starts = np.array([run[0] for run in runs])
        length = min(map(len, runs))
    if len(starts) < 2 or length < _FEWEST:
        return None
    return starts, length


def flattened(record: Record) -> Array:
    """A quiet record without what drift, creep and the mains leave in it."""
    counted = longest_counted(record) or record
    t = counted.t_s[:_MOST] - counted.t_s[:_MOST].mean()
    x = t / max(float(np.max(np.abs(t))), 1e-300)
    measured = counted.y_um[:_MOST]
    slow = np.polynomial.polynomial.polyfit(x, measured, 3)
    y = measured - np.polynomial.polynomial.polyval(x, slow)
    duration = 2.0 * float(np.max(np.abs(t)))
    for mains in _MAINS_HZ:
        for f in (mains, 2.0 * mains, 3.0 * mains):
            if f * record.ts_s < 0.45 and f * duration > _CYCLES:
                y = y - _line(t, y, f, duration)
    return np.asarray(y)


def _line(t: Array, y: Array, frequency_hz: float, duration_s: float) -> Array:
    """The strongest sine of a trace within 1 % of a frequency."""
    step = 0.25 / duration_s
    steps = max(1, math.ceil(0.01 * frequency_hz / step))
    coarse = frequency_hz + step * np.arange(-steps, steps + 1)
    near = coarse[int(np.argmax([_sine(t, y, f)[1] for f in coarse]))]
    fine = near + step * np.linspace(-1.0, 1.0, 21)
    lines = [_sine(t, y, f) for f in fine]
    return max(lines, key=lambda line: line[1])[0]


def _sine(t: Array, y: Array, frequency_hz: float) -> tuple[Array, float]:
    """Sine of a frequency that fits a trace best, and its power."""
    waves = np.column_stack(
        [np.cos(2.0 * np.pi * frequency_hz * t), np.sin(2.0 * np.pi * frequency_hz * t)]
    )
    line = waves @ np.linalg.solve(waves.T @ waves, waves.T @ y)
    return line, float(line @ line)


def slowness(residuals: Sequence[Array]) -> float:
    """Return how much slower than white the noise is that residuals hold, 1 for white noise."""
    long = [x for x in residuals if x.size >= _FEWEST]
    if not long:
        return 1.0
    squares = [[_third(x, stride) ** 2 for stride in _STRIDES] for x in long]
    levels = np.sqrt(np.average(squares, axis=0, weights=[x.size for x in long]))
    if levels[0] <= 0.0:
        return 1.0
    ratios = levels[1:] / levels[:-1]
    ends = ratios[0] > max(ratios[1], ratios[2]) and abs(ratios[2] - 1.0) < _LEVEL
    if ratios[0] < _GROWS or not ends:
        return 1.0
    return min(float(np.mean(levels[-2:]) / levels[0]), _SLOWEST)


@dataclass(frozen=True)
class _Level:
    value_um: float
    samples: int
    origin: Statement
    each: float = 1.0  # Samples that tell as much as one whose noise is seen as it is


@dataclass(frozen=True)
class MeasuredNoise:
    """Noise levels of quiet records and repetitions, and how much slower than white that noise is."""

    levels: tuple[_Level, ...]
    colours: tuple[float, ...]


def quiet_noise(quiet: Sequence[Record]) -> list[tuple[Array, str]]:
    """The noise (µm) in each quiet record that is long enough, and the record's name."""
    return [(flattened(r), r.name) for r in quiet if len(r.y_um) >= _FEWEST]


def measured_noise(still: Sequence[tuple[Array, str]], records: Sequence[Record]) -> MeasuredNoise:
    """Noise that quiet and other records show without a model."""
    spreads = [(spread, r.name) for r in records if (spread := _spread(r)) is not None]
    levels = [
        _Level(float(np.std(noise, ddof=4)), noise.size, statement("noise/quiet", record=name))
        for noise, name in still
    ]
    levels += [
        _Level(_rms(s), s.size, statement("noise/repetitions", record=name)) for s, name in spreads
    ]
    colours = [_slowness(noise) for noise, _ in still]
    colours = colours or [_slowness(spread.ravel()) for spread, _ in spreads]
    # what is many times slower than white is motion that comes now and then, and no noise
    return MeasuredNoise(tuple(levels), tuple(c for c in colours if c <= _SLOWEST_SEEN))


def rough_parts(residuals: Sequence[Array]) -> list[tuple[float, int]]:
    """The rough part of each residual that is long enough, and its samples."""
    return [(rough_part(e), len(e)) for e in residuals if len(e) >= _FEWEST]


def noise_floor(
    quiet: Sequence[Record], records: Sequence[Record], residuals: Sequence[Array]
) -> tuple[float, Statement]:
    """Noise of a data set (µm, rms) and where the figure comes from."""
    measured = measured_noise(quiet_noise(quiet), records)
    return floor_from(measured, rough_parts(residuals), slowness(residuals))


def floor_from(
    measured: MeasuredNoise, rough: Sequence[tuple[float, int]], colour: float
) -> tuple[float, Statement]:
    """Noise floor (µm, rms) and its origin; `colour` of the residuals counts where no record shows one."""
    alike = _alike(measured, rough, colour)
    if not alike:
        return 0.0, statement("noise/unknown")
    floor = math.sqrt(
        sum(level.samples * level.value_um**2 for level in alike)
        / sum(level.samples for level in alike)
    )
    most = max(alike, key=lambda level: level.samples)
    return floor, statement("noise", floor=floor, origin=most.origin)


def floor_spread(
    measured: MeasuredNoise, rough: Sequence[tuple[float, int]], colour: float
) -> float:
    """Relative standard error of the floor, as of the standard deviation of white noise."""
    counts = [level.samples / level.each for level in _alike(measured, rough, colour)]
    return 1.0 / math.sqrt(2.0 * sum(counts)) if counts else 0.0


def _alike(
    measured: MeasuredNoise, rough: Sequence[tuple[float, int]], colour: float
) -> list[_Level]:
    """Return the smallest level, and those that agree with it."""
    found = list(measured.levels)
    if measured.colours:
        colour = max(1.0, float(np.median(measured.colours)))
    if rough:
        origin = statement("noise/rough")
        if colour > _COLOURED:
            origin = statement("noise/coloured", colour=colour)
        typical = colour * float(np.median([value for value, _ in rough]))
        samples = sum(size for _, size in rough)
        found.append(_Level(typical, samples, origin, _SAMPLES_EACH))
    smallest = min((level.value_um for level in found), default=0.0)
    # what agrees with the smallest is averaged, so that chance does not choose
    return [level for level in found if level.value_um <= _ALIKE * smallest]


def _rms(spread: Array) -> float:
    """Standard deviation of noise from what repetitions differ by."""
    count, length = spread.shape
    return float(np.sqrt(np.sum(spread**2) / (count * (length - 2))))


def _slowness(noise: Array) -> float:
    """Standard deviation of noise over what white noise of its roughness would have."""
    rough = rough_part(noise)
    return float(np.std(noise)) / rough if rough > 0.0 else 1.0
