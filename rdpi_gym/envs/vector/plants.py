"""Plants of many lanes: core and effects, the table of their stages, and the parameters of each lane."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Any, cast

import numpy as np
from numba import njit

from rdpi_gym.envs.draw_laws import BLOCK, DrawLaw, Glide, Wear
from rdpi_gym.envs.truth import EFFECT_LEVELS, drawn_parameters, effect_at
from rdpi_gym.envs.vector.begin import scale_packed, settle_plays
from rdpi_gym.envs.vector.chain import Table, core_address, stage_address
from rdpi_gym.envs.vector.lanes import NEVER, Flags, Integers, Lanes, lane_by_lane
from rdpi_gym.plant import RDPI, PlantModel, pack
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.cores.play import given_rate_block
from rdpi_gym.plant.effects import Effect
from rdpi_gym.plant.effects.base import SLOTS
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError


class CoreLanes:
    """The core of a plant, about which those of the lanes are drawn."""

    def __init__(self, model: PlantModel, ts_s: float) -> None:
        self._nominal: Core = model.hysteresis
        self._ts_s = ts_s
        self.factors, self._gaps_V = self._nominal.factors, self._nominal.gaps_V
        self.rows = (len(pack([self._nominal], ts_s, [0.0])), 2 + self._nominal.n)
        kind = type(self._nominal)
        self.together = kind.together if kind.lanes_block else self.rows[0] - 2

    @property
    def kernel(self) -> int:
        """Address of its kernel in this process."""
        kind = type(self._nominal)
        return core_address(kind.lanes_block or kind.block, self._nominal.name)

    def column(self, model: PlantModel, offset_um: float) -> Array:
        """Return the parameters of a plant with the same kind of core, float64[P]."""
        core, nominal = model.hysteresis, self._nominal
        if core.name != nominal.name:
            raise InputError(
                f"plant {model.name} has the core {core.name}, and the lanes of this environment have "
                f"{nominal.name}; make an environment of that plant instead"
            )
        if (core.n, len(core.gains)) != (nominal.n, len(nominal.gains)):
            raise InputError(
                f"plant {model.name} has {len(core.gains)} gains of the core {core.name}, and the lanes of "
                f"this environment have {len(nominal.gains)}; make an environment of that plant instead"
            )
        return pack([core], self._ts_s, [offset_um])[:, 0].copy()

    def draw(self, core: Core, factors: Array, worn: Array | None, fresh: Lanes) -> LaneCores:
        """Put what lanes have drawn into a block that begins with the parameters of one plant.

        `worn` are the factors of their wear, if they wear.
        """
        rounds = [each for each in (factors, worn) if each is not None and each.shape[1]]
        cores = LaneCores(core, rounds)
        if rounds and core.drawn_as_packed:
            product = rounds[0] if len(rounds) == 1 else rounds[0] * rounds[1]
            scale_packed(len(core.gains), self._gaps_V, product, fresh)
        elif rounds:
            found, count = cores.coefficients(), len(rounds[0])
            fresh.p[0, : self.together, :count] = found[: self.together]
            lane_by_lane(fresh.p[0], self.together)[:count] = found[self.together :].T
        return cores

    def settle(self, rest_V: float, turns_V: Array, cores: LaneCores, fresh: Lanes) -> None:
        """Set the memory that a rest at `rest_V` (V) leaves of earlier turns (V), ``(K, m)``."""
        if type(self._nominal).block is given_rate_block:
            settle_plays(rest_V, turns_V, fresh)
            return
        count = turns_V.shape[1]
        memory, rest = np.zeros((self._nominal.n, count)), np.full(count, rest_V)
        if not len(turns_V) and rest_V == 0.0:  # where every core of a kind remembers the same
            fresh.state[0, 2:, :count] = self._nominal.resting(memory, rest)
            return
        if len(turns_V):
            for lane in range(count):
                memory[:, lane] = cores[lane].settled(turns_V[:, lane].tolist())
        for lanes in cores.alike(count):
            memory[:, lanes] = cores[lanes.start].resting(memory[:, lanes], rest[lanes])
        fresh.state[0, 2:, :count] = memory


class LaneCores:
    """The cores of lanes that begin, each made when it is first asked for."""

    def __init__(self, core: Core, rounds: Sequence[Array]) -> None:
        self._core, self._rounds = core, rounds
        self._made: dict[int, Core] = {}

    def __getitem__(self, lane: int) -> Core:
        if not self._rounds:
            return self._core
        if lane not in self._made:
            core = self._core
            for factors in self._rounds:
                core = core.scaled(factors[lane])
            self._made[lane] = core
        return self._made[lane]

    def coefficients(self) -> Array:
        """Return what the kernel reads of each lane's core, a column a lane."""
        if len(self._rounds) == 1:
            return self._core.scaled_coefficients(self._rounds[0])
        lanes = range(len(self._rounds[0]))
        return np.array([self[lane].coefficients() for lane in lanes]).T

    def alike(self, count: int) -> list[slice]:
        """Return stretches of the first `count` lanes that have one core each."""
        if not self._rounds:
            return [slice(0, count)]
        return [slice(lane, lane + 1) for lane in range(count)]


