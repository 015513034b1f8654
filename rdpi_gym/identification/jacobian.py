"""A plant with effects and its derivatives, one lane each, over one record.

Every derivative is a finite difference between lanes of the stages that the plant itself runs, so
an effect of any kind is fitted by the kernel that simulates it. Lanes share what they have in
common: a change behind the plays does not run the plays again.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from rdpi_gym.measurement import Record
from rdpi_gym.plant.chain import (
    ACTS_ON,
    BEHIND,
    CHAIN,
    DISPLACEMENT,
    FRONT,
    Link,
    Place,
    in_order,
    walk,
)
from rdpi_gym.plant.cores.base import Core, empty_state, pack
from rdpi_gym.plant.cores.play import play, rate_block
from rdpi_gym.plant.cores.rdpi import RDPI
from rdpi_gym.plant.effects.base import Effect, Slot
from rdpi_gym.plant.model import AnyCore
from rdpi_gym.plant.plant import Stage, core_links
from rdpi_gym.support.arrays import Array

_FARTHEST = 2.0  # Motions of a record from equilibrium, where an element may begin
_WITHIN = 1.0 - 1e-9  # Of a bound, as far as a solver of least squares tells it
_SEEN = 1e-9  # Share of the largest free response below which another is no column
# Samples that run through the stages at a time: their lanes stay in the cache.
_CHUNK = 1024


@dataclass(frozen=True)
class Variant(Generic[AnyCore]):
    """One lane: the plant with one number changed."""

    hysteresis: AnyCore
    effects: tuple[Effect, ...]  # In the chain's order


def _links(
    variants: Sequence[Variant[Any]], record: Record, places: Sequence[Place]
) -> dict[Place, Sequence[Link]]:
    """Return the stages of variants in some places, which begin with the record."""
    columns = [
        column
        for column in zip(*(variant.effects for variant in variants), strict=True)
        if column[0].slot in places and column[0].slot in ACTS_ON
    ]
    links: dict[Place, list[Link]] = {}
    for column in columns:
        stage = Stage(column, [variant.hysteresis for variant in variants], record.ts_s)
        if stage.slot in BEHIND:
            stage.start(record.t_s[0])
        links.setdefault(stage.slot, []).append(stage.run)
    return dict(links)


def _front(variants: Sequence[Variant[Any]], record: Record) -> tuple[Array, Array, Array, Array]:
    """Commands and rates ``[T, F]`` of variants, their packed parameters and initial states."""
    lanes = len(variants)
    u = np.full((record.u_V.size, lanes), record.u_V[:, None])
    hysteresis = [variant.hysteresis for variant in variants]
    parameters = pack(hysteresis, record.ts_s, [0.0] * lanes)
    state = _begun_state(variants, record)
    links = _links(variants, record, FRONT) | core_links(
        variants[0].hysteresis, parameters, state, record.ts_s
    )
    u, v, _ = walk(in_order(links, FRONT), [u, None, None])
    return u, v, parameters, state


def _begun_state(variants: Sequence[Variant[Any]], record: Record) -> Array:
    """State of the core of each variant at the beginning of a record."""
    state = empty_state(variants[0].hysteresis.n, len(variants))
    state[0] = np.nan
    for lane, variant in enumerate(variants):
        for effect in variant.effects:
            if effect.slot == "memory":
                turns = effect.turns_from(float(record.u_V[0]))
                state[2:, lane] = variant.hysteresis.settled(turns)
    return state


def simulate_effects(variants: Sequence[Variant[Any]], record: Record) -> Array:
    """Simulate variants of a plant over a record."""
    whole = record.with_history
    u, v, parameters, state = _front(variants, whole)
    return _behind(variants, whole, u, v, parameters, state)[record.before_V.size :]


def _behind(
    variants: Sequence[Variant[Any]],
    record: Record,
    u: Array,
    v: Array,
    parameters: Array,
    state: Array,
) -> Array:
    """Displacement ``[T, B]`` from commands and rates: the plays, and all that comes after them."""
    links = _links(variants, record, BEHIND) | core_links(
        variants[0].hysteresis, parameters, state, record.ts_s
    )
    y: Array = walk(in_order(links, ("core", *BEHIND)), [u, v, None])[DISPLACEMENT]
    return y


def simulate_between(variant: Variant[Any], record: Record, parts: int) -> Array:
    """Simulate a plant with steps between the samples of a record.

    The command and the thresholds are linear from sample to sample, and the rate of Eq. 5 stays
    that over a sampling time: without an effect behind the plays nothing changes, and what changes
    with one is what it does to the motion between the samples.
    """
    early, record = record.before_V.size, record.with_history
    effects = tuple(effect.sampled_at(record.ts_s) for effect in variant.effects)
    variant = replace(variant, effects=effects)
    samples = np.arange(len(record.u_V))
    places = np.arange((len(samples) - 1) * parts + 1) / parts
    fine = Record(
        record.name,
        record.t_s[0] + places * record.ts_s,
        np.interp(places, samples, record.u_V),
        np.zeros_like(places),
        ts_s=record.ts_s / parts,
    )
    u, _, parameters, state = _front([variant], fine)
    rated = replace(variant, effects=tuple(e for e in variant.effects if e.slot != "input"))
    _, v, _, _ = _front([rated], replace(record, u_V=u[::parts, 0]))
    speed = np.interp(places, samples, np.abs(v[:, 0]))
    y = _behind([variant], fine, u, speed[:, None], parameters, state)[::parts, 0]
    return y[early:]


@njit(cache=True, fastmath={"reassoc", "contract"})
def _weight_lanes(
    u: Array,
    v: Array,
    weights: Array,
    rest: Array,
    delta2: float,
    xi: Array,
    steps: Array,
    x: Array,
) -> None:
    """Fill lane 0 with the RDPI sum, Eq. 3, the n + 1 next with it after a step of each weight."""
    n = rest.shape[0]
    for t in range(u.shape[0]):
        shift = delta2 * abs(v[t])  # Eq. 8
        total = weights[0] * u[t]
        for i in range(n):
            r = rest[i] + shift
            z = play(xi[i], u[t] - r, u[t] + r)
            xi[i] = z
            total += weights[i + 1] * z
        x[t, 0] = total
        x[t, 1] = total + steps[0] * u[t]
        for i in range(n):
            x[t, 2 + i] = total + steps[i + 1] * xi[i]


@njit(cache=True)
def _difference_rows(
    x: Array,
    measured: Array,
    kept: NDArray[np.intp],
    scale: Array,
    order: NDArray[np.intp],
    rows: Array,
) -> None:
    """Fill rows with (lane - lane 0) / step at the kept samples, and what lane 0 leaves.

    The last lanes are those of the free numbers, in an order of their own.
    """
    first = scale.shape[0] - order.shape[0]
    for j in range(kept.shape[0]):
        here = x[kept[j], 0]
        for lane in range(first):
            rows[j, lane] = (x[kept[j], lane + 1] - here) * scale[lane]
        for k in range(order.shape[0]):
            lane = first + k
            rows[j, first + order[k]] = (x[kept[j], lane + 1] - here) * scale[lane]
        rows[j, scale.shape[0]] = measured[kept[j]] - here


class Neighbours:
    """A variant and others of one number changed each, as lanes over records.

    A lane runs from the stage at which it begins to differ: up to there it is that of the variant
    itself. What does not depend on a record is made once.

    Parameters
    ----------
    base
        The variant.
    changed, steps
        The others, and by how much the number of each is changed.
    gain_steps
        Steps of the gains of the core, for the derivatives by them.
    """

    def __init__(
        self,
        base: Variant[Any],
        changed: Sequence[Variant[Any]],
        steps: Array,
        gain_steps: Array | None = None,
    ) -> None:
        parting = [_parting(base, variant) for variant in changed]
        order = sorted(range(len(changed)), key=parting.__getitem__)
        self._order = np.array(order, dtype=np.intp)
        self._scale, self._gain_steps = 1.0 / steps[self._order], gain_steps
        self._lanes = [base, *(changed[k] for k in order)]
        self._parting = [_ALWAYS, *(parting[k] for k in order)]
        self._ahead = bisect_left(self._parting, _CORE)
        self._stages = _Stages(self._lanes, self._parting, self._ahead)
        self._parameters: dict[float, Array] = {}
        if gain_steps is not None:
            ahead, behind = self._lanes[1 : self._ahead], self._lanes[self._ahead :]
            lanes = [base, *_gains_changed(base, gain_steps), *ahead, *behind]
            self._wide = _Stages(lanes, [_ALWAYS] * len(lanes), len(lanes))

    def _front(self, record: Record) -> tuple[Array, Array, Array, Array]:
        """Commands and rates ``[T, F]`` of the lanes that differ in front, parameters and states."""
        lanes = self._lanes[: self._ahead]
        if record.ts_s not in self._parameters:
            hysteresis = [lane.hysteresis for lane in lanes]
            self._parameters[record.ts_s] = pack(hysteresis, record.ts_s, [0.0] * len(lanes))
        parameters = self._parameters[record.ts_s]
        state = _begun_state(lanes, record)
        u = np.full((record.u_V.size, 1), record.u_V[:, None])
        for width, stage in self._stages.at(record, ("input",)):
            u = stage.run([_widened(u, width)])
        u = _widened(u, len(lanes))
        v = np.empty_like(u)
        rate_block(u, parameters, state, record.ts_s, v)
        for _, stage in self._stages.at(record, ("rate",)):
            v = stage.run([u, v])
        return u, v, parameters, state

    def derivatives(self, record: Record, kept: NDArray[np.intp]) -> Array:
        """Derivatives of the displacement at samples of a record, and what the plant leaves of it.

        Columns are those of the gains and of the other numbers, one more for the residual.
        """
        assert self._gain_steps is not None
        kept, record = kept + record.before_V.size, record.with_history
        u, v, parameters, state = self._front(record)
        core, first = self._lanes[0].hysteresis, len(self._gain_steps) + 1
        ahead, count = self._ahead - 1, first + len(self._lanes) - 1
        memory, front_u, front_v = state[2:, 0].copy(), u[:, 0].copy(), v[:, 0].copy()
        ahead_u, ahead_y = np.ascontiguousarray(u[:, 1:]), np.empty((len(u), ahead))
        ahead_state = np.ascontiguousarray(state[:, 1:])
        type(core).block(
            ahead_u, np.ascontiguousarray(v[:, 1:]), np.ascontiguousarray(parameters[:, 1:]),
            ahead_state, ahead_y,
        )  # fmt: skip
        behind_core = self._wide.at(record, _SLOTS_BEHIND)
        core_lanes = _core_lanes(core, front_u, front_v, memory, self._gain_steps)
        scale = np.concatenate([1.0 / self._gain_steps, self._scale])
        rows = np.empty((len(kept), count))
        done = 0
        for start in range(0, len(record.u_V), _CHUNK):
            part = slice(start, start + _CHUNK)
            x = np.empty((len(front_u[part]), count))
            core_lanes(part, x)
            x[:, first : first + ahead] = ahead_y[part]
            x[:, first + ahead :] = x[:, :1]
            if behind_core:
                commands = np.full((len(x), count), front_u[part, None])
                commands[:, first : first + ahead] = ahead_u[part]
                for _, stage in behind_core:
                    x = stage.run([commands, commands, x])
            end = done + int(np.searchsorted(kept[done:], start + len(x)))
            _difference_rows(
                x, record.y_um[part], kept[done:end] - start, scale, self._order, rows[done:end]
            )  # fmt: skip
            done = end
        return rows

    def changes(self, record: Record, kept: NDArray[np.intp]) -> Array:
        """Return the same without the columns of the gains: a few lanes, not dozens."""
        kept, record = kept + record.before_V.size, record.with_history
        u, v, parameters, state = self._front(record)
        x = np.empty_like(u)
        type(self._lanes[0].hysteresis).block(u, v, parameters, state, x)
        for width, stage in self._stages.at(record, _SLOTS_BEHIND):
            u = _widened(u, width)
            x = stage.run([u, u, _widened(x, width)])
        x = _widened(x, len(self._lanes))
        rows = np.empty((len(kept), len(self._lanes)))
        _difference_rows(x, record.y_um, kept, self._scale, self._order, rows)
        return rows


# Where lanes part: a place of the chain, and of the effects which.
_Parting: TypeAlias = tuple[int, int]
_SLOTS_BEHIND: tuple[Slot, ...] = ("hysteresis", "output")
_ALWAYS: _Parting = (-1, 0)
_CORE: _Parting = (CHAIN.index("core"), -1)


def _parting(base: Variant[Any], variant: Variant[Any]) -> _Parting:
    """Return where a variant begins to differ: with another core at once, as effects may read it."""
    if variant.hysteresis is not base.hysteresis and variant.hysteresis != base.hysteresis:
        return _ALWAYS
    pairs = enumerate(zip(base.effects, variant.effects, strict=True))
    places = [(CHAIN.index(a.slot), k) for k, (a, b) in pairs if a is not b and a != b]
    return min(places, default=(len(CHAIN), 0))


class _Stages:
    """Stages of lanes, those of one sampling time made once; each has the lanes parted up to it.

    Those of the rate have all that part in front of the core.
    """

    def __init__(
        self, lanes: Sequence[Variant[Any]], parting: Sequence[_Parting], ahead: int
    ) -> None:
        self._lanes, self._parting, self._ahead = lanes, parting, ahead
        self._made: dict[tuple[float, Sequence[Slot]], list[tuple[int, Stage]]] = {}

    def at(self, record: Record, slots: Sequence[Slot]) -> list[tuple[int, Stage]]:
        """Return the stages in some slots, with their number of lanes, at a record's beginning."""
        key = record.ts_s, slots
        if key not in self._made:
            self._made[key] = [made for slot in slots for made in self._make(slot, record.ts_s)]
        for _, stage in self._made[key]:
            stage.state[:] = np.nan
            if stage.slot in BEHIND:
                stage.start(record.t_s[0])
        return self._made[key]

    def _make(self, slot: Slot, ts_s: float) -> Iterator[tuple[int, Stage]]:
        for k, effect in enumerate(self._lanes[0].effects):
            if effect.slot == slot:
                width = bisect_right(self._parting, (CHAIN.index(slot), k))
                lanes = self._lanes[: self._ahead if slot == "rate" else width]
                column = [lane.effects[k] for lane in lanes]
                yield len(lanes), Stage(column, [lane.hysteresis for lane in lanes], ts_s)


