"""Tracking problems in many lanes, each with a plant, a reference and noise of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numba
import numpy as np

from rdpi_gym.envs.controller import Correction
from rdpi_gym.envs.limits import Limits
from rdpi_gym.envs.piezo_tracking import PiezoTrackingEnv
from rdpi_gym.envs.privileged import core_values, in_place, latent_values
from rdpi_gym.envs.truth import (
    FrequencyChoice,
    ReferenceChoice,
    frequency_at,
    frequency_bounds,
)
from rdpi_gym.envs.vector.begin import (
    Column,
    begin_signals_parallel,
    draw_episodes,
    draw_seeds,
    place_plants,
    seed_generators,
    show_first,
)
from rdpi_gym.envs.vector.chain import run_chain
from rdpi_gym.envs.vector.kernels import advance, advance_parallel, gather, show_stacked
from rdpi_gym.envs.vector.lanes import (
    BEGUN,
    NEVER,
    SLIDE,
    WORK,
    Floats32,
    Integers,
    Lanes,
    Law,
    Shown,
    Sources,
    Words,
    aligned,
    block_shape,
    make_lanes,
    note_begun,
    place_parameters,
    room,
    scatter,
    scatter_parallel,
    unshared,
)
from rdpi_gym.envs.vector.plants import CoreLanes, EffectStages, LaneCores, glides_of, wear_of
from rdpi_gym.envs.vector.random import NoiseTables, begin_noise
from rdpi_gym.envs.vector.waves import (
    AHEAD,
    ANGLE,
    APART,
    COLUMNS,
    FIRST,
    FREQUENCY,
    HEIGHT,
    LINES,
    MIDDLE,
    MULTISINE,
    SAMPLED,
    SEED,
    SHAPE,
    SINE,
    START,
    TRIANGLE,
    Drawn,
    begin_waves,
)
from rdpi_gym.plant import PlantModel
from rdpi_gym.signals import Multisine, Signal, Sine, Triangle
from rdpi_gym.signals.base import smoothstep
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

# Lanes that are worth a thread more: they take several times as long as waking it.
_LANES_A_THREAD = 2048
# The same of those that begin, which take some microseconds each.
_BEGINNINGS_A_THREAD = 8


class LaneGroup:
    """B lanes of plants about one nominal plant, which take seeds and commands as they are given them.

    Layout, references and their checks are those of `single`. `step` counts the steps so far,
    `next_end` is the first at which an episode ends.
    """

    def __init__(
        self,
        single: PiezoTrackingEnv,
        nominal: PlantModel,
        lanes: int,
        max_steps: int | None,
        threads: int | None,
    ) -> None:
        self._single, self._layout, self._lane_count = single, single.layout, lanes
        self._nominal = nominal
        truths, layout, law = single.truths, single.layout, single.truths.law
        self._core = CoreLanes(nominal, layout.ts_s)
        self._effects = EffectStages(nominal, layout.ts_s, truths.effects_half_width)
        self._wear = wear_of(law)
        self._glides = glides_of(law, self._effects, lanes)
        self._hold = nominal.converter.samples(layout.ts_s)
        self._draws_core = truths.half_width > 0.0 or self._wear is not None
        self._draws_effects = self._effects.levels > 0 or (
            self._draws_core and self._effects.reads_hysteresis
        )
        shape = block_shape(lanes, len(law.nominals))
        if threads is None:
            threads = min(numba.get_num_threads(), lanes // _LANES_A_THREAD)
        threads = max(1, min(threads, shape[0]))
        share = -(-shape[0] // threads)
        low, high = layout.command_range_V
        self._rest_V = min(max(0.0, low), high)
        self._column = self._column_of(nominal)
        self._max_steps = NEVER if max_steps is None else max_steps
        sensor, limits = nominal.sensor, single.limits
        self._law = Law(
            ts_s=layout.ts_s,
            per_scale=1.0 / layout.scale_um,
            low_V=float(low),
            high_V=float(high),
            action_scale_V=float(layout.action_scale_V),
            places=layout.action == "command",
            command_cost=single.command_cost,
            hold=self._hold,
            sensed=sensor.noise_um > 0.0 or sensor.resolution_um > 0.0,
            max_steps=self._max_steps,
            core=self._core.kernel,
            step_V=law.command_step_V,
            limited=limits is not None,
            **(limits or Limits()).of_sample(layout)._asdict(),
            share=share,
        )
        self._rows = (*self._core.rows, *self._effects.rows)
        changes = self._wear is not None or self._glides is not None
        shared = (not self._draws_core, not (self._draws_effects or changes))
        self._lanes = make_lanes(shape, self._rows, layout, shared, single.history.steps)
        for block in self._lanes.p:
            place_parameters(self._column.p, self._column.together, block)
        self._lanes.stage_p[:] = self._column.stage_p[:, None]
        self._work: Array = aligned((threads, WORK, shape[1]))
        plans = single.plans
        self._references = References(single, lanes, shape, plans, self._max_steps, share)
        self._noise = NoiseTables(shape, share, law.noise, layout.ts_s)
        self._encoder = layout.encoder(single.bound_um, reciprocal=True)
        self._now = np.array(layout.now, dtype=np.int64)
        self._sources = self._current_sources()
        self._fresh: tuple[Lanes, Array] | None = None
        self._latent: Array = np.zeros((lanes if single.latents else 0, 0))
        self._size, self.info_rows = single.history.size, 10 if limits is not None else 5
        self.step, self.next_end = 0, 0

    @property
    def threads(self) -> int:
        """Number of threads that share a step."""
        return len(self._work)

    def observations(self) -> Floats32:
        """Return the last observations without history, a fresh float32[B, D]."""
        size, at = self._layout.size, self.step % SLIDE
        observed = self._lanes.observed[:, at : at + size * self._lanes.state.shape[2]]
        last = room(self._lane_count * size, np.float32).reshape(-1, size)
        last[...] = observed.reshape(-1, size)[: self._lane_count]
        return last

    def stacked(self) -> Floats32:
        """Return the last observations with their history, a fresh float32[B, D + F H]."""
        history = self._single.history
        if not history.steps:
            return self.observations()
        out = room(self._lane_count * history.size, np.float32)
        show_stacked(self.step, self._lanes, self._sources, out)
        return out.reshape(-1, history.size)

    def reference_um(self, lane: int) -> Array:
        """Samples (µm) of the reference of a lane that has a table."""
        own: Array = self._references.tables_um[lane]
        return own

    def begin(
        self, indices: Integers, seeds: Words, given: PlantModel | None, options: Mapping[str, Any]
    ) -> tuple[Floats32, Array]:
        """Begin episodes in some lanes, from the seeds of their plants, references and noise."""
        truths, count = self._single.truths, len(indices)
        law = truths.law
        column = self._column if given is None else self._column_of(given)
        offer = self._references.offered(options.get("reference"), options.get("frequency_hz"))
        drawing, core = given is None, (given or self._nominal).hysteresis
        wears, changes = drawing and self._wear is not None, drawing and self._glides is not None
        drawn = Drawn(
            factors=np.empty(
                (count, self._core.factors if drawing and truths.half_width > 0 else 0)
            ),
            levels=np.empty((count, self._effects.levels if drawing else 0), dtype=np.int64),
            choice=np.empty(count, dtype=np.int64),
            position=np.empty(count),
            signal_seed=np.empty(count, dtype=np.int64),
            noise_seed=np.empty(count, dtype=np.uint64),
            life=np.empty(count if wears else 0),
            change=np.empty((count if changes else 0, 2)),
        )
        beginnings = 0 if self._glides is None else self._glides.beginnings
        choices = len(self._references.offer.choices)
        draw_episodes(seeds, choices, len(law.nominals), truths.half_width, beginnings, drawn)
        if not drawing:
            self._take_plant(column)
        fresh, work = self._fresh_block(count)
        place_plants(self.step, self._rest_V, column, drawn, fresh)
        worn = None if self._wear is None or not wears else self._wear.factors(core, drawn.life)
        cores = self._core.draw(core, drawn.factors, worn, fresh)
        turns = column.turns_V[:, None].repeat(count, axis=1)
        if drawing and self._draws_effects:
            turns = self._effects.draw(drawn.levels, fresh, cores, self._rest_V, turns)
        if self._wear is not None and wears:
            self._effects.wear(self._wear, drawn.levels, drawn.life, fresh, cores)
        if self._single.latents:
            self._note_latents(indices, given, drawn, cores, fresh)
        if self._glides is not None:
            self._glides.begin(self.step, indices, drawn.levels, drawn.change, drawn.life)
        self._core.settle(self._rest_V, turns, cores, fresh)
        rest_V, step_V = self._rest_V, self._law.step_V
        work[0] = np.rint(rest_V / step_V) * step_V if step_V else rest_V
        waves = self._references.ready(self.step, indices, offer, drawn, fresh)
        noise = self._noise.ready(self.step, indices, column.noise_um, drawn.noise_seed)
        threads = min(self.threads, max(1, count // _BEGINNINGS_A_THREAD))
        if threads > 1:
            begin_signals_parallel(threads, count, waves, noise)
        else:
            begin_waves(0, count, *waves)
            begin_noise(0, count, *noise)
        sources = self._current_sources()._replace(ahead_um=waves[-1], noise=noise[-1])
        row = run_chain(
            self._law.core, fresh.p[0], fresh.state[0], self._effects.table, fresh.stage_p[0],
            fresh.stage_state[0], self._layout.ts_s, work,
        )  # fmt: skip
        size = self._single.history.size
        shown = Shown(
            room(count * size, np.float32), np.empty(0), np.empty(0, bool),
            np.empty((self.info_rows, count)),
        )  # fmt: skip
        show_first(self.step, row, fresh, sources, self._law, work, shown)
        rise = self._references.rises.shape[1]
        if threads > 1:
            parts = tuple(fresh), shown.observation, indices, tuple(self._lanes)
            scatter_parallel(threads, self.step, self._core.together, *parts)
        else:
            own = self.step, self._core.together, fresh, shown.observation, indices, self._lanes
            scatter(0, count, *own)
        note_begun(self.step, indices, self._lanes, self._max_steps, rise)
        self._sources = self._current_sources()
        self.next_end = int(self._lanes.ending.min())
        return shown.observation.reshape(count, size), shown.info

    @property
    def latents(self) -> Array:
        """Latent parameters of each lane's plant as it is now, float64[B, K]; overwritten as it changes."""
        return self._latent

    def _note_latents(
        self,
        indices: Integers,
        given: PlantModel | None,
        drawn: Drawn,
        cores: LaneCores,
        fresh: Lanes,
    ) -> None:
        """Take the latent parameters of lanes that begin."""
        model = self._nominal if given is None else given
        count = len(indices)
        own = np.tile(latent_values(model), (count, 1))
        core = model.hysteresis
        numbers = len(core_values(core))
        if given is None and core.drawn_as_packed:
            own[:, :numbers] = fresh.p[0, :numbers, :count].T
        elif given is None:
            own[:, :numbers] = [core_values(cores[lane]) for lane in range(count)]
        if given is None:
            wear = self._wear if len(drawn.life) else None
            own[:, numbers:] = self._effects.all_values(drawn.levels, wear, drawn.life).T
        if not self._latent.shape[1]:
            self._latent = np.zeros((self._lane_count, own.shape[1]))
        self._latent[indices] = own

    def release(self, indices: Integers) -> None:
        """Let lanes go on without an episode, so that none of theirs ends."""
        width = self._lanes.state.shape[2]
        self._lanes.numbers[indices // width, BEGUN, indices % width] = NEVER
        note_begun(self.step, indices, self._lanes, self._max_steps, 0)
        self._references.release(indices)
        self.next_end = int(self._lanes.ending.min())

    def advance(self, actions: Array, base_V: Array, out: Shown | None = None) -> Shown:
        """Take one step of the first lanes, as many as there are actions; `out` is made anew or filled."""
        self.step += 1
        if self.step >= self._references.due:
            self._references.extend(self.step, self._lanes)
        if self._glides is not None and self.step >= self._glides.due:
            self._glides.change(self.step, self._lanes, self._latent)
        lanes = len(actions)
        if out is None:
            out = Shown(
                room(lanes * self._size, np.float32),
                np.empty(lanes),
                np.empty(lanes, dtype=bool),
                np.empty((self.info_rows, lanes)),
            )
        out.truncated[:] = False
        blocks = -(-lanes // self._lanes.state.shape[2])
        run = advance_parallel if self.threads > 1 else advance
        # Flat: a call that hands named tuples over takes twice as long to find its kernel.
        fields = (*self._lanes, *self._sources, *out, *self._law)
        run(blocks, self.step, actions, base_V, self._work, fields)
        return out

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        self._effects.find_kernels()
        self._law = self._law._replace(core=self._core.kernel)

    def _fresh_block(self, count: int) -> tuple[Lanes, Array]:
        """Return a block for lanes that begin, and its work; the last one where it is as wide."""
        width = max(32, -(-count // 32) * 32)
        if self._fresh is None or self._fresh[0].state.shape[2] != width:
            made = make_lanes((1, width), self._rows, self._layout)
            self._fresh = made, aligned((WORK, width))
        return self._fresh

    def _current_sources(self) -> Sources:
        return Sources(
            self._effects.table,
            self._references.rises,
            self._references.waves,
            self._references.tables_um,
            self._references.ahead_um,
            self._noise.tables,
            self._noise.rngs,
            self._noise.states,
            self._noise.law,
            self._encoder,
            self._now,
        )

    def _take_plant(self, column: Column) -> None:
        """Make room for a plant that an option gives: parameters, and a sensor, of its own."""
        self._lanes = unshared(self._lanes)
        sensed = self._law.sensed or column.noise_um > 0.0 or column.resolution_um > 0.0
        self._law = self._law._replace(sensed=sensed)

    def _column_of(self, model: PlantModel) -> Column:
        """Return a plant as the lanes hold it, or refuse one that is built unlike the nominal one."""
        if model.converter.samples(self._layout.ts_s) != self._hold:
            raise InputError(
                f"the converter of plant {model.name} holds another number of samples than the lanes of "
                "this environment; make an environment of that plant instead"
            )
        # Behind the plays an effect sees the displacement without its offset.
        inside, behind = (
            (0.0, model.offset_um) if len(self._effects.table) else (model.offset_um, 0.0)
        )
        return Column(
            p=self._core.column(model, inside),
            together=self._core.together,
            stage_p=self._effects.column(model),
            turns_V=np.array(model.turns_from(self._rest_V)),
            offset_um=behind,
            noise_um=float(model.sensor.noise_um),
            resolution_um=float(model.sensor.resolution_um),
        )


class VectorTask:
    """B lanes of what one environment does, without the rules of autoreset.

    Lanes of one nominal plant are one group. Of several nominal plants, one of which each episode
    draws, every one has a group of its own: a lane has a slot in the group of the plant that it drew.
    """

    def __init__(
        self, single: PiezoTrackingEnv, lanes: int, max_steps: int | None, threads: int | None
    ) -> None:
        self._single, self._lane_count = single, lanes
        self._nominals = single.truths.law.nominals
        self._groups = [
            LaneGroup(single, nominal, lanes, max_steps, threads) for nominal in self._nominals
        ]
        self._slots = Slots(lanes, len(self._groups), self.info_rows)
        self._parts: Parts | None = None
        self._correction: Correction | None = None
        if single.baseline is not None:
            self._correction = Correction(single.baseline, single.belief, single.layout, lanes)
        self._begins = np.ones(lanes, dtype=bool)
        self._generators: Words = np.zeros((lanes, 4), dtype=np.uint64)

    @property
    def threads(self) -> int:
        """Number of threads that share a step."""
        return self._groups[0].threads

    @property
    def step(self) -> int:
        """Steps so far."""
        return self._groups[0].step

    @property
    def next_end(self) -> int:
        """First step at which an episode ends."""
        return min([group.next_end for group in self._groups])

    @property
    def info_rows(self) -> int:
        """Number of quantities that are reported beside observation and reward."""
        return self._groups[0].info_rows

    def observations(self) -> Floats32:
        """Return the last observations without history, a fresh float32[B, D]."""
        return self._slots.gathered([group.observations() for group in self._groups])

    def stacked(self) -> Floats32:
        """Return the last observations with their history, a fresh float32[B, D + F H]."""
        return self._slots.gathered([group.stacked() for group in self._groups])

    def seed(self, indices: Integers, seeds: Words) -> None:
        """Begin the generators of some lanes anew, as ``numpy.random.default_rng(seed)``."""
        seed_generators(seeds, indices, self._generators)

    def begin(self, indices: Integers, options: Mapping[str, Any]) -> tuple[Floats32, Array]:
        """Begin episodes in some lanes."""
        single, count = self._single, len(indices)
        given = single.truths.given(options, single.layout)
        seeds = np.empty((count, 4), dtype=np.uint64)
        draw_seeds(self._generators, indices, len(self._groups), seeds)
        kinds = seeds[:, 3].astype(np.int64)
        if given is not None:
            kinds[:] = single.truths.law.kind_of(given)
        for kind, slots in self._slots.released(indices):
            self._groups[kind].release(slots)
        observation = room(count * single.history.size, np.float32).reshape(count, -1)
        info = np.empty((self.info_rows, count))
        for kind, group in enumerate(self._groups):
            own = np.flatnonzero(kinds == kind)
            if len(own):
                slots = self._slots.taken(kind, indices[own])
                observation[own], info[:, own] = group.begin(slots, seeds[own], given, options)
        self._begins[indices] = True
        if self._correction is not None and self._correction.plans:
            references = {
                lane: self._groups[kind].reference_um(slot)
                for lane, kind, slot in self._slots.places(indices)
            }
            shown = observation[:, : single.layout.size]
            self._correction.plan(indices, references, shown)
        return observation, info

    def advance(self, actions: Array) -> Shown:
        """Take one step of all lanes."""
        base_V = np.empty(0)
        if self._correction is not None:
            self._correction.observe(self.observations(), self._begins)
            base_V = self._correction.commands_V
        self._begins[:] = False
        if len(self._groups) == 1:
            return self._groups[0].advance(actions, base_V)
        lanes = self._lane_count
        out = Shown(
            room(lanes * self._single.history.size, np.float32),
            np.empty(lanes),
            np.empty(lanes, dtype=bool),
            np.empty((self.info_rows, lanes)),
        )
        order = self._slots.order
        if self._parts is None or self._parts.order is not order:
            self._parts = Parts(order, self._single.history.size, self.info_rows)
        for group, own, part in zip(self._groups, order.lanes, self._parts.each, strict=True):
            group.advance(actions[own], base_V[own] if len(base_V) else base_V, part)
        gather(order.places, self._parts.whole, out)
        return out

    def latents(self) -> Array:
        """Return the latent parameters of every lane's plant as it is now, a fresh float64[B, K]."""
        parts = [
            in_place(group.latents, kind, self._nominals)
            for kind, group in enumerate(self._groups)
            if group.latents.shape[1]
        ]
        kinds = [kind for kind, group in enumerate(self._groups) if group.latents.shape[1]]
        found = np.zeros((self._lane_count, len(self._single.latents)))
        for kind, part in zip(kinds, parts, strict=True):
            self._slots.gather(kind, part, found)
        return found


class Order(NamedTuple):
    """Where the lanes stand in the parts of their groups, one part behind the other."""

    # Of each group the lane in each slot up to the last taken; of a free one -1
    lanes: list[Integers]
    ends: list[int]  # Slots before each part, and all of them
    # int64[3, B]: row of each lane, its first number of the info, and their distance
    places: Integers


class Parts:
    """Results of a step by group in the lanes' order: `each` a stretch of the `whole`."""

    def __init__(self, order: Order, size: int, info_rows: int) -> None:
        total = order.ends[-1]
        observation, info = room(total * size, np.float32), np.empty(total * info_rows)
        self.order = order
        self.whole = Shown(observation, np.empty(total), np.empty(total, dtype=bool), info)
        self.each = [
            Shown(
                observation[first * size : end * size],
                self.whole.reward[first:end],
                self.whole.truncated[first:end],
                info[first * info_rows : end * info_rows].reshape(info_rows, end - first),
            )
            for first, end in pairwise(order.ends)
        ]


class Slots:
    """Places of lanes in groups of plants: with one group, each lane's own number."""

    def __init__(self, lanes: int, groups: int, info_rows: int) -> None:
        self._only, self._info_rows = groups == 1, info_rows
        self._kind: Integers = np.full(lanes, 0 if self._only else -1)
        self._slot: Integers = np.arange(lanes)
        # Of each group the lane in each slot, -1: none.
        self._lane: list[Integers] = [np.full(lanes, -1) for _ in range(groups)]
        self._order: Order | None = None

    def released(self, lanes: Integers) -> list[tuple[int, Integers]]:
        """Free the slots of some lanes; return those of each group that had any."""
        if self._only:
            return []
        self._order, found = None, []
        for kind, lane_of in enumerate(self._lane):
            slots = self._slot[lanes[self._kind[lanes] == kind]]
            if len(slots):
                lane_of[slots] = -1
                found.append((kind, slots))
        return found

    def taken(self, kind: int, lanes: Integers) -> Integers:
        """Give some lanes the lowest free slots of a group."""
        if self._only:
            return lanes
        self._order = None
        slots = np.flatnonzero(self._lane[kind] < 0)[: len(lanes)]
        self._lane[kind][slots] = lanes
        self._kind[lanes], self._slot[lanes] = kind, slots
        return slots

    @property
    def order(self) -> Order:
        """The order of the lanes as they are now, made anew after one has another place."""
        if self._order is None:
            used = [1 + int(np.flatnonzero(each >= 0).max(initial=-1)) for each in self._lane]
            ends = [0, *np.cumsum(used).tolist()]
            first, count = np.array(ends)[self._kind], np.array(used)[self._kind]
            first_info = first * self._info_rows + self._slot
            places = np.stack([first + self._slot, first_info, count])
            own = [lane[:end] for lane, end in zip(self._lane, used, strict=True)]
            self._order = Order([each.copy() for each in own], ends, places)
        return self._order

    def places(self, lanes: Integers) -> list[tuple[int, int, int]]:
        """Return lane, group and slot of some lanes."""
        parts = lanes, self._kind[lanes], self._slot[lanes]
        return list(zip(*(part.tolist() for part in parts), strict=True))

    def gathered(self, rows: Sequence[Floats32]) -> Floats32:
        """Return rows of all groups' slots in the order of the lanes."""
        if self._only:
            return rows[0]
        found = np.empty_like(rows[0])
        for kind, each in enumerate(rows):
            self.gather(kind, each, found)
        return found

    def gather(self, kind: int, rows: Array | Floats32, found: Array | Floats32) -> None:
        """Put rows of a group's slots in the places of its lanes."""
        own = self._kind == kind
        found[own] = rows[self._slot[own]]


# Phase of a sample (rad) up to which sines are had by formula: far more than samples can show.
_FASTEST_RAD = 1e3
# Samples of a table: what the single environment makes at a time, or fewer where episodes are
# shorter. NumPy may compute whole vectors otherwise than what is left over behind them, in the last
# digit: so a table that is cut is a whole number of vectors.
_CHUNK, _VECTOR = 2048, 16
# Lines of a multisine that kernels add up.
_MOST_LINES = 64


class Offer(NamedTuple):
    """The references that episodes may draw."""

    choices: Sequence[ReferenceChoice]
    bounds_hz: tuple[float, float]
    tabled: bool  # whether one of them is no sine
    sampled: bool  # whether Python samples one of them
    table: (
        Array  # float64[C, COLUMNS]: the waves of rdpi_gym.envs.vector.waves, one for each choice
    )


class References:
    """References of B lanes; `single`, an environment of the same options, makes signals and refuses them.

    With `tables_only` sines come from tables too, for a baseline that plans over samples.

    Attributes
    ----------
    rises : float64[R, M]
        Smooth starts, sample by sample; the first row is none.
    waves : float64[B, C]
        As :mod:`rdpi_gym.envs.vector.waves` has them.
    ahead_um : float64[N, AHEAD, W]
        Next samples of the lanes; without rows until the reference of one is no sine.
    tables_um : float64[B, M]
        Samples of the lanes whose reference is no wave; one row until there is one.
    due : int
        First step at which a table has no sample left to show ahead.
    """

    def __init__(
        self,
        single: PiezoTrackingEnv,
        lanes: int,
        shape: tuple[int, int],
        tables_only: bool,
        max_steps: int,
        share: int,
    ) -> None:
        self._single, self._lanes, self._tables_only = single, lanes, tables_only
        self._preview, self._ts_s = single.layout.preview, single.layout.ts_s
        self._durations_s = [0.0]
        self.rises: Array = np.ones((1, 1))
        samples = _CHUNK + self._preview
        if not tables_only:  # a plan over fewer samples may be another one
            whole = -(-(max_steps + 1 + self._preview + AHEAD) // _VECTOR) * _VECTOR
            samples = min(samples, whole)
        self._shape, self._share = shape, share
        self.ahead_um: Array = np.zeros((0, AHEAD, 1))
        self.tables_um: Array = np.zeros((1, samples))
        self.waves: Array = np.zeros((lanes, COLUMNS))
        self._signals: dict[int, Signal] = {}
        self._due: Integers = np.full(lanes, NEVER)
        self.due = NEVER
        source = single.references
        self.offer = self._offered(source.choices, source.frequency_hz)

    def offered(
        self, reference: ReferenceChoice | None, frequency_hz: FrequencyChoice | None
    ) -> Offer:
        """Return what episodes may draw, with what a reset gives instead."""
        if reference is None and frequency_hz is None:
            return self.offer
        bounds = self.offer.bounds_hz if frequency_hz is None else frequency_bounds(frequency_hz)
        return self._offered(self.offer.choices if reference is None else (reference,), bounds)

    def ready(
        self, step: int, indices: Integers, offer: Offer, drawn: Drawn, fresh: Lanes
    ) -> tuple[Any, ...]:
        """Make room for the references of lanes that begin, and fill the tables of those that need one."""
        most = COLUMNS + int(offer.table[:, LINES].max())
        if most > self.waves.shape[1]:
            wider = np.zeros((self._lanes, most))
            wider[:, : self.waves.shape[1]] = self.waves
            self.waves = wider
        if offer.tabled and not len(self.ahead_um):
            self.ahead_um = aligned((self._shape[0], AHEAD, self._shape[1]))
        if offer.sampled:
            self._sample(step, indices, offer, drawn)
        rows = (1, self._preview + 1, len(indices)) if offer.tabled else (0, 1, 1)
        return (
            step, self._share, indices, *offer.bounds_hz, offer.table, drawn.choice, drawn.position,
            drawn.signal_seed, self._ts_s, self.rises, fresh.numbers, self.waves, self.tables_um,
            self.ahead_um, np.empty(rows),
        )  # fmt: skip

    def _sample(self, step: int, indices: Integers, offer: Offer, drawn: Drawn) -> None:
        """Fill the tables of lanes that begin with a signal that is no wave."""
        # All are made before one is kept: an error leaves the running episodes as they are.
        shapes = offer.table[np.minimum(drawn.choice, len(offer.table) - 1), SHAPE]
        sampled = np.flatnonzero(shapes == SAMPLED)
        made = [self._make(offer, drawn, j) for j in sampled.tolist()]
        if len(self.tables_um) < self._lanes:
            self.tables_um = np.zeros((self._lanes, self.tables_um.shape[1]))
        self._due[indices] = NEVER
        for lane, (signal, samples_um) in zip(indices[sampled].tolist(), made, strict=True):
            self._signals[lane], self.tables_um[lane] = signal, samples_um
            self._due[lane] = step + self._covered
        self.due = int(self._due.min())

    def release(self, indices: Integers) -> None:
        """Need no samples of some lanes any more."""
        self._due[indices] = NEVER
        self.due = int(self._due.min())

    @property
    def _covered(self) -> int:
        """Steps from the sample at which a table begins to that at which its end may be near."""
        return int(self.tables_um.shape[1]) - self._preview - AHEAD

    def extend(self, step: int, lanes: Lanes) -> None:
        """Fill the tables that end before what `step` may take of them, from that step on."""
        width = lanes.state.shape[2]
        for lane in np.flatnonzero(self._due <= step).tolist():
            if self.waves[lane, SHAPE] != SAMPLED:
                self._due[lane] = NEVER
                continue
            start = step - int(lanes.numbers[lane // width, BEGUN, lane % width])
            self.tables_um[lane] = self._samples_um(self._signals[lane], start)
            self.waves[lane, FIRST] = start
            self._due[lane] = step + self._covered
        self.due = int(self._due.min())

    def _make(self, offer: Offer, drawn: Drawn, j: int) -> tuple[Signal, Array]:
        choice = offer.choices[min(int(drawn.choice[j]), len(offer.choices) - 1)]
        frequency = frequency_at(offer.bounds_hz, float(drawn.position[j]))
        signal = self._single.references.make(choice, frequency, int(drawn.signal_seed[j]))
        return signal, self._samples_um(signal, 0)

    def _samples_um(self, signal: Signal, start: int) -> Array:
        samples: Array = self._single.reference_um(signal, start, start + self.tables_um.shape[1])
        return samples[:, 0]

    def _offered(self, choices: Sequence[ReferenceChoice], bounds_hz: tuple[float, float]) -> Offer:
        rows = []
        for choice in choices:
            signal = self._single.references.make(choice, bounds_hz[0], 0)
            rows.append(self._wave(signal, bounds_hz[1]))
            if not isinstance(choice, Signal):
                given = choice if isinstance(choice, Mapping) else {}
                for column, name in ((FREQUENCY, "frequency_hz"), (SEED, "seed")):
                    if name not in given:
                        rows[-1][column] = np.nan
        table = np.array(rows)
        shapes = table[:, SHAPE]
        tabled, sampled = bool((shapes != SINE).any()), bool((shapes == SAMPLED).any())
        return Offer(choices, bounds_hz, tabled, sampled, table)

    def _wave(self, signal: Signal, highest_hz: float) -> Array:
        """Return the wave that a signal is, as one that Python samples where it is none."""
        wave = np.zeros(COLUMNS)
        wave[SHAPE] = SAMPLED
        if self._tables_only:
            return wave
        if type(signal) is Sine or type(signal) is Triangle:
            wave[SHAPE] = SINE if type(signal) is Sine else TRIANGLE
            wave[FREQUENCY], wave[ANGLE] = signal.frequency_hz, signal.phase_rad
            fastest = max(signal.frequency_hz, highest_hz)
        elif type(signal) is Multisine and signal.lines <= _MOST_LINES:
            wave[SHAPE], wave[FREQUENCY] = MULTISINE, signal.frequency_hz
            wave[SEED], wave[LINES] = signal.seed, signal.lines
            wave[APART] = 2.0 if signal.odd else 1.0
            fastest = max(signal.frequency_hz, highest_hz) * 2 * signal.lines
        else:
            return wave
        wave[HEIGHT], wave[MIDDLE] = signal.amplitude_um, signal.offset_um
        if not self._fits(signal, fastest):
            wave[SHAPE] = SAMPLED
            return wave
        wave[START] = self._rise(signal.smooth_start_s)
        return wave

    def _fits(self, signal: Signal, fastest_hz: float) -> bool:
        """Say whether a wave is sure to stay within what can be shown, and its formula exact."""
        if 2.0 * np.pi * fastest_hz * self._ts_s > _FASTEST_RAD:
            return False
        extremes = np.array(
            [0.0, signal.offset_um - signal.amplitude_um, signal.offset_um + signal.amplitude_um]
        )
        centre = self._single.layout.centre_um
        return bool(np.abs(extremes - centre).max() <= self._single.bound_um)

    def _rise(self, duration_s: float) -> int:
        """Return the row of `rises` for a smooth start of so long, made where there is none."""
        if duration_s not in self._durations_s:
            self._durations_s.append(duration_s)
            samples = max(int(np.ceil(each / self._ts_s)) for each in self._durations_s) + 2
            t: Array = self._ts_s * np.arange(samples, dtype=np.float64)
            self.rises = np.array(
                [
                    smoothstep(t / each) if each > 0.0 else np.ones(samples)
                    for each in self._durations_s
                ]
            )
        return self._durations_s.index(duration_s)
