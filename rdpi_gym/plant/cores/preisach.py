"""Preisach model of relays with ramps (Krasnosel'skii-Pokrovskii): N levels cost N plays.

The relay of the switching values β <= α (V) with a ramp of width w (V) moves along a ramp about α
while the command rises, along one about β while it falls, and holds its output in between:

    R(t) = max(ρ(u(t) - α), min(ρ(u(t) - β), R(t-))),    ρ(x) = 2 x / w, held within -1 ... 1.

Max and min commute with the monotone ρ, so this is ρ of a play operator, exactly:

    R_αβ[u] = ρ(P_r[u] - m),    r = (α - β) / 2,    m = (α + β) / 2.

On N levels h apart the N (N + 1) / 2 relays have the N thresholds 0, h/2, h, 3h/2 ... only: all
relays of one diagonal of the triangle hang on one play, and N - 1 plays are the whole memory.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np
from numba import njit

from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.cores.families import set_numbers, settled_memory
from rdpi_gym.plant.cores.play import play
from rdpi_gym.plant.parameters import DataScale
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

# Levels of a fit's grid, the part of its gain that is reversible, and what c is at least there.
_LEVELS, _REVERSIBLE, _LEAST_C = 15, 0.3, 1e-6
# What an unevenness across the diagonals costs over one along them, squared in the price.
_ACROSS = 0.25
# How far levels may be from evenly spaced, over their distance.
_UNEVEN = 1e-6


# No reordering of sums: what a sample gives hangs on the command and the plays alone, however the
# record is cut into blocks.
@njit(cache=True, inline="always")
def _on_ramp(x: float, steep: float, cells: float) -> tuple[int, float]:
    """Nearest of a number of cells to a place in units of them, and how far up its ramp that is."""
    i = int(min(max(x + 0.5, 0.0), cells - 0.5))
    return i, min(max((x - i) * steep, -1.0), 1.0)


@njit(cache=True)
def _one_lane(u: Array, p: Array, state: Array, y: Array, b: int) -> None:
    # Whole arrays and a number: a view of each would cost as much as a sample.
    levels = (state.shape[0] - 4) // 2
    xi, held = 3, levels + 3  # rows before those of d = 1
    lowest, apart, steep, mark = p[1, b], p[2, b], p[3, b], p[4, b]
    offset = p[p.shape[0] - 1, b]
    half, per_volt = 0.5 * apart, 1.0 / apart
    # A command that rises pushes the plays of the smallest thresholds along, and these only: where
    # `way` is 1, plays 0 ... sliding - 1 are at last - r_d, and what xi says of them is old. What
    # the relays from diagonal d on add is in held + d for d >= known.
    sliding, last = int(abs(state[2, b])), state[3, b]
    way = 0 if sliding == 0 else (1 if state[2, b] > 0.0 else -1)
    sliding = max(sliding, 1)
    known = sliding
    if state[held, b] != mark:  # of another plant, or none yet
        known, state[held, b], state[held + levels, b] = levels, mark, 0.0
    for t in range(u.shape[0]):
        x = u[t, b]
        if (way > 0 and x < last) or (way < 0 and x > last):  # a turn: they stay where they are
            for d in range(1, sliding):
                state[xi + d, b] = last - way * (d * half)
            sliding, way = 1, 0
        if way == 0:
            if x - half >= state[xi + 1, b]:
                way = 1
            elif x + half <= state[xi + 1, b]:
                way = -1
        if way > 0:
            while sliding < levels and x - sliding * half >= state[xi + sliding, b]:
                sliding += 1
        elif way < 0:
            while sliding < levels and x + sliding * half <= state[xi + sliding, b]:
                sliding += 1
        known = max(known, sliding)
        while known > sliding:
            known -= 1
            cell = (state[xi + known, b] - lowest) * per_volt - 0.5 * known
            i, ramp = _on_ramp(cell, steep, levels - known)
            row = 5 + 2 * ((i + known) * levels + known)
            still, moves = p[row, b] - p[row - 2, b], p[row + 1, b] - p[row - 1, b]
            state[held + known, b] = state[held + known + 1, b] + (still + ramp * moves)
        last = x
        # All plays that slide are on the ramps of one switching value, the command's.
        i, ramp = _on_ramp((x - lowest) * per_volt, steep, levels)
        row = 5 + 2 * ((i + (levels if way < 0 else 0)) * levels + sliding - 1)
        y[t, b] = (
            p[0, b] * x + offset + (p[row, b] + ramp * p[row + 1, b]) + state[held + sliding, b]
        )
    state[2, b], state[3, b] = way * sliding, last


@njit(cache=True)
def preisach_block(u: Array, v: Array, p: Array, state: Array, y: Array) -> None:
    """Sum of the relays, in a time that hardly grows with their number while the command goes on.

    Rows of ``p``: c (µm/V), lowest level (V), distance h of two (V), 2 h over the ramp, a mark of
    the plant; then, for each switching value i and each number k of plays that slide there, two
    sums (µm) over the relays of diagonals 0 ... k - 1: those that are switched, and those on their
    ramps; once for rising (i of α) and once for falling (i of β); pole (unused), offset (µm).

    Rows of ``state`` from 2 on: how many plays slide with the command, negative while it falls;
    the last command (V); N - 1 plays (V) of the thresholds h/2, h, ... as a past of commands leaves
    them, neighbours at most h/2 apart, old where they slide; the mark of the plant whose N sums of
    held relays (µm) follow: where it is another's, they are made anew.
    """
    for b in range(u.shape[1]):
        _one_lane(u, p, state, y, b)


_TOGETHER = 5
"""First row of the tables, of which :func:`preisach_lanes` finds each lane's together."""


