"""From a model and a controller's name to what an export writes, and back from what it wrote."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.base import Baseline, Rows
from baselines.feedforward import Feedforward
from baselines.lookup import GUARDED, LEARNED, make_controller
from baselines.registry import known_controller
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.truth import limit_band
from rdpi_gym.firmware.fixed_point import FixedPoint, fixed_point_body
from rdpi_gym.firmware.program import Block, Known, Memory, Part, Program, Table
from rdpi_gym.firmware.tracing.arrays import Inputs, Recording, Store, Tables, Traced, constant
from rdpi_gym.firmware.tracing.functions import NUMPY
from rdpi_gym.firmware.tracing.intercepting import Interception, named_arrays
from rdpi_gym.firmware.tracing.statements import text_of
from rdpi_gym.firmware.tracing.tape import Tape, recorded
from rdpi_gym.firmware.translation.kernels import Functions
from rdpi_gym.firmware.writing.package import Package
from rdpi_gym.firmware.writing.source import Source
from rdpi_gym.plant import RDPI, Plant, PlantModel, pack
from rdpi_gym.plant.chain import ACTS_ON, CHAIN, COMMAND, DISPLACEMENT, RATE
from rdpi_gym.plant.cores.base import check_ts
from rdpi_gym.plant.cores.play import rate_block
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted, some

# First references (µm) at which the memory at rest is looked at, in scales about the centre.
_FIRST = (0.0, 1.0, -1.0, 0.3, -0.71828)


class PhysicalLayout(ObservationLayout):
    """A layout that shows micrometres and volts as they are: nothing is scaled, so nothing rounds.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> layout = PhysicalLayout.for_plant(named_plant("P5"), ts_s=1e-4, preview=1)
    >>> layout.measured_um(np.array([[1.0, 2.0, 3.0, 4.0]])).tolist()
    [3.0]
    """

    def reference_um(
        self, observation: NDArray[np.floating], samples: slice = slice(None)
    ) -> Array:
        """See :meth:`ObservationLayout.reference_um`."""
        return observation[..., self.columns["reference"]][..., samples]  # type: ignore[return-value]

    def measured_um(self, observation: NDArray[np.floating]) -> Array:
        """See :meth:`ObservationLayout.measured_um`."""
        return observation[..., self.columns["measured"].start]  # type: ignore[return-value]

    def command_V(self, observation: NDArray[np.floating]) -> Array:
        """See :meth:`ObservationLayout.command_V`."""
        return observation[..., self.columns["command"].start]  # type: ignore[return-value]


@dataclass(frozen=True)
class ControllerTwin:
    """A controller in Python, fed with what the C is fed with."""

    made: Baseline

    def __call__(self, reference_um: Array, measured_um: Array) -> Array:
        """Return commands (V), float64[T, B], from rest."""
        lanes = reference_um.shape[1]
        if lanes == 1:  # a single lane is summed in another order than several
            both = np.repeat(reference_um, 2, axis=1), np.repeat(measured_um, 2, axis=1)
            return self(*both)[:, :1]
        made, layout = self.made, self.made.layout
        state = made.start(reference_um[0])
        applied = np.full(lanes, made.limits.rest_V)
        u = np.empty_like(measured_um)
        for k, measured in enumerate(measured_um):
            window = reference_um[k : k + layout.preview + 1]
            shown = observed(layout, window, measured, applied)
            pair = np.ascontiguousarray(window[:2])
            applied = u[k] = made.next_command(shown, pair, state)
        return u


def observed(layout: ObservationLayout, reference_um: Any, measured_um: Any, applied_V: Any) -> Any:
    """Return observations ``(B, D)`` of what was measured and commanded."""
    if isinstance(layout, PhysicalLayout):
        known = {
            "reference": reference_um,
            "measured": measured_um[None],
            "command": applied_V[None],
        }
        return np.concatenate([known[name] for name in layout.fields]).T
    shown = (reference_um - layout.centre_um) / layout.scale_um
    ends = reference_um[-1], reference_um[0]
    return np.concatenate(layout.encode(shown, ends, measured_um, applied_V)).T


def controller_program(
    name: str,
    belief: PlantModel[Any],
    ts_s: float,
    preview: int | None = None,
) -> Program:
    """Return a controller's sample as C: of the one that scores, whose belief has a band-limited rate."""
    if not name.startswith((LEARNED, GUARDED)):
        kind = known_controller(name)
        if hasattr(getattr(kind, "func", kind), "plan"):
            raise InputError(
                f"{name} plans over the whole reference before an episode, which code that runs sample "
                "by sample does not have; name another, such as pi-classical-reference-rate"
            )
    return traced_program(_made(name, limit_band(belief), ts_s, preview), name)


