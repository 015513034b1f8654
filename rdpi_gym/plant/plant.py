"""A plant in operation: converter, the chain of stages with its state, offset."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rdpi_gym.plant.chain import (
    ACTS_ON,
    CHAIN,
    COMMAND,
    DISPLACEMENT,
    RATE,
    Link,
    Place,
    in_order,
)
from rdpi_gym.plant.cores.base import Core, CoreBlock, check_ts, empty_state, pack
from rdpi_gym.plant.cores.play import rate_block
from rdpi_gym.plant.effects.base import Effect, Slot
from rdpi_gym.plant.model import PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_whole
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted


class Stage:
    """One effect over B lanes, with one value of each parameter a lane.

    Parameters
    ----------
    effects
        The same form of an effect, one a lane.
    hysteresis
        The hysteresis core, one a lane.
    ts_s
        Sampling time (s).
    """

    def __init__(self, effects: Sequence[Effect], hysteresis: Sequence[Core], ts_s: float) -> None:
        self.slot: Slot = effects[0].slot
        self._built = list(zip(effects, hysteresis, strict=True))
        self._signal = ACTS_ON.get(self.slot, DISPLACEMENT)
        self._block = type(effects[0]).block
        self._clocked = effects[0].clocked
        packed: dict[tuple[int, int], int] = {}
        columns, places, rows = list[list[float]](), list[int](), 0
        for effect, model in zip(effects, hysteresis, strict=True):
            pair = id(effect), id(model)  # by identity: a hash of every number costs more
            if pair not in packed:
                packed[pair] = len(columns)
                columns.append(effect.coefficients(ts_s, model))
                rows = max(rows, effect.state_rows_with(ts_s, model))
            places.append(packed[pair])
        self._parameters = np.array(columns, dtype=np.float64).T.take(places, axis=1)
        self._state = np.full((rows, len(effects)), np.nan)
        self._ts_s = ts_s

    def reset(self, lanes: Array) -> None:
        """Forget the past of the lanes in a boolean mask: the next sample finds them at rest."""
        self._state[:, lanes] = np.nan

    def retune(self, effects: Sequence[Effect], hysteresis: Sequence[Core]) -> None:
        """Go on with other values of the parameters; what the stage remembers stays what it is."""
        for lane, (effect, core) in enumerate(zip(effects, hysteresis, strict=True)):
            before, its_core = self._built[lane]
            if effect is before and core is its_core:
                continue
            rows = effect.state_rows_with(self._ts_s, core)
            if type(effect) is not type(before) or rows > len(self._state):
                raise InputError(
                    f"{before.full_name()} cannot become {effect.full_name()} while it runs; give the "
                    "same form, and no longer a delay"
                )
            self._parameters[:, lane] = effect.coefficients(self._ts_s, core)
            effect.carry(self._state[:, lane], before)
            self._built[lane] = effect, core

    @property
    def state(self) -> Array:
        """Memory of the stage, a view of float64[S, B]."""
        return self._state

    def start(self, clock_s: float) -> None:
        """Begin at a time (s) of the experiment, which slow drifts go by."""
        if self._clocked:
            self._state[0] = clock_s / self._ts_s

    def run(self, signals: Sequence[Array]) -> Array:
        """Return the stage's output ``[T, B]`` for its signal: a link of the chain."""
        x = signals[self._signal]
        y = np.empty_like(x)
        self._block(x, signals[COMMAND], self._parameters, self._state, self._ts_s, y)
        return y


def stages_of(
    effects: Sequence[Sequence[Effect]], hysteresis: Sequence[Core], ts_s: float
) -> dict[Place, list[Stage]]:
    """Return the stages of the effects of all lanes by their slot, in their order there."""
    kinds = {tuple(type(effect) for effect in lane) for lane in effects}
    if len(kinds) != 1:
        raise InputError("lanes with different effects; give all lanes of one plant the same ones")
    stages: dict[Place, list[Stage]] = {}
    for column in zip(*effects, strict=True):
        if column[0].slot != "memory":
            stages.setdefault(column[0].slot, []).append(Stage(column, hysteresis, ts_s))
    return stages


def core_links(
    hysteresis: Core, parameters: Array, state: Array, ts_s: float
) -> dict[Place, list[Link]]:
    """Return the hysteresis core's own links of the chain."""
    return {
        "derivative": [partial(_derivative, parameters, state, ts_s)],
        "core": [partial(_core, type(hysteresis).block, parameters, state)],
    }