def _widened(x: Array, lanes: int) -> Array:
    """Lanes ``[T, F]``, and lane 0 again in each further one."""
    if x.shape[1] == lanes:
        return x
    wide = np.empty((len(x), lanes))
    wide[:, : x.shape[1]], wide[:, x.shape[1] :] = x, x[:, :1]
    return wide


def take_out_initial(
    rows: Array, record: Record, effects: Sequence[Effect], kept: NDArray[Any]
) -> None:
    """Take out of columns what a record leaves open: its offset, and free responses of unknown states.

    An element of an unknown past may begin twice as far from equilibrium as the record moves: the plant
    may have stood beside its range. So much of the residual, the last column, is its free response, and
    derivatives are those beside it.
    """
    centre(rows)
    free = _free_responses(record, effects, kept)
    if not free.shape[1]:
        return
    q, r = np.linalg.qr(free)
    share = _shares(q, r, rows[:, -1])
    rows[:, -1] -= free @ share
    within = np.abs(share) < _WITHIN
    if not within.all():
        q, _ = np.linalg.qr(free[:, within])
    rows[:, :-1] -= q @ (q.T @ rows[:, :-1])


def _free_responses(record: Record, effects: Sequence[Effect], kept: NDArray[Any]) -> Array:
    """Largest free responses of elements whose past is unknown, centred (µm), ``(N, K)``."""
    unknown = record.past_unknown or any(effect.slot == "memory" for effect in effects)
    pairs = [pair for e in effects for pair in zip(*e.elements(), strict=True) if unknown]
    if not pairs or not record.error_mask.any():
        return np.empty((0, 0))
    past_s = (record.t_s - record.t_s[0])[kept]
    gains, taus_s = np.array(pairs).T
    largest_um = gains * _FARTHEST * float(np.ptp(record.y_um[record.error_mask]))
    free = largest_um * np.exp(-past_s[:, None] / taus_s)
    free -= free.mean(axis=0)
    return np.asarray(free[:, np.any(np.abs(free) > _SEEN * largest_um.max(initial=0.0), axis=0)])


