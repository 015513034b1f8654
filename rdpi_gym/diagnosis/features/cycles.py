"""Half-cycles and steady periods of a command."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.measurement import Record
from rdpi_gym.support.arrays import Array

SMALLEST_SWING = 0.04
"""A reversal counts where the command then moves by this share of its peak to peak or more."""

# Of another size by this share of the usual one; fewer are how a record begins and ends.
_OTHER, _FEWEST_OTHERS = 0.1, 3

Values = TypeVar("Values", np.float64, np.bool_, np.intp)


@dataclass(frozen=True, eq=False)
class HalfCycles:
    """Stretches of a record from one reversal of the command to the next, H of them.

    Every stretch has a direction. Frequency and amplitude are NaN for the first and the last,
    which begin or end where the record does and not at a reversal, and for stretches in which
    the command mostly rests (steps and holds).

    Parameters
    ----------
    edges
        ``intp[H + 1]``; stretch h holds the samples ``edges[h]`` to ``edges[h + 1] - 1``, the
        last of which is the reversal.
    rising
        ``bool[H]``; whether the command rises.
    frequency_hz
        ``float64[H]``; one over twice the duration (Hz).
    amplitude_V
        ``float64[H]``; half of the way between the two reversals (V).
    """

    edges: NDArray[np.intp]
    rising: NDArray[np.bool_]
    frequency_hz: Array
    amplitude_V: Array

    @property
    def whole(self) -> NDArray[np.bool_]:
        """``bool[H]``: moving from reversal to reversal, so that it has a frequency."""
        return np.isfinite(self.frequency_hz)

    def spans(self, x: Array) -> Array:
        """Return by how much a trace, ``(N,)``, changes over each stretch, ``(H,)``."""
        return np.abs(np.diff(x[np.maximum(self.edges - 1, 0)]))

    def by_sample(self, values: NDArray[Values]) -> NDArray[Values]:
        """Repeat a value of every stretch, ``(H,)``, for each of its samples, ``(N,)``."""
        return np.repeat(values, np.diff(self.edges))


def half_cycles(u_V: Array, ts_s: float) -> HalfCycles:
    """Cut a command at its reversals.

    Parameters
    ----------
    u_V
        Command (V), ``(N,)``.
    ts_s
        Sampling time (s).

    Returns
    -------
    HalfCycles
        Swings below `SMALLEST_SWING` of the command's peak to peak are ripple and no stretch of
        their own.

    Examples
    --------
    >>> t = np.arange(2000) * 1e-3
    >>> cycles = half_cycles(5.0 * np.sin(2 * np.pi * 3.0 * t), 1e-3)
    >>> cycles.frequency_hz[1:3].round(3).tolist(), cycles.amplitude_V[1:3].round(3).tolist()
    ([3.0, 3.0], [5.0, 5.0])
    """
    u = np.ascontiguousarray(u_V, dtype=np.float64)
    turns, rises_first = _reversals(u, SMALLEST_SWING * float(np.ptp(u)))
    count = turns.size + 1
    frequency_hz, amplitude_V = np.full(count, np.nan), np.full(count, np.nan)
    if turns.size > 1:
        times, extrema = _vertices(u, turns)
        frequency_hz[1:-1] = 0.5 / (np.diff(times) * ts_s)
        amplitude_V[1:-1] = 0.5 * np.abs(np.diff(extrema))
    edges = np.concatenate([[0], turns + 1, [u.size]]).astype(np.intp)
    resting = _resting(u, edges)
    frequency_hz[resting], amplitude_V[resting] = np.nan, np.nan
    rising = (np.arange(count) % 2 == 0) == rises_first
    return HalfCycles(edges, rising, frequency_hz, amplitude_V)


@njit(cache=True)
def _reversals(u: Array, swing: float) -> tuple[NDArray[np.intp], bool]:
    """Samples at which the command turned, and whether it rose first."""
    turns = np.empty(u.shape[0], dtype=np.intp)
    count = 0
    low = high = 0
    direction = 0
    rises_first = u[-1] >= u[0]
    for k in range(1, u.shape[0]):
        if u[k] > u[high]:
            high = k
        if u[k] < u[low]:
            low = k
        if direction <= 0 and u[k] - u[low] >= swing and u[k] > u[low]:
            if direction == 0:
                rises_first = True
            else:
                turns[count] = low
                count += 1
            direction, high = 1, k
        elif direction >= 0 and u[high] - u[k] >= swing and u[high] > u[k]:
            if direction == 0:
                rises_first = False
            else:
                turns[count] = high
                count += 1
            direction, low = -1, k
    return turns[:count].copy(), rises_first


@njit(cache=True)
def _resting(u: Array, edges: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Stretches that spend a third of their time within 2 % of their way (a sine: 9 %)."""
    resting = np.zeros(edges.shape[0] - 1, dtype=np.bool_)
    for h in range(resting.shape[0]):
        first, last = edges[h], edges[h + 1] - 1
        start = u[max(first - 1, 0)]
        way = u[last] - start
        count = np.zeros(51, dtype=np.int64)
        for k in range(first, last + 1):
            progress = (u[k] - start) / way if way != 0.0 else 0.0
            count[min(max(int(50.0 * progress), 0), 50)] += 1
        longest = max(count.max(), count[49] + count[50])
        resting[h] = longest > max(3, (last + 1 - first) // 3)
    return resting


def _vertices(u: Array, turns: NDArray[np.intp]) -> tuple[Array, Array]:
    """Vertex of the parabola through a reversal and its two neighbours: sample, command."""
    before, at, after = u[turns - 1], u[turns], u[turns + 1]
    slope, bend = 0.5 * (after - before), before - 2.0 * at + after
    shift = np.divide(-slope, bend, out=np.zeros_like(bend), where=bend != 0.0)
    shift = np.clip(shift, -0.5, 0.5)
    return turns.astype(np.float64) + shift, at + slope * shift + 0.5 * bend * shift * shift


def crossing(u: Array, y: Array, level: float) -> tuple[float, float] | None:
    """Return the displacement where a stroke passes a command, and the command's step there."""
    at = int(np.argmax(u >= level)) if u[-1] > u[0] else int(np.argmax(u <= level))
    if at == 0 or u[at] == u[at - 1]:
        return None
    share = (level - u[at - 1]) / (u[at] - u[at - 1])
    return float(y[at - 1] + share * (y[at] - y[at - 1])), float(abs(u[at] - u[at - 1]))


def vary(values: Array) -> bool:
    """Whether sizes or paces of half-cycles differ, more than a record's beginning and end make them."""
    usual = np.median(values)
    return int((np.abs(values - usual) > _OTHER * usual).sum()) >= _FEWEST_OTHERS


_ALIKE = 2e-3  # of the power: two periods differ by no more
_APART = 0.3  # of the power: a lag has left the neighbourhood of zero
_SHORTEST = 16
_COUNT = 0.9  # of a period's samples
_CYCLES_ALIKE = 0.015  # of a cycle's span and length
_MAINS_HZ = (50.0, 60.0)

Complexes = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Periods:
    """A stretch of steady periods: K of them, of P samples each."""

    record: Record  # where they stand
    first: int  # sample at which the first of them begins
    length: float  # p; not always whole
    count: int  # k, three or more

    @property
    def frequency_hz(self) -> float:
        """Periods a second (Hz)."""
        return 1.0 / (self.length * self.record.ts_s)

    @property
    def part(self) -> slice:
        """Samples that the periods cover."""
        return slice(self.first, self.first + int(self.length * self.count))

    def folded(self, x: Array) -> Array:
        """Lay a trace of the record, ``(N,)``, period under period, ``(K, M)`` with M even."""
        points = 2 * round(0.5 * self.length)
        if points == self.length:
            return x[self.first : self.first + points * self.count].reshape(self.count, points)
        at = self.first + self.length * np.arange(self.count * points) / points
        rows: Array = np.interp(at, np.arange(x.size), x).reshape(self.count, points)
        return rows


def steady_periods(record: Record, cycles: HalfCycles) -> Periods | None:
    """Find where a record's command repeats itself."""
    if record.is_quiet:
        return None
    length = _period(record.u_V)
    if length is not None:
        # the last sample may close the last period
        count = int((record.u_V.size - 1 + 1e-6) / length)
        if length == round(length) and record.u_V.size % int(length) == 0:
            count = record.u_V.size // int(length)
        return Periods(record, 0, length, count) if count >= 3 else None
    return _equal_loops(record, cycles)


def counted_periods(periods: Periods, counted: NDArray[np.bool_]) -> Periods | None:
    """Return the longest run of periods that count; None with fewer than three."""
    edges = periods.first + np.round(periods.length * np.arange(periods.count + 1)).astype(np.intp)
    shares = np.add.reduceat(counted.astype(np.float64), edges[:-1]) / np.diff(edges)
    if edges[-1] < counted.size:  # the last piece ran on to the end of the record
        shares[-1] = float(counted[edges[-2] : edges[-1]].mean())
    first, last = longest_run(shares > _COUNT)
    count = last - first
    return replace(periods, first=int(edges[first]), count=count) if count >= 3 else None


def _period(u: Array) -> float | None:
    """Smallest lag (samples) at which a command is itself again, over the whole of it."""
    x = u - u.mean()
    size, longest = x.size, x.size // 3 + 1
    if longest <= _SHORTEST:
        return None
    spectrum = np.fft.rfft(x, 2 * size)
    products = np.fft.irfft(np.abs(spectrum) ** 2)[:size]
    squares = np.concatenate([[0.0], np.cumsum(x * x)])
    lag = np.arange(size)
    power = squares[size - lag] + squares[-1] - squares[lag]
    apart = 1.0 - 2.0 * products / np.maximum(power, 1e-300)
    away = np.flatnonzero(apart[:longest] > _APART)
    if not away.size:
        return None
    k = np.arange(max(_SHORTEST, int(away[0])), longest)
    before, here, after = apart[k - 1], apart[k], apart[k + 1]
    bend = np.maximum(before - 2.0 * here + after, 1e-300)
    # where the parabola through three lags turns: a period need not be a whole number of samples
    turn = here - (before - after) ** 2 / (8.0 * bend)
    lowest = (here <= before) & (here <= after) & (turn < _ALIKE)
    if not lowest.any():
        return None
    length = float(k[lowest][0])
    for times in range(1, max(2, int(size / 1.5 / length) + 1)):
        near = round(times * length)
        if near + 2 >= size or times * length > 0.67 * size:
            break
        at = near - 1 + int(np.argmin(apart[near - 1 : near + 2]))
        before, here, after = apart[at - 1 : at + 2]
        bend = before - 2.0 * here + after
        shift = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
        length = (at + float(np.clip(shift, -0.5, 0.5))) / times
    whole = round(length)
    # a command that was generated repeats after a whole number of samples exactly
    return float(whole) if abs(length - whole) < 2e-4 * length and apart[whole] < 1e-9 else length


def _equal_loops(record: Record, cycles: HalfCycles) -> Periods | None:
    """Longest run of loops between the same two commands, in the same time."""
    edges, u = cycles.edges, record.u_V
    span = cycles.spans(u)
    steps = np.diff(edges).astype(np.float64)
    # strokes that are as wide as the one before and take as long as the one before that
    h = np.arange(3, max(span.size - 1, 3))
    alike = (np.abs(span[h] - span[h - 1]) < _CYCLES_ALIKE * span[h]) & cycles.whole[h]
    alike &= np.abs(steps[h] - steps[h - 2]) <= np.maximum(1.5, _CYCLES_ALIKE * steps[h])
    start, stop = longest_run(alike)
    if start == stop:
        return None
    first, last = int(h[start]) - 2, int(h[stop - 1]) + 1
    count = (last - first) // 2
    if count < 3:
        return None
    begin, end = edges[first] - 1, edges[first + 2 * count] - 1
    found = Periods(record, int(begin), float(end - begin) / count, count)
    rows = found.folded(u)
    # loops that drift apart, as of a chirp, are alike only from one to the next
    return found if np.mean(np.var(rows, axis=0)) < _ALIKE * np.var(rows) else None


@dataclass(frozen=True, eq=False)
class Harmonics:
    """Fourier coefficients of a periodic trace, h = 0 ... H - 1 times the basic frequency."""

    # Mean over the periods, ``(H,)``; the amplitude of a harmonic is twice its modulus
    mean: Complexes
    noise: Array  # power of the mean's noise, ``(H,)``, from how the periods differ

    def rms(self, orders: NDArray[np.intp]) -> tuple[float, float]:
        """Root mean square of some harmonics, noise taken off, and its standard error at zero."""
        if not orders.size:
            return 0.0, 0.0
        power = 2.0 * float(np.sum(np.abs(self.mean[orders]) ** 2))
        noise = 2.0 * float(np.sum(self.noise[orders]))
        return float(np.sqrt(max(power - noise, 0.0))), float(np.sqrt(noise / np.sqrt(orders.size)))


def harmonics(periods: Periods, x: Array, skip: int = 1) -> Harmonics:
    """Fourier coefficients of a trace over steady periods, slow drift taken out."""
    rows = periods.folded(x)
    count, points = rows.shape
    flat = rows.ravel()
    # the mean over a period around each point holds drift and no harmonic
    sums = np.concatenate([[0.0], np.cumsum(flat)])
    half = points // 2
    centre = np.arange(half, flat.size - half)
    means = (
        sums[centre + half]
        - sums[centre - half]
        + 0.5 * (flat[np.minimum(centre + half, flat.size - 1)] - flat[centre - half])
    )
    slow = _extended(means / points, half, points)
    kept = (flat - slow).reshape(count, points)[min(skip, count - 2) :]
    each = np.fft.rfft(kept, axis=1) / points
    mean = each.mean(axis=0)
    spread = np.sum(np.abs(each - mean) ** 2, axis=0) / max(len(each) - 1, 1)
    return Harmonics(mean, spread / len(each))


def _extended(means: Array, half: int, points: int) -> Array:
    """Running means carried on to both ends with the slope of the nearest period."""
    step = min(points, means.size - 1)
    first, last = (means[step] - means[0]) / step, (means[-1] - means[-1 - step]) / step
    before = means[0] + first * np.arange(-half, 0)
    after = means[-1] + last * np.arange(1, half + 1)
    return np.concatenate([before, means, after])


def orders_off_mains(periods: Periods, orders: NDArray[np.intp]) -> NDArray[np.intp]:
    """Harmonic orders whose frequency is no multiple of 50 or 60 Hz, as far as the stretch resolves."""
    frequency = orders * periods.frequency_hz
    resolution = periods.frequency_hz / periods.count
    clear = np.ones(orders.size, dtype=np.bool_)
    for mains in _MAINS_HZ:
        nearest = np.round(frequency / mains)
        clear &= (np.abs(frequency - nearest * mains) > resolution) | (nearest == 0)
    return orders[clear]


BoolArray = NDArray[np.bool_]


def runs(at: BoolArray) -> list[tuple[int, int]]:
    """Return where a condition holds without a break: first sample, and one past the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], at, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def longest_run(at: BoolArray) -> tuple[int, int]:
    """Return the longest of them, the first of several; an empty one where there is none."""
    return max(runs(at), key=lambda run: run[1] - run[0], default=(0, 0))


def widened(at: BoolArray, margin: int) -> BoolArray:
    """Widen a mask by some samples to either side."""
    wide = at.copy()
    for shift in range(1, margin + 1):
        wide[shift:] |= at[:-shift]
        wide[:-shift] |= at[shift:]
    return wide


def bridged(x: Array, bad: BoolArray) -> Array:
    """Carry a trace across the samples that are no measurement, in straight lines."""
    if not bad.any() or bad.all():
        return x
    k = np.arange(x.size)
    patched = x.copy()
    patched[bad] = np.interp(k[bad], k[~bad], x[~bad])
    return patched


def smallest_step(x: Array) -> float:
    """Return the smallest change from sample to sample: the step of a recorder that is coarse."""
    if x.size < 2:
        return 0.0
    steps = np.abs(np.diff(x))
    moved = steps[steps > 1e-9 * max(float(np.ptp(x)), 1e-300)]
    return float(moved.min()) if moved.size else 0.0


def gain(u: Array, y: Array) -> float:
    """Return the size of the response over the command, whatever single samples say, with its sign."""
    low, high = np.quantile(y, (0.02, 0.98))
    swing = float(np.ptp(u))
    if swing == 0.0:
        return 0.0
    moment = float(np.mean((u - u.mean()) * (np.clip(y, low, high) - np.median(y))))
    return float(np.sign(moment)) * float(high - low) / swing