# Functions of the module, and no closures: a plant can be pickled.
def _derivative(parameters: Array, state: Array, ts_s: float, signals: Sequence[Array]) -> Array:
    v = np.empty_like(signals[COMMAND])
    rate_block(signals[COMMAND], parameters, state, ts_s, v)
    return v


def _core(block: CoreBlock, parameters: Array, state: Array, signals: Sequence[Array]) -> Array:
    y = np.empty_like(signals[COMMAND])
    block(signals[COMMAND], signals[RATE], parameters, state, y)
    return y


class Plant:
    """Plants that run side by side, one a lane, with the memory that each has gathered.

    Parameters
    ----------
    models
        One model for all lanes, or one a lane (all with the same core and n).
    ts_s
        Sampling time (s).
    lanes
        Number of lanes B where one model is given.

    Raises
    ------
    InputError
        Ts is not above zero, no lane, or lanes that differ in core, n or converter.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> plant = Plant(named_plant("P5"), ts_s=1e-3)
    >>> plant.simulate(np.array([0.0, 1.0, 2.0])).round(3).tolist()
    [0.0, 0.729, 1.458]
    """

    def __init__(
        self, models: PlantModel[Any] | Sequence[PlantModel[Any]], ts_s: float, lanes: int = 1
    ) -> None:
        if isinstance(models, PlantModel):
            models = [models] * lanes if is_whole(lanes, 0) else []
        if not isinstance(models, Sequence) or not all(isinstance(m, PlantModel) for m in models):
            raise InputError(f"models is {quoted(models)}; give a PlantModel, or one for each lane")
        if not models:
            raise InputError("a plant with no lane; give at least one model, or lanes of 1 or more")
        self.models = tuple(models)
        self.ts_s = check_ts(ts_s)
        hysteresis = [m.hysteresis for m in self.models]
        self.n = hysteresis[0].n
        self._cores: dict[Core, list[int]] = {}
        for lane, core in enumerate(hysteresis):
            self._cores.setdefault(core, []).append(lane)
        self._stages = stages_of([m.effects for m in self.models], hysteresis, self.ts_s)
        offsets = [m.offset_um for m in self.models]
        # Behind the plays an effect sees the displacement without its offset.
        self._offsets = np.array(offsets if self._stages else [0.0] * len(offsets))
        inside = [0.0] * len(offsets) if self._stages else offsets
        self._parameters = pack(hysteresis, self.ts_s, inside)
        holds = {m.converter.samples(self.ts_s) for m in self.models}
        if len(holds) != 1:
            raise InputError("lanes with different converter periods; give all lanes the same one")
        self._hold = holds.pop()
        self._held = np.zeros((1, self.lanes))
        self._y = np.zeros((1, self.lanes))
        self._fused = type(hysteresis[0]).fused
        self._state = empty_state(self.n, self.lanes)
        self._count = 0
        self._rest: tuple[float, Array] | None = None  # a command and the state that it leaves
        self._remembers = any(model.turns_from(0.0) for model in self.models)
        # lanes whose memory is set as the first sample comes
        self._awaits = np.zeros(self.lanes, dtype=np.bool_)
        self._is_awaiting = False
        self._links: dict[Place, list[Link]] = {
            place: [stage.run for stage in stages] for place, stages in self._stages.items()
        }
        self._links |= core_links(hysteresis[0], self._parameters, self._state, self.ts_s)
        self._chain = in_order(self._links)
        self.reset()

    @property
    def lanes(self) -> int:
        """Number of lanes B."""
        return len(self.models)

    @property
    def memory(self) -> Array:
        """Play states ξ_i (V) of every lane: a copy, float64[n, B]."""
        return self._state[2:].copy()

    def reset(
        self,
        u0_V: ArrayLike | None = None,
        memory: ArrayLike | None = None,
        lanes: ArrayLike | None = None,
    ) -> None:
        """Forget the past.

        Parameters
        ----------
        u0_V
            Command (V) at which the plant has been resting; the next sample's rate is taken from
            it. None: the next sample begins a record, v(0) = 0 (Eq. 4's initial condition).
        memory
            Play states ξ_i (V), ``(n,)`` or ``(n, B)``; by default those of the model's initial
            memory, zero without one; where that hangs on the command at which a record begins, it
            is set as the first sample comes. With `u0_V` they are moved to what a rest there allows.
        lanes
            Boolean mask ``(B,)`` of the lanes to reset; all by default.
        """
        mask: Any = slice(None) if lanes is None else np.asarray(lanes, dtype=bool)
        rest_V: Any = u0_V
        if memory is None and isinstance(rest_V, float):  # an episode's: the same at every reset
            if self._rest is None or self._rest[0] != rest_V:
                self._rest = rest_V, self._begun(rest_V, None)
            begun = self._rest[1]
        else:
            begun = self._begun(u0_V, memory)
        self._awaits[mask] = u0_V is None and memory is None
        self._is_awaiting = self._remembers and bool(self._awaits.any())
        self._state[:, mask] = begun[:, mask]
        for stages in self._stages.values():
            for stage in stages:
                stage.reset(mask)
        if lanes is None or mask.all():
            self._count = 0

    def _begun(self, u0_V: ArrayLike | None, memory: ArrayLike | None) -> Array:
        """State of every lane after :meth:`reset`, float64[2 + n, B]."""
        state = np.zeros_like(self._state)
        u0, xi = state[0], state[2:]
        u0[:] = np.nan if u0_V is None else u0_V
        if memory is None:
            xi[:] = self._settled(np.nan_to_num(u0))
        else:
            given = np.asarray(memory, dtype=np.float64)
            xi[:] = given[:, None] if given.ndim == 1 else given
        if u0_V is not None:
            for core, lanes_of in self._cores.items():
                xi[:, lanes_of] = core.resting(xi[:, lanes_of], u0[lanes_of])
        return state

    def retune(self, models: Sequence[PlantModel[Any]]) -> None:
        """Go on as other models of the same build: a load that is set down, a stage that ages.

        What was gathered stays: displacements and velocities do not jump where a mode moves.

        Parameters
        ----------
        models
            One a lane, with the same core, effects and converter.

        Raises
        ------
        InputError
            A model of another build.

        Examples
        --------
        >>> from dataclasses import replace
        >>> from rdpi_gym.plant import named_plant
        >>> from rdpi_gym.plant.effects import CATALOGUE
        >>> bare = replace(named_plant("P5"), effects=(CATALOGUE["resonance"](f0_hz=700.0),))
        >>> loaded = replace(bare, effects=(CATALOGUE["resonance"](f0_hz=400.0),))
        >>> plant = Plant(bare, ts_s=1e-4)
        >>> before = plant.simulate(10.0 * np.sin(2 * np.pi * 50.0 * 1e-4 * np.arange(100)))[-2:]
        >>> plant.retune([loaded])
        >>> after = plant.simulate([10.0 * np.sin(2 * np.pi * 0.5)])  # as fast as it was moving
        >>> bool(abs(after[0] - before[1] - np.diff(before)[0]) < 0.2 * abs(np.diff(before)[0]))
        True
        """
        effects = [m.effects for m in models]
        if len(models) != self.lanes or any(
            len(new) != len(old.effects) for new, old in zip(effects, self.models, strict=True)
        ):
            raise InputError(
                "a plant goes on as one of the same build; give as many lanes and effects"
            )
        self._rest = None
        hysteresis = [m.hysteresis for m in models]
        if any(m.hysteresis is not o.hysteresis for m, o in zip(models, self.models, strict=True)):
            inside = [0.0 if self._stages else m.offset_um for m in models]
            self._parameters[:] = pack(hysteresis, self.ts_s, inside)
        if self._stages:
            self._offsets[:] = [m.offset_um for m in models]
        behind = {place: iter(stages) for place, stages in self._stages.items()}
        for column in zip(*effects, strict=True):
            if column[0].slot != "memory":
                next(behind[column[0].slot]).retune(column, hysteresis)
        self.models = tuple(models)

    def snapshot(self) -> tuple[Array, ...]:
        """Return all that the plants remember, the lane last: copies for :meth:`restore`.

        A converter that holds is left out.
        """
        stages = [stage.state for each in self._stages.values() for stage in each]
        return tuple(part.copy() for part in (self._state, *stages))

    def restore(self, snapshot: Sequence[Array]) -> None:
        """Take up what :meth:`snapshot` returned, of as many lanes of the same build.

        Examples
        --------
        >>> from rdpi_gym.plant import named_plant
        >>> plant = Plant(named_plant("P5"), ts_s=1e-3)
        >>> _ = plant.simulate([5.0, -5.0])
        >>> here = plant.snapshot()
        >>> first = plant.simulate([3.0, 4.0])
        >>> plant.restore(here)
        >>> bool((plant.simulate([3.0, 4.0]) == first).all())
        True
        """
        stages = [stage.state for each in self._stages.values() for stage in each]
        for own, taken in zip((self._state, *stages), snapshot, strict=True):
            own[:] = taken
        self._awaits[:] = self._is_awaiting = False

    def simulate(self, u_V: ArrayLike) -> Array:
        """Run a block of commands and keep the memory for the next one.

        Parameters
        ----------
        u_V
            Command (V), ``(T,)`` for one lane or ``(T, B)``.

        Returns
        -------
        ndarray
            Displacement (µm) before the sensor, of the same shape.

        Raises
        ------
        InputError
            A command is not finite, or the block's shape does not fit the lanes.
        """
        u, flat = self._block(u_V)
        y = self._run(self._convert(u))
        return y[:, 0] if flat else y

    def simulate_given(self, u_V: ArrayLike, rate_V_s: ArrayLike) -> Array:
        """As :meth:`simulate`, with thresholds given through a rate (V/s) of the same shape.

        Section II's wording: r_i(t) is a given function of time, the same in plant and compensator.
        """
        u, flat = self._block(u_V)
        v, _ = self._block(rate_V_s)
        y = self._run(self._convert(u), v)
        return y[:, 0] if flat else y

    def step(self, u_V: Array) -> Array:
        """Advance one sample; no checks, no allocation.

        Parameters
        ----------
        u_V
            Command (V), ``float64[1, B]``, contiguous.

        Returns
        -------
        float64[1, B]
            Displacement (µm); the array is overwritten by the next step.
        """
        u = u_V if self._hold == 1 else self._convert(u_V)
        if self._is_awaiting:
            self._begin(u[0])
        if self._stages or self._fused is None:
            return self._run(u)
        self._fused(u, self._parameters, self._state, self.ts_s, self._y)
        return self._y

    def _settled(self, first_V: Array) -> Array:
        """Memory (V) of the models' own past where lanes begin at commands (V), float64[n, B]."""
        memory = np.zeros((self.n, self.lanes))
        for lane, model in enumerate(self.models if self._remembers else ()):
            turns = model.turns_from(float(first_V[lane]))
            if turns:
                memory[:, lane] = model.hysteresis.settled(turns)
        return memory

    def _begin(self, first_V: Array) -> None:
        """Set the memory of lanes whose record begins at commands (V), ``(B,)``."""
        self._state[2:, self._awaits] = self._settled(first_V)[:, self._awaits]
        self._awaits[:] = self._is_awaiting = False

    def _run(self, u: Array, v: Array | None = None) -> Array:
        if self._is_awaiting:
            self._begin(u[0])
        chain = self._chain
        if v is not None:  # what makes the rate and what acts on it is left out
            chain = in_order(self._links, [place for place in CHAIN if ACTS_ON.get(place) != RATE])
        signals: list[Any] = [u, v, None]
        for signal, link in chain:  # as walk() does; a step has no time for a call more
            signals[signal] = link(signals)
        y: Array = signals[DISPLACEMENT]
        return y + self._offsets if self._stages else y

    def _block(self, values: ArrayLike) -> tuple[Array, bool]:
        block = np.ascontiguousarray(values, dtype=np.float64)
        flat = block.ndim == 1
        if flat:
            block = block[:, None]
        if block.ndim != 2 or block.shape[1] != self.lanes or block.shape[0] == 0:
            raise InputError(
                f"a block of shape {np.shape(values)} for {self.lanes} lanes; give (samples, {self.lanes})"
            )
        finite = np.isfinite(block)
        if not finite.all():
            sample, lane = np.argwhere(~finite)[0]
            raise InputError(
                f"sample {sample} of lane {lane} is {block[sample, lane]}; commands are finite voltages"
            )
        return block, flat

    def _convert(self, u: Array) -> Array:
        if self._hold == 1:
            return u
        index = np.arange(self._count, self._count + len(u))
        latest = index - index % self._hold - self._count  # sample of the converter's last refresh
        held = np.where((latest >= 0)[:, None], u[np.maximum(latest, 0)], self._held)
        self._held = held[-1:].copy()
        self._count += len(u)
        return np.ascontiguousarray(held)