def _shares(q: Array, r: Array, left: Array) -> Array:
    """Shares of the largest free responses, centred, q times r, that a residual (µm) holds, from -1 to 1."""
    return np.asarray(lsq_linear(r, q.T @ left, (-1.0, 1.0), "bvls").x)


def free_response(left: Array, record: Record, effects: Sequence[Effect]) -> Array:
    """Return the free response of unknown states (µm), ``(T,)``, that a residual holds where samples count."""
    free = _free_responses(record, effects, np.arange(left.size))
    if not free.shape[1]:
        return np.zeros(left.size)
    own = free[record.error_mask]
    q, r = np.linalg.qr(own - own.mean(axis=0))
    return np.asarray(free @ _shares(q, r, left[record.error_mask]))


def centred(left: Array, record: Record, effects: Sequence[Effect], kept: NDArray[Any]) -> Array:
    """Return a residual (µm) less what a record leaves open."""
    column = left[:, None].copy()
    take_out_initial(column, record, effects, kept)
    return np.asarray(column[:, 0])


@njit(cache=True)
def centre(rows: Array) -> None:
    """Take the mean of each column out of it."""
    mean = np.zeros(rows.shape[1])
    for t in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            mean[k] += rows[t, k]
    mean /= rows.shape[0]
    for t in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            rows[t, k] -= mean[k]