# Drawn parameters of an effect whose columns are kept at all levels: a thousand of them.
_FEW = 2


class _AccessRecorder:
    """A plant's hysteresis core that notices whether it is read."""

    def __init__(self, hysteresis: Core) -> None:
        self._hysteresis, self.read = hysteresis, False

    def __getattr__(self, name: str) -> Any:
        self.read = True
        return getattr(self._hysteresis, name)


class ColumnCache:
    """Columns of parameters at the levels of effects, each made when it is first drawn."""

    def __init__(self, counts: Sequence[int], rows: Integers) -> None:
        tables = [EFFECT_LEVELS**count for count in counts]
        sizes = rows[:, 1] - rows[:, 0]
        # Of each effect: levels, first row and end of its parameters, first column among the known,
        # and first place in the flat tables.
        self._places: Integers = np.column_stack(
            [
                counts, rows, np.cumsum([0, *tables[:-1]]),
                np.cumsum([0, *(sizes * tables)[:-1]]),
            ]
        ).astype(np.int64)  # fmt: skip
        self._known: Flags = np.zeros(sum(tables), dtype=bool)
        self._flat: Array = np.zeros(int((sizes * tables).sum()))

    def pick(
        self, levels: Integers, fresh: Lanes, make: Callable[[int, Sequence[int]], Sequence[float]]
    ) -> None:
        """Put the columns at the levels that lanes have drawn into a block that begins."""
        while True:
            lane, i = _pick(levels, self._places, self._known, self._flat, fresh.stage_p)
            if i < 0:
                return
            count, first, end, known, place = self._places[i].tolist()
            begin = int(self._places[:i, 0].sum())
            own = levels[lane, begin : begin + count].tolist()
            at = 0
            for level in own:
                at = at * EFFECT_LEVELS + level
            place += at * (end - first)
            self._flat[place : place + end - first] = make(i, own)
            self._known[known + at] = True


@njit(cache=True)
def _pick(
    levels: Integers, places: Integers, known: Flags, flat: Array, stage_p: Array
) -> tuple[int, int]:
    """Copy the columns; return the lane and the effect of one that is not known, or -1 and -1."""
    for lane in range(len(levels)):
        level = 0
        for i in range(len(places)):
            count, first, end = places[i, 0], places[i, 1], places[i, 2]
            at = 0
            for _ in range(count):
                at = at * EFFECT_LEVELS + levels[lane, level]
                level += 1
            if not known[places[i, 3] + at]:
                return lane, i
            place = places[i, 4] + at * (end - first)
            for row in range(first, end):
                stage_p[0, row, lane] = flat[place + row - first]
    return -1, -1