def traced_program(made: Baseline, title: str) -> Program:
    """Return the sample of a controller that was made, as C; see :func:`controller_program`."""
    layout = made.layout
    tracer = _Tracer(made)
    rest, by_reference, is_affine = _affine_start(made)
    count = len(rest)

    def step(recording: Recording) -> None:
        ahead = "ahead_um", layout.preview
        scalars = (("reference_um", None), ("measured_um", None), ("applied_V", None))
        given = Inputs(recording, [scalars[0], ahead, *scalars[1:]])
        places = np.arange(layout.preview + 3, dtype=np.int64)[:, None]
        column: Any = Traced(given, places)
        window = column[: layout.preview + 1]
        if isinstance(layout, PhysicalLayout):  # a view of the inputs, in the order of the fields
            shown = Traced(given, observed(layout, places[:-2], places[-2], places[-1]))
        else:
            shown = observed(layout, window, column[-2], column[-1])
        traced: Any = shown, window[:2], _memory(recording, count)
        command: Any = made.next_command(*traced)
        if not isinstance(command, Traced):  # the same whatever is measured
            value = constant(command[0])
        else:
            value = command.store.element(int(command.places.flat[0]))
        recording.tape.write(f"return {value};", keeps=True)

    def begin(recording: Recording) -> None:
        given = Inputs(recording, [("reference_um", None)])
        reference: Any = Traced(given, np.zeros(1, dtype=np.int64))
        _memory(recording, count)[:] = made.start(reference)

    body = tracer.text(step)
    begins = "" if is_affine else tracer.text(begin)
    called = f"{tracer.functions.text}\n{body}\n{begins}"
    return Program(
        kind="controller",
        title=title,
        model=made.belief.name,
        ts_s=layout.ts_s,
        preview=layout.preview,
        command_range_V=(made.limits.low_V, made.limits.high_V),
        rest_V=made.limits.rest_V,
        centre_um=layout.centre_um,
        scale_um=layout.scale_um,
        tables=[_with_parts(t, made) for t in tracer.tables.all if f"p->{t.name}" in called],
        memory=[Memory("state", rest, by_reference, parts=_rows(made, count))] if count else [],
        functions=tracer.functions.text,
        step=body,
        begin=begins,
        mathematics=frozenset(each for each in tracer.mathematics if f"RDPI_{each}(" in called),
        twin=ControllerTwin(made),
        exact=not tracer.inexact,
        inexact_because="; ".join(tracer.inexact),
    )


class _Tracer:
    """Traces pieces of one controller, which share their kernels and tables."""

    def __init__(self, made: Baseline) -> None:
        self.functions, self.tables = Functions(), Tables(named_arrays(made))
        self._interception = Interception(
            made, self.functions, Recording(Tape(), self.tables, NUMPY)
        )
        self._runs: list[Recording] = []

    def text(self, piece: Callable[[Recording], None]) -> str:
        """Return the C of a piece of code."""

        def run(tape: Tape) -> None:
            recording = Recording(tape, self.tables, NUMPY)
            self._runs.append(recording)
            self._interception.recording = recording
            piece(recording)

        with self._interception.active():
            return text_of(recorded(run))

    @property
    def inexact(self) -> list[str]:
        """Why it is not equal to Python bit by bit, if it is not."""
        own = dict.fromkeys(why for run in self._runs for why in run.inexact)
        return [*own, *sorted(self.functions.inexact | self.functions.by_lanes)]

    @property
    def mathematics(self) -> set[str]:
        """Functions of the mathematics that are called."""
        own = {each for run in self._runs for each in run.mathematics}
        return own | self.functions.mathematics


def _memory(recording: Recording, count: int) -> Traced:
    store = Store(recording, "m->state", count, local=False)
    return Traced(store, np.arange(count, dtype=np.int64)[:, None])


def _rows(owner: object, count: int, over: str = "") -> list[Part]:
    """Return the named rows of a memory, those of an inner controller by its own names; none is stated: none."""
    rows = getattr(owner, "rows", None)
    if not isinstance(rows, Rows) or rows.total != count:
        return [Part(over.rstrip("_"), count)] if over else []
    return [
        part
        for name, own in rows.counts.items()
        if own
        for part in _rows(getattr(owner, name, None), own, f"{over}{name}_")
    ]


