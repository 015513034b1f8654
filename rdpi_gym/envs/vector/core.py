"""The hysteresis core of many lanes: its kernel, what each lane draws of it, and its rest."""

from __future__ import annotations

import numpy as np

from rdpi_gym.envs.vector.begin import scale_packed, settle_plays
from rdpi_gym.envs.vector.chain import core_address
from rdpi_gym.envs.vector.lanes import Lanes
from rdpi_gym.plant import PlantModel, pack
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.cores.play import given_rate_block
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError


class CoreLanes:
    """The core of a plant, about which those of the lanes are drawn.

    Parameters
    ----------
    model
        The nominal plant.
    ts_s
        Sampling time (s).

    Attributes
    ----------
    factors : int
        Number of factors that a drawn core takes.
    rows : tuple of int
        Rows of its parameters and of its state.
    """

    def __init__(self, model: PlantModel, ts_s: float) -> None:
        self._nominal: Core = model.hysteresis
        self._ts_s = ts_s
        self.factors, self._gaps_V = self._nominal.factors, self._nominal.gaps_V
        self.rows = (len(pack([self._nominal], ts_s, [0.0])), 2 + self._nominal.n)

    @property
    def kernel(self) -> int:
        """Address of its kernel in this process."""
        return core_address(type(self._nominal).block, self._nominal.name)

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

    def draw(self, core: Core, factors: Array, fresh: Lanes) -> LaneCores:
        """Put what lanes have drawn into a block that begins with the parameters of one plant."""
        cores = LaneCores(core, factors)
        if factors.shape[1] and core.drawn_as_packed:
            scale_packed(len(core.gains), self._gaps_V, factors, fresh)
        elif factors.shape[1]:
            for lane in range(len(factors)):
                fresh.p[0, :-2, lane] = cores[lane].coefficients()
        return cores

    def settle(self, rest_V: float, turns_V: Array, cores: LaneCores, fresh: Lanes) -> None:
        """Set the memory that a rest at `rest_V` (V) leaves of earlier turns (V), ``(K, m)``."""
        if type(self._nominal).block is given_rate_block:
            settle_plays(rest_V, turns_V, fresh)
            return
        count = turns_V.shape[1]
        memory, rest = np.zeros((self._nominal.n, count)), np.full(count, rest_V)
        if len(turns_V):
            for lane in range(count):
                memory[:, lane] = cores[lane].settled(turns_V[:, lane].tolist())
        for lanes in cores.alike(count):
            memory[:, lanes] = cores[lanes.start].resting(memory[:, lanes], rest[lanes])
        fresh.state[0, 2:, :count] = memory


class LaneCores:
    """The cores of lanes that begin, each made when it is first asked for.

    Parameters
    ----------
    core
        The nominal one.
    factors : float64[m, K]
        As :meth:`CoreLanes.draw` takes them.
    """

    def __init__(self, core: Core, factors: Array) -> None:
        self._core, self._factors = core, factors
        self._made: dict[int, Core] = {}

    def __getitem__(self, lane: int) -> Core:
        if self._factors.shape[1] == 0:
            return self._core
        if lane not in self._made:
            self._made[lane] = self._core.scaled(self._factors[lane])
        return self._made[lane]

    def alike(self, count: int) -> list[slice]:
        """Return stretches of the first `count` lanes that have one core each."""
        if self._factors.shape[1] == 0:
            return [slice(0, count)]
        return [slice(lane, lane + 1) for lane in range(count)]