class EffectStages:
    """The stages of a plant's effects, and what follows from the parameters of each lane.

    `table` is as :data:`rdpi_gym.envs.vector.chain.Table`, `rows` holds the rows of the parameters
    and of the states of all stages; `reads_hysteresis` says whether a stage's parameters follow from
    those of the core too.
    """

    def __init__(self, model: PlantModel, ts_s: float, half_width: float) -> None:
        self._ts_s, self._half_width = ts_s, half_width
        self._effects = model.effects
        self._stages = [i for i, e in enumerate(model.effects) if e.slot != "memory"]
        self._counts = [len(drawn_parameters(effect)) for effect in model.effects]
        self._at: dict[tuple[int, ...], tuple[Effect, list[float]]] = {}
        self._reading = set()
        rows, p_row, state_row = [], 0, 0
        for i in self._stages:
            effect = model.effects[i]
            watched = _AccessRecorder(model.hysteresis)
            size = len(effect.coefficients(ts_s, cast(Core, watched)))
            if watched.read:
                self._reading.add(i)
            states = self._state_rows(effect, model.hysteresis)
            ends = (p_row, p_row + size, state_row, state_row + states)
            rows.append((0, SLOTS.index(effect.slot), *ends))
            p_row, state_row = p_row + size, state_row + states
        self.table: Table = np.array(rows, dtype=np.int64).reshape(-1, 6)
        self.find_kernels()
        self.rows = (p_row, state_row)
        self.reads_hysteresis = bool(self._reading)
        self.levels = sum(self._counts) if half_width > 0.0 else 0
        # Kernels pick columns alone where each stage's follow from its own few levels.
        self._cache: ColumnCache | None = None
        few = all(self._counts[i] <= _FEW for i in self._stages)
        if self.levels and few and not self._reading and len(self._stages) == len(self._effects):
            self._cache = ColumnCache(self._counts, self.table[:, 2:4])

    def find_kernels(self) -> None:
        """Write the addresses of the kernels, which hold in one process alone, into the table."""
        for i, row in zip(self._stages, self.table, strict=True):
            effect = type(self._effects[i])
            row[0] = stage_address(effect.block, effect.name)

    def column(self, model: PlantModel) -> Array:
        """Return the stages' parameters of a plant with the same effects, float64[P']."""
        both = model.effects, self._effects
        if [type(effect) for effect in both[0]] != [type(effect) for effect in both[1]]:
            names = ("; ".join(effect.full_name() for effect in effects) for effects in both)
            has, needs = (each or "no effects" for each in names)
            raise InputError(
                f"plant {model.name} has {has}, and the lanes of this environment have {needs}; "
                "make an environment of that plant instead"
            )
        for i, row in zip(self._stages, self.table.tolist(), strict=True):
            if model.effects[i].state_rows_with(self._ts_s, model.hysteresis) > row[5] - row[4]:
                raise InputError(
                    f"{model.effects[i].name} of plant {model.name} needs a longer memory than the lanes "
                    "of this environment have; make an environment of that plant instead"
                )
        return self._packed([model.effects[i] for i in self._stages], model.hysteresis)

    def draw(
        self,
        levels: Integers,
        fresh: Lanes,
        cores: LaneCores,
        rest_V: float,
        turns_V: Array,
    ) -> Array:
        """Put the parameters at the levels that lanes have drawn into a block that begins."""
        if self._cache is not None and levels.shape[1]:
            self._cache.pick(levels, fresh, self._column_at)
            return turns_V
        for lane, at in enumerate(levels.tolist()):
            effects, columns = self._at_levels(at)
            for i, (first, end) in zip(self._stages, self.table[:, 2:4].tolist(), strict=True):
                column = columns[i]
                if i in self._reading:
                    column = effects[i].coefficients(self._ts_s, cores[lane])
                fresh.stage_p[0, first:end, lane] = column
            for effect in effects:
                if effect.slot == "memory":
                    turns_V[:, lane] = effect.turns_from(rest_V)
        return turns_V

    def values(self, i: int, levels: Integers) -> dict[str, Array]:
        """Return the parameters of an effect at the levels that lanes have drawn."""
        effect, count = self._effects[i], len(levels)
        begin, middle = sum(self._counts[:i]), (EFFECT_LEVELS - 1) / 2
        found = {name: np.full(count, value) for name, value in effect.values.items()}
        for j, name in enumerate(drawn_parameters(effect) if levels.shape[1] else ()):
            found[name] *= 1.0 + self._half_width * (levels[:, begin + j] / middle - 1.0)
        return type(effect).bounded(found)

    def place_of(self, name: str) -> tuple[int, list[int]] | None:
        """Return the number of an effect and its row of the table; None: no stage has the name."""
        for i, row in zip(self._stages, self.table.tolist(), strict=True):
            if self._effects[i].name == name:
                return i, row
        return None

    def columns(self, i: int, values: Mapping[str, Array], cores: LaneCores | None) -> Array:
        """Return the parameters of an effect's stage at values that lanes have, a column a lane."""
        kind = type(self._effects[i])
        if i not in self._reading:
            return kind.columns(values, self._ts_s)
        assert cores is not None
        lanes = range(len(next(iter(values.values()))))
        made = (
            kind(**{k: float(v[lane]) for k, v in values.items()}).coefficients(
                self._ts_s, cores[lane]
            )
            for lane in lanes
        )
        return np.array(list(made)).T

    def wear(
        self, law: Wear, levels: Integers, life: Array, fresh: Lanes, cores: LaneCores
    ) -> None:
        """Put the parameters of effects that have worn into a block that begins."""
        for name in law.effects:
            place = self.place_of(name)
            if place is not None:
                i, row = place
                worn = self.worn_values(i, levels, law, life)
                fresh.stage_p[0, row[2] : row[3], : len(life)] = self.columns(i, worn, cores)

    def worn_values(
        self, i: int, levels: Integers, law: Wear | None, life: Array
    ) -> dict[str, Array]:
        """Return the parameters of an effect at levels after shares of its life."""
        values, name = self.values(i, levels), self._effects[i].name
        if law is None or name not in law.effects:
            return values
        parameter, change = law.effects[name]
        values[parameter] = values[parameter] * (1.0 + change * life)
        return type(self._effects[i]).bounded(values)

    def all_values(self, levels: Integers, law: Wear | None, life: Array) -> Array:
        """Return the parameters of every effect of lanes, float64[K, m]."""
        found = [
            value
            for i in range(len(self._effects))
            for value in self.worn_values(i, levels, law, life).values()
        ]
        return np.array(found).reshape(len(found), len(levels))

    def row_of(self, i: int, parameter: str) -> int:
        """Return the row of a parameter among those of :meth:`all_values`."""
        before = sum(len(effect.values) for effect in self._effects[:i])
        return before + list(self._effects[i].values).index(parameter)

    @property
    def count(self) -> int:
        """Number of parameters of all effects."""
        return sum(len(effect.values) for effect in self._effects)

    def kind(self, i: int) -> type[Effect]:
        """Return the class of an effect."""
        return type(self._effects[i])

    @property
    def ts_s(self) -> float:
        """Sampling time (s)."""
        return self._ts_s

    def _at_levels(self, levels: Sequence[int]) -> tuple[list[Effect], list[list[float]]]:
        effects, columns, begin = [], [], 0
        for i, count in enumerate(self._counts):
            own = tuple(levels[begin : begin + count])
            begin += count if own else 0
            if (i, *own) not in self._at:
                effect = self._effects[i]
                if own:
                    effect = effect_at(effect, own, self._half_width)
                column = [] if i in self._reading else self._coefficients(effect)
                self._at[(i, *own)] = effect, column
            effect, column = self._at[(i, *own)]
            effects.append(effect)
            columns.append(column)
        return effects, columns

    def _column_at(self, i: int, levels: Sequence[int]) -> list[float]:
        return self._coefficients(effect_at(self._effects[i], levels, self._half_width))

    def _coefficients(self, effect: Effect) -> list[float]:
        return effect.coefficients(self._ts_s, RDPI((1.0,), (), 0.0))

    def _packed(self, effects: Sequence[Effect], hysteresis: Core) -> Array:
        columns = [effect.coefficients(self._ts_s, hysteresis) for effect in effects]
        return np.array([value for column in columns for value in column], dtype=np.float64)

    def _state_rows(self, effect: Effect, hysteresis: Core) -> int:
        """Rows of the largest state among an effect's levels.

        At every corner of the parameters that change it by themselves: of dozens there are too many.
        """
        middle = EFFECT_LEVELS // 2
        last = EFFECT_LEVELS - 1

        def rows(levels: Sequence[int]) -> int:
            one = effect_at(effect, levels, self._half_width)
            return one.state_rows_with(self._ts_s, hysteresis)

        count = len(drawn_parameters(effect))
        centre = rows([middle] * count)
        ends = []
        for i in range(count):
            alone = [rows([middle] * i + [end] + [middle] * (count - 1 - i)) for end in (0, last)]
            ends.append((middle,) if alone == [centre, centre] else (0, middle, last))
        return max(rows(levels) for levels in product(*ends))


