"""A plant as a program: its chain's kernels one after the other, for hardware in the loop."""

from __future__ import annotations

from typing import Any

import numpy as np

from rdpi_gym.firmware.program import Block, Known, Memory, Program, Table
from rdpi_gym.firmware.translation.kernels import Functions
from rdpi_gym.plant import Plant, PlantModel, pack
from rdpi_gym.plant.chain import ACTS_ON, CHAIN, COMMAND, DISPLACEMENT, RATE
from rdpi_gym.plant.cores.base import check_ts
from rdpi_gym.plant.cores.play import rate_block
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

_STATED = 1 << 24
"""Up to which count a float holds every whole number."""


def plant_program(model: PlantModel[Any], ts_s: float) -> Program:
    """Return one sample of a plant as C.

    It begins at rest at the command nearest 0 V, as an episode does. The sensor's noise and its
    rounding are left out: they belong to the test bench.
    """
    check_ts(ts_s)
    low, high = model.command_range_V
    rest = min(max(0.0, low), high)
    written = _Plant(model, ts_s, rest)
    clocked = [e.name for e in model.effects if e.clocked]
    notes = ["The sensor's noise and resolution are not part of it."]
    if clocked:
        lasts = _STATED * ts_s
        notes.append(
            f"{', '.join(clocked)} counts samples: in single precision the count stands still after "
            f"{_STATED} of them, {lasts:.3g} s."
        )
    return Program(
        kind="plant",
        title=model.name,
        model=model.name,
        ts_s=float(ts_s),
        preview=0,
        command_range_V=(float(low), float(high)),
        rest_V=float(rest),
        centre_um=float(model.reference_um[0]),
        scale_um=float(model.reference_um[1]),
        tables=tuple(written.tables),
        memory=tuple(written.memory),
        functions=written.functions.text,
        step="\n".join(written.lines),
        mathematics=written.functions.mathematics,
        twin=PlantTwin(model, ts_s, rest),
        exact=not written.functions.inexact,
        inexact_because="; ".join(sorted(written.functions.inexact)),
        notes=tuple(notes),
    )


class _Plant:
    def __init__(self, model: PlantModel[Any], ts_s: float, rest_V: float) -> None:
        self.functions = Functions()
        self.tables: list[Table] = []
        self.memory: list[Memory] = []
        self.lines: list[str] = []
        self._ts_s, self._made = ts_s, 0
        core = model.hysteresis
        has_stages = any(effect.slot != "memory" for effect in model.effects)
        parameters = pack([core], ts_s, [0.0 if has_stages else model.offset_um])
        begun = Plant(model, ts_s)
        begun.reset(u0_V=rest_V)
        own = begun.snapshot()[0]
        signals: list[Block] = [self._array("command", "command_V")] * 3
        held = model.converter.samples(ts_s)
        if held > 1:
            signals[COMMAND] = self._held(held)
        p, state = self._table("core", parameters), self._remembered("core", own)
        stages: dict[str, list[Any]] = {}
        for effect in model.effects:
            if effect.slot != "memory":
                stages.setdefault(effect.slot, []).append(effect)
        for place in CHAIN:
            if place == "derivative":
                signals[RATE] = self._run(rate_block, signals[COMMAND], p, state, Known(ts_s))
            elif place == "core":
                block = type(core).block
                signals[DISPLACEMENT] = self._run(block, signals[COMMAND], signals[RATE], p, state)
            else:
                for effect in stages.get(place, ()):
                    signals[ACTS_ON[place]] = self._stage(
                        effect, core, signals[ACTS_ON[place]], signals[COMMAND]
                    )
        offset = f" + RDPI_C({float(model.offset_um)!r})" if has_stages else ""
        self.lines.append(f"    return {signals[DISPLACEMENT].text}[0]{offset};")

    def _stage(self, effect: Any, core: Any, x: Block, u: Block) -> Block:
        column = np.array(effect.coefficients(self._ts_s, core), dtype=np.float64)
        rows = effect.state_rows_with(self._ts_s, core)
        p = self._table(effect.name, column[:, None]) if len(column) else Block("0", (0, 1))
        state = Block("0", (0, 1))
        if rows:
            state = self._remembered(effect.name, np.full((rows, 1), np.nan))
        return self._run(type(effect).block, x, u, p, state, Known(self._ts_s))

    def _run(self, kernel: Any, *arguments: Block | Known) -> Block:
        out = self._array(f"signal_{self._made}")
        self._made += 1
        try:
            called = self.functions.call(kernel, [*arguments, out], self._local)
        except InputError as error:
            raise InputError(f"{error}: there is no C of it") from None
        assert called.statement is not None
        self.lines.append(f"    {called.statement}")
        return out

    def _local(self, kind: str, count: int) -> str:
        raise InputError("a stage that returns an array")

    def _array(self, name: str, start: str = "") -> Block:
        text = f"    rdpi_real {name}[1]" + (f" = {{{start}}};" if start else ";")
        self.lines.append(text)
        return Block(name, (1, 1))

    def _held(self, samples: int) -> Block:
        """The command as a converter shows it, which is refreshed once in so many samples."""
        count = self._remembered("converter", np.zeros((2, 1)))
        self.lines += [
            f"    if ({count.text}[0] <= RDPI_C(0.0)) {{",
            f"        {count.text}[0] = RDPI_C({float(samples)!r});",
            f"        {count.text}[1] = command[0];",
            "    }",
            f"    {count.text}[0] -= RDPI_C(1.0);",
            f"    command[0] = {count.text}[1];",
        ]
        return Block("command", (1, 1))

    def _table(self, name: str, column: Array) -> Block:
        self.tables.append(Table(name, column.ravel()))
        return Block(f"p->{name}", column.shape, known=column)

    def _remembered(self, name: str, start: Array) -> Block:
        values = start.ravel().copy()
        self.memory.append(Memory(name, values, np.zeros(len(values))))
        return Block(f"m->{name}", start.shape)


class PlantTwin:
    """The plant in Python, from the same rest: what its C is held against."""

    def __init__(self, model: PlantModel[Any], ts_s: float, rest_V: float) -> None:
        self._model, self._ts_s, self._rest_V = model, ts_s, rest_V

    def plant(self, command_V: Array) -> Array:
        """Return displacements (µm), float64[T, B], of commands (V), lane by lane from rest."""
        lanes = command_V.shape[1]
        plant = Plant(self._model, self._ts_s)
        found = np.empty_like(command_V, dtype=np.float64)
        for lane in range(lanes):
            plant.reset(u0_V=self._rest_V)
            found[:, lane] = plant.simulate(command_V[:, lane])
        return found

    def controller(self, reference_um: Array, measured_um: Array) -> Array:
        """Raise: a plant is no controller."""
        raise InputError("a plant answers commands, not references")