@njit(cache=True, inline="always")
def _switched(own: Array, b: int, row: int, plays: int, ramp: float) -> float:
    """Sum (µm) of the relays of so many plays that slide on one switching value."""
    at = row + 2 * (plays - 1)
    total: float = own[b, at] + ramp * own[b, at + 1]
    return total


@njit(cache=True, inline="always")
def _table_row(x: float, p: Array, b: int, way: int, levels: int) -> tuple[int, float]:
    """Place of a command's switching value among a lane's tables, and how far up its ramp that is."""
    i, ramp = _on_ramp((x - p[1, b]) * (1.0 / p[2, b]), p[3, b], levels)
    return 2 * levels * (i + (levels if way < 0 else 0)), ramp


@njit(cache=True)
def preisach_lanes(u: Array, v: Array, p: Array, state: Array, y: Array) -> None:
    """As :func:`preisach_block` for one sample of many lanes, of which any number may turn.

    Plays that stay where they are at a turn have been sliding on one switching value: what their
    relays add is a difference of two sums of its row.
    """
    lanes, last_row = u.shape[1], p.shape[0] - 1
    levels = (state.shape[0] - 4) // 2
    xi, held = 3, levels + 3
    own = p[_TOGETHER : last_row - 1].reshape(lanes, last_row - 1 - _TOGETHER)
    for b in range(lanes):
        if state[held, b] != p[4, b]:  # of another plant, or none yet
            _hold_all(p, own, state, b)
    for b in range(lanes):
        x, last, half = u[0, b], state[3, b], 0.5 * p[2, b]
        slides = int(state[2, b])
        way, sliding = (0 if slides == 0 else 1 if slides > 0 else -1), max(abs(slides), 1)
        known, row, ramp, total = sliding, 0, 0.0, 0.0
        if (way > 0 and x < last) or (way < 0 and x > last):
            row, ramp = _table_row(last, p, b, way, levels)
            total = state[held + sliding, b] + _switched(own, b, row, sliding, ramp)
            for d in range(1, sliding):
                state[xi + d, b] = last - way * (d * half)
            sliding, way = 1, 0
        if way == 0:
            way = 1 if x - half >= state[xi + 1, b] else -1 if x + half <= state[xi + 1, b] else 0
        if way != 0:
            while sliding < levels and way * (x - state[xi + sliding, b]) >= sliding * half:
                sliding += 1
        for d in range(sliding, known):
            state[held + d, b] = total - _switched(own, b, row, d, ramp)
        row, ramp = _table_row(x, p, b, way, levels)
        total = state[held + sliding, b] + _switched(own, b, row, sliding, ramp)
        y[0, b] = p[0, b] * x + p[last_row, b] + total
        state[2, b], state[3, b] = way * sliding, x