def _with_parts(table: Table, made: Baseline) -> Table:
    """Return a table with the names of what a feedforward packs, if it is that."""
    inner = [made, *(each for each in vars(made).values() if isinstance(each, Baseline))]
    inner += [part for each in inner[1:] for part in vars(each).values()]
    for each in inner:
        if isinstance(each, Feedforward) and each.needs_core is RDPI:
            column = each._parameters.ravel()
            if each.packed.total == len(column) and np.array_equal(column, table.values):
                return replace(table, parts=[Part(*own) for own in each.packed.counts.items()])
    return table


def _parts(stated: Mapping[str, Any], units: Mapping[str, str], column: Array) -> list[Part]:
    """Return the numbers that stand in a column in the order of their declaration; else none."""
    found = {name: np.ravel(value).astype(np.float64) for name, value in stated.items()}
    numbers = np.concatenate([*found.values(), np.empty(0)])
    if not np.array_equal(numbers, column.ravel()[: len(numbers)]):
        return []
    parts = [Part(name, len(each), units.get(name, "")) for name, each in found.items()]
    return [part for part in parts if part.count]


def _made(name: str, belief: PlantModel[Any], ts_s: float, preview: int | None) -> Baseline:
    """Return a controller with the preview, or with as much as it makes use of."""
    kind = ObservationLayout if name.startswith((LEARNED, GUARDED)) else PhysicalLayout

    def make(samples: int) -> Baseline:
        made = make_controller(name, belief, kind.for_plant(belief, ts_s, preview=samples))
        assert isinstance(made, Baseline)
        return made

    made = make(1 if preview is None else preview)
    while preview is None and made.needed_preview > made.layout.preview:
        made = make(made.needed_preview)
    return made


def _affine_start(made: Baseline) -> tuple[Array, Array, bool]:
    """Return the memory at rest of a first reference of 0 µm, what each µm adds, and whether that is all."""
    layout = made.layout
    references = np.array([0.0, 1.0, *(layout.centre_um + layout.scale_um * x for x in _FIRST)])
    started = made.start(references)
    rest = started[:, 0].copy()
    by_reference = np.where(np.isnan(rest), 0.0, started[:, 1] - rest)
    affine = rest[:, None] + by_reference[:, None] * references
    return rest, by_reference, bool(np.array_equal(affine, started, equal_nan=True))


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
        twin=_plant_twin(model, ts_s, rest),
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
        units = {each.name: each.unit for each in core.shape}
        stated = {each.name: getattr(core, each.name) for each in fields(core)}
        del stated["rate_bandwidth_hz"]
        parts = _parts(stated, units, parameters)
        last = [Part("rate_pole", 1), Part("offset_um", 1)]
        if sum(part.count for part in parts) + len(last) != len(parameters):
            parts, last = [], []
        p = self._table("core", parameters, [*parts, *last])
        state = self._remembered(
            "core", own, [Part("last_command_V", 1), Part("last_rate_V_s", 1), Part("past", core.n)]
        )
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
        p = Block("0", (0, 1))
        if len(column):
            units = {each.name: each.unit for each in effect.parameters}
            parts = _parts(effect.values, units, column)
            about = ", ".join(f"{name} = {value:.6g}" for name, value in effect.values.items())
            p = self._table(effect.name, column[:, None], parts, about)
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

    def _table(
        self, name: str, column: Array, parts: Sequence[Part] = (), about: str = ""
    ) -> Block:
        whole = sum(part.count for part in parts) == column.size
        kept = parts if whole else ()
        self.tables.append(Table(name, column.ravel(), parts=kept, about=about))
        return Block(f"p->{name}", column.shape, known=column)

    def _remembered(self, name: str, start: Array, parts: Sequence[Part] = ()) -> Block:
        values = start.ravel().copy()
        self.memory.append(Memory(name, values, np.zeros(len(values)), parts=parts))
        return Block(f"m->{name}", start.shape)


