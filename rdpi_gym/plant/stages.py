"""The links of a chain: effects as stages with their packed parameters and state, and the core."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from rdpi_gym.plant.chain import ACTS_ON, COMMAND, DISPLACEMENT, RATE, Link, Place
from rdpi_gym.plant.cores.base import Core, CoreBlock
from rdpi_gym.plant.cores.play import rate_block
from rdpi_gym.plant.effects.base import Effect, Slot
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError


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
        packed: dict[tuple[int, int], list[float]] = {}
        columns = []
        for effect, model in zip(effects, hysteresis, strict=True):
            pair = id(effect), id(model)  # by identity: a hash of every number costs more
            if pair not in packed:
                packed[pair] = effect.coefficients(ts_s, model)
            columns.append(packed[pair])
        self._parameters = np.ascontiguousarray(np.array(columns, dtype=np.float64).T)
        pairs = zip(effects, hysteresis, strict=True)
        rows = max(effect.state_rows_with(ts_s, core) for effect, core in pairs)
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
        """What the stage remembers, a view of float64[S, B]."""
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