@njit(cache=True)
def _hold_all(p: Array, own: Array, state: Array, b: int) -> None:
    """Make the sums of held relays of a lane anew, from its plays."""
    levels = (state.shape[0] - 4) // 2
    held, sliding = levels + 3, max(int(abs(state[2, b])), 1)
    state[held, b], state[held + levels, b] = p[4, b], 0.0
    for d in range(levels - 1, sliding - 1, -1):
        cell = (state[3 + d, b] - p[1, b]) * (1.0 / p[2, b]) - 0.5 * d
        i, ramp = _on_ramp(cell, p[3, b], levels - d)
        row = 2 * levels * (i + d)
        one = _switched(own, b, row, d + 1, ramp) - _switched(own, b, row, d, ramp)
        state[held + d, b] = state[held + d + 1, b] + one


@njit(cache=True)
def _relay_rows(u: Array, lowest: float, apart: float, ramp: float, xi: Array, rows: Array) -> None:
    """Fill ``rows[K, T]`` with every relay's output since rest, from plays ``xi``, moved along."""
    levels, steep = xi.shape[0] + 1, 2.0 / ramp
    trace = u.copy()
    for d in range(levels):
        r = 0.5 * d * apart
        if d > 0:
            x = xi[d - 1]
            for t in range(u.shape[0]):
                x = play(x, u[t] - r, u[t] + r)
                trace[t] = x
            xi[d - 1] = x
        for j in range(levels - d):
            middle = lowest + (j + 0.5 * d) * apart
            rest = min(max(-steep * middle, -1.0), 1.0)
            row = rows[(j + d) * (j + d + 1) // 2 + j]
            for t in range(u.shape[0]):
                row[t] = play(steep * (trace[t] - middle), -1.0, 1.0) - rest


@dataclass(frozen=True)
class Preisach(Core):
    """Relays with ramps on a triangle of switching values, and a small reversible part.

    Parameters
    ----------
    reversible_um_V
        c (µm/V), not negative: the gain that is left right after a turn. Zero is the classical
        model, which stands still there and has no inverse.
    levels_V
        N switching values (V), evenly spaced and increasing, two or more.
    ramp_V
        Width w of the ramps (V), above zero and at most the distance of two levels; where it is
        that distance, the gain changes least from one command to the next.
    weights_um
        μ (µm), not negative, half of what each relay moves the plant: N (N + 1) / 2 of them. For
        each α from the lowest level up, those of all β from the lowest level to α.
    rate_bandwidth_hz
        As every core has it; no rate matters here.

    Raises
    ------
    InputError
        Levels that do not increase evenly, a ramp wider than their distance, weights that are
        negative, not finite, or not one for each relay.

    Examples
    --------
    Levels 0 and 10 V have the relays (0, 0), (10, 0) and (10, 10) of (α, β); the second one is up
    only on the way back:

    >>> core = Preisach(0.1, levels_V=(0.0, 10.0), ramp_V=10.0, weights_um=(0.0, 1.0, 0.0))
    >>> column = core.responses(np.array([0.0, 5.0, 15.0, 5.0, -5.0]), np.zeros(5), core.settled(()))
    >>> column[:, 2].tolist()
    [0.0, 0.0, 2.0, 2.0, 0.0]

    Notes
    -----
    Displacement is counted from rest, as that of every core: a plant that never moved has all
    plays at zero, and with them the relays of α + β > 0 are down, those of α + β < 0 up. It is
    what a slow oscillation about 0 V that dies away leaves, the demagnetised state, and what RDPI's
    plays at zero are: a sum of plays is this model with weights that are alike along each diagonal.
    On a range from 0 V up all relays are down then.

    A command beyond the outer levels by half a ramp saturates all relays. Relays on the diagonal
    α = β have no hysteresis: with equal weights they are a straight line within the levels, as c is,
    so that data within the levels tell c and their mean apart by nothing.

    Uneven levels are refused since each pair of them would need a play of its own.
    """

    reversible_um_V: float
    levels_V: tuple[float, ...]
    ramp_V: float
    weights_um: tuple[float, ...]
    rate_bandwidth_hz: float | None = None

    name = "preisach"
    block = staticmethod(preisach_block)
    lanes_block = staticmethod(preisach_lanes)
    together = _TOGETHER
    linear = ("reversible_um_V", "weights_um")
    title = "Preisach model"
    equation = (
        "y = c u + sum of μ_jk R_jk[u], R <- max(ρ(u - α_k), min(ρ(u - β_j), R)), ρ(x) = 2 x / w "
        "held within -1 and 1"
    )
    source = (
        "Krasnosel'skii, Pokrovskii, Systems with Hysteresis, 1989; Mayergoyz, Mathematical Models "
        "of Hysteresis, 1991; Banks, Kurdila, Webb, Identification of hysteretic control influence "
        "operators representing smart actuators, Mathematical Problems in Engineering 3, 1997."
    )
    signature = (
        "Loops of any shape that turn counter-clockwise, also unlike on their rising and falling "
        "branches; small loops between the same commands are congruent, whatever came before."
    )
    experiment = (
        "First-order reversal curves: down from the top to each level, and up again each time."
    )
    hardware = "Magnetic and magnetostrictive actuators, shape-memory wires, piezoelectric stacks."

    loose = True

    def __post_init__(self) -> None:
        super().__post_init__()
        set_numbers(self, "levels_V", "weights_um")
        levels, weights = self.levels_V, self.weights_um
        if not (is_finite(self.reversible_um_V) and self.reversible_um_V >= 0):
            raise InputError(
                f"reversible_um_V is {quoted(self.reversible_um_V)}; c is finite and not negative (µm/V)"
            )
        if len(levels) < 2:
            raise InputError(f"levels_V has {len(levels)}; give two levels (V) or more")
        for i, level in enumerate(levels):
            if not (math.isfinite(level) and (i == 0 or level > levels[i - 1])):
                after = f" after {levels[i - 1]} V" if i else ""
                raise InputError(
                    f"level {i + 1} is {level} V{after}; levels are finite and increase"
                )
        for i, (level, even) in enumerate(zip(levels, self._even(), strict=True), start=1):
            if abs(level - even) > _UNEVEN * self.apart_V:
                raise InputError(
                    f"level {i} is {level} V; evenly spaced from {levels[0]} to {levels[-1]} V it is {even:.9g} V"
                )
        # an even grid written with fewer digits has a ramp that is as much off
        widest = self.apart_V * (1.0 + _UNEVEN)
        if not (is_finite(self.ramp_V) and 0 < self.ramp_V <= widest):
            raise InputError(
                f"ramp_V is {quoted(self.ramp_V)}; give a width above 0 V and at most the distance of two levels, {self.apart_V:.9g} V"
            )
        relays = len(levels) * (len(levels) + 1) // 2
        if len(weights) != relays:
            raise InputError(
                f"{len(weights)} weights for {len(levels)} levels; give one for each of the {relays} relays β <= α"
            )
        for (a, b), weight in zip(self._pairs(), weights, strict=True):
            if not (math.isfinite(weight) and weight >= 0):
                raise InputError(
                    f"the weight at α = {levels[a]:g} V, β = {levels[b]:g} V is {weight}; weights are finite and not negative (µm)"
                )

    def _pairs(self) -> list[tuple[int, int]]:
        """Places of α and β among the levels, as the weights are ordered."""
        return [(a, b) for a in range(len(self.levels_V)) for b in range(a + 1)]

    def _even(self) -> list[float]:
        return [self.levels_V[0] + i * self.apart_V for i in range(len(self.levels_V))]

    @property
    def apart_V(self) -> float:
        """Distance h of two levels (V)."""
        return (self.levels_V[-1] - self.levels_V[0]) / (len(self.levels_V) - 1)

    @property
    def thresholds_V(self) -> tuple[float, ...]:
        """Thresholds (V) of the plays that the memory holds: h/2, h, ... (N - 1) h/2."""
        return tuple(d * (0.5 * self.apart_V) for d in range(1, len(self.levels_V)))

    @property
    def triangle(self) -> Array:
        """Weights (µm) with α along rows and β along columns, zero where β > α: float64[N, N]."""
        square = np.zeros((len(self.levels_V),) * 2)
        square[np.tril_indices(len(self.levels_V))] = self.weights_um
        return square

    @property
    def n(self) -> int:
        """Rows of memory: those of the kernel, N - 1 plays and what it holds of them."""
        return 2 * len(self.levels_V) + 2

    @property
    def a0(self) -> float:
        """Least gain right after a turn, c (µm/V): relays of α = β add theirs where they are."""
        return self.reversible_um_V

    @property
    def A(self) -> float:
        """Gain (µm/V) where all relays of the heaviest switching value are on their ramps."""
        triangle = self.triangle
        heaviest = max(float(triangle.sum(axis=axis).max()) for axis in (0, 1))
        return self.reversible_um_V + 2.0 * heaviest / self.ramp_V

    def with_gains(self, gains: Sequence[float]) -> Preisach:
        """Return the model with other gains; c stays above zero, so that there is an inverse."""
        c, *weights = (max(float(gain), 0.0) for gain in gains)
        range_V = self.levels_V[-1] - self.levels_V[0]
        least = _LEAST_C * max(c + 2.0 * math.fsum(weights) / range_V, _LEAST_C)
        return replace(self, reversible_um_V=max(c, least), weights_um=tuple(weights))

    def responses(self, u: Array, v: Array, memory: Array) -> Array:
        """The command, and each relay's output since rest.

        That is 8 T (1 + N (N + 1) / 2) bytes: 100 000 samples take 97 MB at 15 levels, 169 MB at
        20, 657 MB at 40. A fit of many levels adds up products over pieces of a record; the
        memory for the next piece is where a plant's block ended.
        """
        columns = np.empty((1 + len(self.weights_um), len(u)))
        columns[0] = u
        _relay_rows(*self._given(u), self._plays(memory[:, None])[:, 0], columns[1:])
        return columns.T

    def _given(self, u: Array) -> tuple[Array, float, float, float]:
        given: Array = np.ascontiguousarray(u, dtype=np.float64)
        return given, self.levels_V[0], self.apart_V, self.ramp_V

    def roughness(self) -> Array:
        """Return that of the weights over the triangle, :func:`triangle_roughness`."""
        return triangle_roughness(len(self.levels_V))

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Preisach, ...]:
        """Levels whose ramps tile the command's range, and a uniform density of relays over them."""
        apart = 2.0 * scale.span_V / _LEVELS
        lowest = scale.centre_V - scale.span_V + 0.5 * apart
        areas = [1.0 if b < a else 0.5 for a in range(_LEVELS) for b in range(a + 1)]
        each = (1.0 - _REVERSIBLE) * scale.stroke_um / math.fsum(areas)
        return (
            cls(
                _REVERSIBLE * scale.stroke_um / scale.span_V,
                tuple(lowest + i * apart for i in range(_LEVELS)),
                apart,
                tuple(each * area for area in areas),
            ),
        )

    def coefficients(self) -> list[float]:
        """First c (µm/V), levels (V) and ramp, and a mark of them all; then the tables (µm)."""
        return self._columns(np.array([self.gains]))[:, 0].tolist()  # type: ignore[no-any-return]

    def scaled_coefficients(self, factors: Array) -> Array:
        """Those of many cores at once; as :meth:`with_gains` has them."""
        gains = np.maximum(np.array(self.gains) * factors, 0.0)
        range_V = self.levels_V[-1] - self.levels_V[0]
        largest = gains[:, 0] + 2.0 * gains[:, 1:].sum(axis=1) / range_V
        gains[:, 0] = np.maximum(gains[:, 0], _LEAST_C * np.maximum(largest, _LEAST_C))
        return self._columns(gains)

    def _columns(self, gains: Array) -> Array:
        """Return the coefficients of cores on these levels, of gains ``(m, K)``, a column a core."""
        levels, count = len(self.levels_V), len(gains)
        triangle = np.zeros((count, levels, levels))
        triangle[:, *np.tril_indices(levels)] = gains[:, 1:]
        middles = np.add.outer(self.levels_V, self.levels_V) / 2.0
        at_rest = triangle * np.clip(-2.0 * middles / self.ramp_V, -1.0, 1.0)
        # [core, way, switching value, diagonal, (switched, on the ramp)]
        tables = np.zeros((count, 2, levels, levels, 2))
        for d in range(levels):
            weights = np.diagonal(triangle, -d, 1, 2)
            rest = np.diagonal(at_rest, -d, 1, 2).sum(axis=1)[:, None]
            below = np.concatenate([np.zeros((count, 1)), np.cumsum(weights, axis=1)], axis=1)
            whole = below[:, -1:]
            switched = below[:, :-1] - (whole - below[:, 1:]) - rest
            tables[:, 0, :d, d, 0] = -whole - rest  # the command is below their lowest α
            tables[:, 0, d:, d, 0] = tables[:, 1, : levels - d, d, 0] = switched
            tables[:, 0, d:, d, 1] = tables[:, 1, : levels - d, d, 1] = weights
            tables[:, 1, levels - d :, d, 0] = whole - rest
        sums = np.cumsum(tables, axis=3).reshape(count, -1)
        columns = np.empty((count, 5 + sums.shape[1]))
        columns[:, 0] = gains[:, 0]
        columns[:, 1:4] = self.levels_V[0], self.apart_V, 2.0 * self.apart_V / self.ramp_V
        columns[:, 5:] = sums
        for own in columns:
            own[4] = 1.0 + crc32(np.append(own[5:], own[:4]).tobytes())
        return columns.T

    def settled(self, turns_V: Sequence[float]) -> Array:
        """Memory after a slow walk from rest through commands (V)."""
        return self._memory(settled_memory(self.thresholds_V, turns_V)[:, None])[:, 0]

    def resting(self, memory: Array, u0_V: Array) -> Array:
        """Plays within their thresholds of the command."""
        r = np.array(self.thresholds_V)[:, None]
        return self._memory(np.clip(self._plays(memory), u0_V - r, u0_V + r))

    def _plays(self, memory: Array) -> Array:
        """Plays (V) of a memory, ``(N - 1, B)``, those that slide with the command as well."""
        r, sliding = np.array(self.thresholds_V)[:, None], memory[0]
        slides = np.arange(1, len(self.levels_V))[:, None] < np.abs(sliding)
        plays: Array = np.where(
            slides, memory[1] - np.sign(sliding) * r, memory[2 : len(self.levels_V) + 1]
        )
        return plays

    def _memory(self, plays: Array) -> Array:
        memory = np.zeros((self.n, plays.shape[1]))
        memory[2 : len(self.levels_V) + 1] = plays
        return memory