def _plant_twin(model: PlantModel[Any], ts_s: float, rest_V: float) -> Callable[[Array], Array]:
    """Return a plant in Python: displacements (µm) of commands (V), float64[T, B], lane by lane from rest."""

    def simulate(command_V: Array) -> Array:
        plant = Plant(model, ts_s)
        found = np.empty_like(command_V, dtype=np.float64)
        for lane in range(command_V.shape[1]):
            plant.reset(u0_V=rest_V)
            found[:, lane] = plant.simulate(command_V[:, lane])
        return found

    return simulate


_WALK = 400
"""Commands of the slow walk that says what a range reaches."""


def program_of(
    model: PlantModel[Any], ts_s: float, controller: str | None = None, preview: int | None = None
) -> Program:
    """Return a plant, or a controller that believes in it, as a program."""
    check_ts(ts_s)
    if controller is None:
        if preview is not None:
            raise InputError("preview is of controllers; leave it out, or name one")
        return plant_program(model, ts_s)
    return controller_program(controller, model, ts_s, preview)


def package_of(
    model: PlantModel[Any],
    ts_s: float,
    controller: str | None = None,
    preview: int | None = None,
    prefix: str | None = None,
) -> Package:
    """Return what an export of :func:`program_of` writes."""
    program = program_of(model, ts_s, controller, preview)
    recipe: dict[str, Any] = {
        "kind": program.kind,
        "model": model.to_dict(),
        "ts_s": program.ts_s,
        "exact": program.exact,
        **({} if prefix is None else {"prefix": prefix}),
    }
    if program.kind == "plant":
        return Package(Source(program, prefix=prefix), recipe)
    recipe |= {"controller": _found_anywhere(controller or ""), "preview": program.preview}
    fixed, why = _fixed(program)
    warning = program.twin.made.warning() if isinstance(program.twin, ControllerTwin) else None
    notes, warnings = (() if each is None else (each,) for each in (why, warning))
    return Package(Source(program, reach_um(model, ts_s), fixed, prefix), recipe, warnings, notes)


def package_again(document: Mapping[str, Any], source: str) -> Package:
    """Return the package that a ``program.json`` describes."""
    known = {
        "format", "version", "kind", "model", "ts_s", "exact", "controller", "preview", "prefix"
    }  # fmt: skip
    if others := [key for key in document if key not in known]:
        raise InputError(
            f"{source} has the unknown key {quoted(others[0])}; known are {some(known)}"
        )
    kind, controller, preview = (document.get(key) for key in ("kind", "controller", "preview"))
    is_plant = kind == "plant" and controller is None and preview is None
    if not is_plant and not (kind == "controller" and isinstance(controller, str)):
        raise InputError(f"{source} describes neither a plant nor a controller; export it anew")
    described = document.get("model")
    if not isinstance(described, Mapping):
        raise InputError(f"{source} has no model; export it anew")
    model = PlantModel.from_dict(described, f"{source}, model")
    prefix = document.get("prefix")
    if not isinstance(prefix, str | None):
        raise InputError(f"{source} has a prefix that is no text; export it anew")
    return package_of(model, document.get("ts_s", math.nan), controller, preview, prefix)


def reach_um(model: PlantModel[Any], ts_s: float) -> tuple[float, float]:
    """Return the displacements (µm) that the ends of a command range reach after a slow walk.

    Effects are left out; a drift has no end.
    """
    low, high = model.command_range_V
    rest = min(max(0.0, low), high)
    ends = (rest, low, high)
    walk = np.concatenate([np.linspace(a, b, _WALK) for a, b in pairwise(ends)])
    plant = Plant(replace(model, effects=()), ts_s)
    found = plant.simulate_given(walk, np.zeros_like(walk))
    reached = float(found[_WALK - 1]), float(found[-1])
    if not all(map(math.isfinite, reached)):
        centre, scale = model.reference_um
        return centre - scale, centre + scale
    return min(reached), max(reached)


def _fixed(program: Program) -> tuple[FixedPoint | None, str | None]:
    """Return the form on whole numbers, or why there is none."""
    if not isinstance(program.twin, ControllerTwin) or not hasattr(program.twin.made, "name"):
        return None, None  # a plant, or a policy
    try:
        return fixed_point_body(program.twin.made), None
    except InputError as error:
        return None, f"No form on whole numbers: {error}"


def _found_anywhere(controller: str) -> str:
    """Return a controller's name, the folder of a policy written from the root."""
    prefix, sign, folder = controller.rpartition(":")
    is_folder = sign and Path(folder).is_dir()
    return f"{prefix}{sign}{Path(folder).absolute()}" if is_folder else controller