def _core_lanes(
    core: Core, u: Array, v: Array, memory: Array, steps: Array
) -> Callable[[slice, Array], None]:
    """Return what fills, part after part, lane 0 with the core's sum and the next with a step of each gain."""
    if isinstance(core, RDPI):  # dozens of plays, of which a record's columns are not kept
        weights, rest = np.array(core.weights), np.array(core.thresholds_V)

        def fill(part: slice, x: Array) -> None:
            _weight_lanes(u[part], v[part], weights, rest, core.delta2_s, memory, steps, x)

        return fill
    columns = core.responses(u, v, memory)
    total = columns @ np.array(core.gains)

    def spread(part: slice, x: Array) -> None:
        x[:, 0] = total[part]
        x[:, 1 : len(steps) + 1] = total[part, None] + steps * columns[part]

    return spread


def _gains_changed(base: Variant[Any], steps: Array) -> list[Variant[Any]]:
    """The plant after a step of each gain, for the stages that read them.

    Of the RDPI model a stage with plays of its own reads all, any other a_0 alone: the same lane is
    packed once.
    """
    core = base.hysteresis
    every = not isinstance(core, RDPI) or any(effect.weighs_plays for effect in base.effects)
    count = len(steps) if every else 1
    changed = []
    for k in range(count):
        gains = [*core.gains[:k], core.gains[k] + float(steps[k]), *core.gains[k + 1 :]]
        changed.append(Variant(core.with_gains(gains), base.effects))
    return [*changed, *[base] * (len(steps) - count)]