class Glides:
    """Parameters of an effect that change within the episodes of B lanes: see :class:`Glide`.

    Attributes
    ----------
    due : int
        First step at which a lane changes.
    """

    def __init__(self, law: Glide, wear: Wear | None, effects: EffectStages, lanes: int) -> None:
        place = effects.place_of(law.effect)
        if place is None:
            raise InputError(f"no effect {law.effect} changes; give a plant that has it")
        self._law, self._wear, self._effects = law, wear, effects
        self._i, self._row = place
        self._next: Integers = np.full(lanes, NEVER)
        self._done: Integers = np.zeros(lanes, dtype=np.int64)
        self._last: Array = np.zeros(lanes)
        self._values = effects.values(self._i, np.empty((lanes, 0), dtype=np.int64))
        self.due = NEVER

    @property
    def beginnings(self) -> int:
        """Number of samples at which a change may begin."""
        return self._law.spread // BLOCK

    def begin(
        self, step: int, indices: Integers, levels: Integers, drawn: Array, life: Array
    ) -> None:
        """Plan the changes of lanes that begin; none where nothing is drawn."""
        self._next[indices] = NEVER
        if len(drawn):
            law = self._law
            wear = self._wear if len(life) else None
            values = self._effects.worn_values(self._i, levels, wear, life)
            for name, own in values.items():
                self._values[name][indices] = own
            value = values[law.parameter]
            fraction = law.low + (law.high - law.low) * drawn[:, 1]
            self._last[indices] = np.maximum(value * fraction, np.minimum(law.lowest, value))
            self._done[indices] = 0
            self._next[indices] = step + law.first + BLOCK * drawn[:, 0].astype(np.int64)
        self.due = int(self._next.min())

    def change(self, step: int, lanes: Lanes, latents: Array) -> None:
        """Change the lanes that are due at a step; what their stages remember is carried on.

        `latents` are latent parameters of all lanes, those of effects last; without columns, none.
        """
        law, own = self._law, np.flatnonzero(self._next <= step)
        done, first = self._done[own], {k: v[own] for k, v in self._values.items()}
        value, last = first[law.parameter], self._last[own]

        def at(count: Integers) -> dict[str, Array]:
            return {**first, law.parameter: value * (last / value) ** (count / law.steps)}

        before, after = at(done), at(done + 1)
        kind, width = self._effects.kind(self._i), lanes.state.shape[2]
        n, b = own // width, own % width
        _, _, p, p_end, s, s_end = self._row
        lanes.stage_p[n, p:p_end, b] = kind.columns(after, self._effects.ts_s).T
        state = lanes.stage_state[n, s:s_end, b].T
        kind.carry_columns(state, before, after)
        lanes.stage_state[n, s:s_end, b] = state.T
        if latents.shape[1]:
            last_rows = self._effects.row_of(self._i, law.parameter) - self._effects.count
            latents[own, last_rows] = after[law.parameter]
        self._done[own] = done + 1
        self._next[own] = np.where(done + 1 < law.steps, self._next[own] + BLOCK, NEVER)
        self.due = int(self._next.min())


def wear_of(law: DrawLaw) -> Wear | None:
    """Return the wear of plants as data, or refuse a law that is a function of Python."""
    if law.ageing is None or isinstance(law.ageing, Wear):
        return law.ageing
    raise InputError(
        f"ageing {law.ageing!r} is a function, which lanes cannot share; give a Wear, or make "
        "single environments with vectorization_mode='sync'"
    )


def glides_of(law: DrawLaw, effects: EffectStages, lanes: int) -> Glides | None:
    """Return the changes within episodes, or refuse a law that is a function of Python."""
    if law.schedule is None:
        return None
    if isinstance(law.schedule, Glide):
        return Glides(law.schedule, wear_of(law), effects, lanes)
    raise InputError(
        f"schedule {law.schedule!r} is a function, which lanes cannot share; give a Glide, or make "
        "single environments with vectorization_mode='sync'"
    )
