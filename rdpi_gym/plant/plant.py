"""A plant: its converter, the chain with its state, its offset."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from rdpi_gym.plant.chain import (
    ACTS_ON,
    CHAIN,
    DISPLACEMENT,
    RATE,
    Link,
    Place,
    in_order,
    walk,
)
from rdpi_gym.plant.cores.play import rdpi_block
from rdpi_gym.plant.model import PlantModel
from rdpi_gym.plant.packing import check_ts, empty_state, pack
from rdpi_gym.plant.stages import core_links, stages_of
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_whole, shown
from rdpi_gym.support.errors import InputError


class Plant:
    """Plants that run side by side, one a lane, with the memory that each has gathered.

    Parameters
    ----------
    models
        One model for all lanes, or one a lane (all with the same n).
    ts_s
        Sampling time (s).
    lanes
        Number of lanes B where one model is given.

    Raises
    ------
    InputError
        Ts is not above zero, no lane, or lanes that differ in n or in their converter.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> plant = Plant(named_plant("P5"), ts_s=1e-3)
    >>> plant.simulate(np.array([0.0, 1.0, 2.0])).round(3).tolist()
    [0.0, 0.729, 1.458]
    """

    def __init__(
        self, models: PlantModel | Sequence[PlantModel], ts_s: float, lanes: int = 1
    ) -> None:
        if isinstance(models, PlantModel):
            models = [models] * lanes if is_whole(lanes, 0) else []
        if not isinstance(models, Sequence) or not all(isinstance(m, PlantModel) for m in models):
            raise InputError(f"models is {shown(models)}; give a PlantModel, or one for each lane")
        if not models:
            raise InputError("a plant with no lane; give at least one model, or lanes of 1 or more")
        self.models = tuple(models)
        self.ts_s = check_ts(ts_s)
        self.n = self.models[0].hysteresis.n
        hysteresis = [m.hysteresis for m in self.models]
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
        self._state = empty_state(self.n, self.lanes)
        self._count = 0
        links: dict[Place, Sequence[Link]] = {
            **self._stages,
            **core_links(self._parameters, self._state, self.ts_s),
        }  # fmt: skip
        self._chain = in_order(links)
        # Where the rate is given, what makes it and what acts on it is left out.
        self._rate_given = in_order(links, [p for p in CHAIN if ACTS_ON.get(p) != RATE])
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
            memory, zero without one. With `u0_V` they are moved to what a rest there allows.
        lanes
            Boolean mask ``(B,)`` of the lanes to reset; all by default.
        """
        mask = np.ones(self.lanes, dtype=bool) if lanes is None else np.asarray(lanes, dtype=bool)
        u0 = np.broadcast_to(np.nan if u0_V is None else np.asarray(u0_V, float), (self.lanes,))
        xi = np.zeros((self.n, self.lanes))
        if memory is None:
            for lane, model in enumerate(self.models):
                if model.initial_extremum_V is not None:
                    rest_V = model.hysteresis.thresholds_V
                    xi[:, lane] = settled_memory(rest_V, [model.initial_extremum_V])
        else:
            given = np.asarray(memory, dtype=np.float64)
            xi += given[:, None] if given.ndim == 1 else given
        if u0_V is not None:
            rest = self._parameters[self.n + 1 : 2 * self.n + 1]
            xi = np.clip(xi, u0 - rest, u0 + rest)
        self._state[0, mask] = u0[mask]
        self._state[1, mask] = 0.0
        self._state[2:, mask] = xi[:, mask]
        for stages in self._stages.values():
            for stage in stages:
                stage.reset(mask)
        if mask.all():
            self._count = 0

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
        if self._stages:
            return self._run(u)
        rdpi_block(u, self._parameters, self._state, self.ts_s, self._y)
        return self._y

    def _run(self, u: Array, v: Array | None = None) -> Array:
        y: Array = walk(self._chain if v is None else self._rate_given, [u, v, None])[DISPLACEMENT]
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


def settled_memory(thresholds_V: ArrayLike, extrema_V: ArrayLike) -> Array:
    """Play states after a slow walk from rest through a sequence of extrema.

    Parameters
    ----------
    thresholds_V
        Thresholds at rest (V), ``(n,)``.
    extrema_V
        Commands (V) at which the walk turned, in order.

    Returns
    -------
    float64[n]
        ξ_i (V), from Eq. 4 at zero rate.

    Examples
    --------
    >>> settled_memory([1.0, 3.0], [5.0, 1.0]).tolist()
    [2.0, 2.0]
    """
    rest = np.asarray(thresholds_V, dtype=np.float64)
    xi = np.zeros_like(rest)
    for u in np.atleast_1d(np.asarray(extrema_V, dtype=np.float64)):
        xi = np.clip(xi, u - rest, u + rest)
    return xi