def triangle_roughness(levels: int) -> Array:
    """Matrix R of the roughness g'R g of the gains g of a grid (µm²).

    It is L⁴ ∫∫ (p_m² + w² (p_α² + p_β²)) dα dβ of the density p (µm/V²) of the weights over the
    triangle, with its slopes p_m along the diagonals, where α - β stays, and p_α and p_β; L is the
    levels' range, w a quarter. It is the same for a smooth density on a coarse and on a fine grid, and
    on levels of any unit. Relays of one width are priced as alike wherever they stand, which is a
    sum of plays: one large loop tells rows and columns of the triangle and not its cells, and a
    price that is even in all directions would fill these with loops of an asymmetry that no small
    loop has shown. Cells on the diagonal α = β have half of the area.
    """
    at = {pair: k for k, pair in enumerate((a, b) for a in range(levels) for b in range(a + 1))}
    neighbours = [
        (k, at[other], share)
        for (a, b), k in at.items()
        for other, share in (((a + 1, b + 1), 1.0), ((a + 1, b), _ACROSS), ((a, b + 1), _ACROSS))
        if other in at
    ]
    over_area = np.array([1.0 if b < a else 2.0 for a, b in at])
    step = np.zeros((len(neighbours), 1 + len(at)))
    for row, (one, other, share) in enumerate(neighbours):
        step[row, 1 + one], step[row, 1 + other] = -share * over_area[one], share * over_area[other]
    products: Array = levels**4 * (step.T @ step)
    return products
