"""The chain of rdpi_gym.plant.Plant on tensors, its state resident on a device."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from rdpi_gym.plant import CORES, RDPI, Plant, PlantModel
from rdpi_gym.plant.cores.play import given_rate_block
from rdpi_gym.plant.effects.base import Effect, Slot
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.torch_plant.device import checked_device
from rdpi_gym.torch_plant.hysteresis import RDPITensors, play_sum, rate
from rdpi_gym.torch_plant.stages import TWINS, Twin, has_twin
from rdpi_gym.torch_plant.state import ROW, State


def check_core(model: PlantModel) -> None:
    """Refuse a plant whose core runs on another kernel than that of the plays."""
    if type(model.hysteresis).block is given_rate_block:
        return
    known = " or ".join(n for n, kind in CORES.items() if kind.block is given_rate_block)
    raise InputError(
        f"plant {model.name} has the core {model.hysteresis.name}, and in torch there are plays, the core "
        f"{known}; run it by rdpi_gym.plant.Plant"
    )


def memory_rows(effects: Sequence[Effect], hysteresis: Sequence[RDPI], ts_s: float) -> int:
    """Rows of the state of one effect, at its size in each lane."""
    pairs = zip(effects, hysteresis, strict=True)
    return max(effect.state_rows_with(ts_s, core) for effect, core in pairs)


def stage_of(
    effects: Sequence[Effect], hysteresis: Sequence[RDPI], ts_s: float
) -> tuple[Slot, Twin, Array]:
    """Slot, twin and parameters ``float64[P, B]`` of one effect, at its size in each lane."""
    kind = type(effects[0])
    if not has_twin(kind):
        raise InputError(
            f"effect {kind.full_name()} cannot be run in torch; run it with rdpi_gym.plant.Plant"
        )
    pairs = zip(effects, hysteresis, strict=True)
    columns = np.array([effect.coefficients(ts_s, model) for effect, model in pairs])
    return kind.slot, TWINS[kind.block], np.ascontiguousarray(columns.T)


class TorchPlant:
    """Plants that run side by side on a device, one a lane: the twin of `rdpi_gym.plant.Plant`.

    A step neither waits for the device nor looks at a value: it can be compiled by
    ``torch.compile`` and captured in a CUDA graph. Tensors of one number a lane are float64, so
    `dtype` is the type of what costs memory: the plays.

    Parameters
    ----------
    models
        One model for all lanes, or one a lane (all with the same n). One model is kept once: a step
        then moves about half as many bytes.
    ts_s
        Sampling time (s).
    lanes
        Number of lanes B where one model is given.
    device
        Where the plants live: ``"cpu"``, ``"cuda"``, ``"cuda:1"``.
    dtype
        ``torch.float32`` or ``torch.float64``.

    Raises
    ------
    InputError
        As `Plant`; a device that is not there; another dtype; a hysteresis core that is no sum of
        plays, or an effect without a form in torch.

    Attributes
    ----------
    parameters : RDPITensors
        May be replaced, by parameters for each lane or by ones that require gradients.
    state : State
        Changed in place by every step.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> plant = TorchPlant(named_plant("P5"), ts_s=1e-3, lanes=2)
    >>> plant.step(torch.tensor([0.0, 1.0])).tolist()
    [0.0, 0.729]
    """

    def __init__(
        self,
        models: PlantModel | Sequence[PlantModel],
        ts_s: float,
        lanes: int = 1,
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float32,
    ) -> None:
        shared = isinstance(models, PlantModel)
        if shared and lanes < 1:
            raise InputError(f"lanes is {lanes}; give a whole number of lanes of 1 or more")
        if dtype not in (torch.float32, torch.float64):
            raise InputError(f"dtype is {dtype}; give torch.float32 or torch.float64")
        self.device, self.dtype = checked_device(device), dtype
        on_cpu = Plant(models, ts_s)  # refuses what cannot run side by side
        self.models, self.ts_s = on_cpu.models, on_cpu.ts_s
        check_core(self.models[0])
        self.lanes = lanes if shared else on_cpu.lanes
        hysteresis = [model.hysteresis for model in self.models]
        self.parameters = RDPITensors.of(
            hysteresis, ts_s, [model.offset_um for model in self.models], self.device, dtype
        )
        fixed, moved = (
            np.array([model.turns_from(first_V) for model in self.models]).T
            for first_V in (0.0, 1.0)
        )
        self._turns_V, self._follow = self._rows(fixed), self._rows(np.rint(moved - fixed))
        self._hold = self.models[0].converter.samples(self.ts_s)
        effects = zip(*(model.effects for model in self.models), strict=True)
        stages = [column for column in effects if column[0].slot != "memory"]
        self._stages = [
            (slot, twin, self._rows(p))
            for slot, twin, p in (stage_of(column, hysteresis, self.ts_s) for column in stages)
        ]
        self.state = State(
            self._empty(),
            self._empty(),
            self._empty(),
            torch.zeros(self.lanes, dtype=torch.int64, device=self.device),
            torch.zeros(self.lanes, dtype=torch.bool, device=self.device),
            tuple(self._empty().to(dtype) for _ in range(hysteresis[0].n)),
            tuple(self._empty(memory_rows(column, hysteresis, self.ts_s)) for column in stages),
        )
        self.reset()

    @property
    def memory(self) -> Tensor:
        """Play states ξ_i (V) of every lane: a copy, ``float64[n, B]``."""
        memory = self._empty(len(self.state.xi_V))
        for row, xi in zip(memory, self.state.xi_V, strict=True):
            row.copy_(xi)
        return memory

    def picked(self, columns: Tensor) -> TorchPlant:
        """Return plants that are copies of these, what they remember included.

        Parameters
        ----------
        columns
            Lane of these that each lane of the result is a copy of, ``int64[B']``.

        Examples
        --------
        >>> from rdpi_gym.plant import named_plant
        >>> plant = TorchPlant(named_plant("P5"), ts_s=1e-3, lanes=2)
        >>> plant.step(torch.tensor([0.0, 1.0])).tolist()
        [0.0, 0.729]
        >>> plant.picked(torch.tensor([1, 1, 0])).step(torch.ones(3)).tolist()
        [0.729, 0.729, 0.729]
        """
        made = copy(self)
        made.lanes = len(columns)

        def pick(tensor: Tensor) -> Tensor:
            wide = tensor.expand(*tensor.shape[:-1], self.lanes)
            return wide.index_select(-1, columns)

        made.parameters = RDPITensors(*map(pick, self.parameters))
        made._turns_V, made._follow = pick(self._turns_V), pick(self._follow)
        made._stages = [(slot, twin, pick(p)) for slot, twin, p in self._stages]
        made.state = self.state.mapped(pick)
        return made

    def become(self, lanes: Tensor, source: TorchPlant, columns: Tensor) -> None:
        """Make some lanes copies of other plants, what they remember included, in place.

        Parameters
        ----------
        lanes
            Which lanes, ``int64[m]``.
        source
            Plants of the same build, of which :meth:`picked` made these.
        columns
            Lane of `source` that each becomes a copy of, ``int64[m]``.
        """
        for kept, other in zip(self._columns(), source._columns(), strict=True):
            wide = other.expand(*other.shape[:-1], source.lanes)
            kept.index_copy_(-1, lanes, wide.index_select(-1, columns))

    def reset(
        self,
        u0_V: ArrayLike | Tensor | None = None,
        memory: ArrayLike | Tensor | None = None,
        lanes: ArrayLike | Tensor | None = None,
    ) -> None:
        """Forget the past.

        Parameters
        ----------
        u0_V
            Command (V) at which the plant has been resting. None: the next sample begins a record,
            v(0) = 0.
        memory
            Play states ξ_i (V), ``(n,)`` or ``(n, B)``; by default those of the models' initial
            memory; where that hangs on the command at which a record begins, it is set as the first
            sample comes. With `u0_V` they are moved to what a rest there allows.
        lanes
            Boolean mask ``(B,)`` of the lanes to reset; all by default.
        """
        state = self.state
        u0 = self._rows(np.nan if u0_V is None else u0_V).expand(self.lanes)
        if memory is None:
            xi = self._settled(torch.zeros_like(u0) if u0_V is None else u0)
        else:
            xi = self._rows(memory)
            xi = xi[:, None] if xi.ndim == 1 else xi
        if u0_V is not None:
            rest = self.parameters.thresholds_V.detach().to(ROW)
            xi = torch.clamp(xi, u0 - rest, u0 + rest)
        mask = torch.ones(self.lanes, dtype=torch.bool, device=self.device)
        if lanes is not None:
            mask = torch.as_tensor(lanes, dtype=torch.bool, device=self.device)
        if lanes is None or bool(mask.all()):
            state.samples.zero_()
        plays = xi.expand(len(state.xi_V), self.lanes)
        awaits = torch.full_like(state.awaits, u0_V is None and memory is None)
        fresh = [u0, torch.zeros_like(u0), awaits, *plays]
        for kept, value in zip((*state[:2], state.awaits, *state.xi_V), fresh, strict=True):
            kept.copy_(torch.where(mask, value.to(kept.dtype), kept))
        for kept in state.effects:
            kept.masked_fill_(mask, torch.nan)

    @torch.no_grad()
    def step(self, u_V: Tensor) -> Tensor:
        """Advance one sample in place, without gradients; no check of the values.

        Parameters
        ----------
        u_V
            Command (V), ``[B]`` of any floating type; float64 keeps the rate exact.

        Returns
        -------
        float64[B]
            Displacement (µm) before the sensor.

        Raises
        ------
        InputError
            Another shape.
        """
        if u_V.shape != (self.lanes,):
            raise InputError(
                f"a command of shape {tuple(u_V.shape)} for {self.lanes} lanes; give ({self.lanes},)"
            )
        y, state = self._advance(u_V, self.state)
        self._keep(state)
        return y

    def simulate(self, u_V: Tensor) -> Tensor:
        """Run a block of commands and keep the memory for the next one.

        Where gradients are on, the result can be differentiated through time with respect to the
        commands and to :attr:`parameters` that require it; the memory kept is detached.

        Parameters
        ----------
        u_V
            Command (V), ``[T]`` for one lane or ``[T, B]``.

        Returns
        -------
        float64, of the same shape
            Displacement (µm) before the sensor.

        Raises
        ------
        InputError
            A command is not finite, or the block's shape does not fit the lanes.
        """
        u = u_V[:, None] if u_V.ndim == 1 else u_V
        if u.ndim != 2 or u.shape[1] != self.lanes or len(u) == 0:
            raise InputError(
                f"a block of shape {tuple(u_V.shape)} for {self.lanes} lanes; give (samples, {self.lanes})"
            )
        if not bool(torch.isfinite(u).all()):
            sample, lane = torch.argwhere(~torch.isfinite(u))[0].tolist()
            raise InputError(
                f"sample {sample} of lane {lane} is {float(u[sample, lane])}; commands are finite voltages"
            )
        state = self.state.clone()  # what gradients need is not overwritten in the end
        rows = []
        for row in u:
            y, state = self._advance(row, state)
            rows.append(y)
        with torch.no_grad():
            self._keep(state)
        return torch.stack(rows).reshape(u_V.shape)

    def _advance(self, u_V: Tensor, state: State) -> tuple[Tensor, State]:
        u = u_V.to(ROW)
        held, samples = state.held_V, state.samples
        if self._hold > 1:
            u = held = torch.where(samples % self._hold == 0, u, held)
            samples = samples + 1
        effects, memory, awaits = list(state.effects), state.xi_V, state.awaits
        if len(self._turns_V):
            past = self._settled(u)
            memory = tuple(
                torch.where(awaits, x.to(xi.dtype), xi) for x, xi in zip(past, memory, strict=True)
            )
            awaits = torch.zeros_like(awaits)

        def run(x: Tensor, *slots: Slot) -> Tensor:
            for i, (slot, twin, p) in enumerate(self._stages):
                if slot in slots:
                    x, effects[i] = twin(x, u, p, effects[i], self.ts_s)
            return x

        u = run(u, "input")
        v = rate(u, state.u_V, state.rate_V_s, self.parameters, self.ts_s)
        y, xi = play_sum(u, run(v, "rate"), self.parameters, memory)
        y = run(y, "hysteresis", "output") + self.parameters.offset_um
        return y, State(u, v, held, samples, awaits, xi, tuple(effects))

    def _columns(self) -> tuple[Tensor, ...]:
        """All that a lane has one column of."""
        stages = (p for _, _, p in self._stages)
        return (
            *self.parameters, self._turns_V, self._follow, *stages, *self.state.tensors(),
        )  # fmt: skip

    def _settled(self, first_V: Tensor) -> Tensor:
        """Memory (V) of the models' own past where lanes begin at commands (V), ``float64[n, B]``."""
        rest = self.parameters.thresholds_V.detach().to(ROW)
        xi = torch.zeros((len(rest), self.lanes), dtype=ROW, device=self.device)
        for turn, follows in zip(self._turns_V, self._follow, strict=True):
            u = turn + follows * first_V
            xi = torch.clamp(xi, u - rest, u + rest)
        return xi

    def _keep(self, state: State) -> None:
        for kept, value in zip(self.state.tensors(), state.tensors(), strict=True):
            if kept is not value:  # a twin may need fewer rows than its kernel
                target = kept[: len(value)] if kept.ndim == 2 else kept
                target.copy_(value)

    def _rows(self, values: ArrayLike | Tensor) -> Tensor:
        return torch.as_tensor(values, dtype=ROW, device=self.device)

    def _empty(self, *rows: int) -> Tensor:
        return torch.zeros((*rows, self.lanes), dtype=ROW, device=self.device)
