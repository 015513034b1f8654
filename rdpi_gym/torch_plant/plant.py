"""The chain of rdpi_gym.plant.Plant on tensors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from rdpi_gym.plant import Plant, PlantModel
from rdpi_gym.plant.cores.base import pack
from rdpi_gym.plant.cores.play import rate_block
from rdpi_gym.plant.effects.base import Slot
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.torch_plant.translation import Lanes


class TorchPlant:
    """Plants that run side by side in torch, one a lane, by the kernels of `rdpi_gym.plant.Plant`.

    Every core and effect runs whose kernel can be translated, one of your own too. All tensors are
    float64: displacements are those of `Plant` to the last digits.

    Parameters
    ----------
    models
        One model for all lanes, or one a lane.
    ts_s
        Sampling time (s).
    lanes
        Number of lanes B where one model is given.
    device
        Of the tensors, as torch names it.

    Raises
    ------
    InputError
        As `Plant`; a device that is not there; a core or an effect whose kernel loops as often as the
        numbers of a lane say, or calls what torch does not have.

    Attributes
    ----------
    parameters : dict of str to Tensor
        Rows of parameters ``float64[P, B]`` as the kernels read them: under ``"core"`` those of
        :func:`rdpi_gym.plant.pack`, under the name of an effect its own. A tensor may be replaced by
        one that requires gradients.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> plant = TorchPlant(named_plant("P5"), ts_s=1e-3)
    >>> plant.simulate(torch.tensor([0.0, 1.0, 2.0])).round(decimals=3).tolist()
    [0.0, 0.729, 1.458]
    """

    def __init__(
        self,
        models: PlantModel | Sequence[PlantModel],
        ts_s: float,
        lanes: int = 1,
        device: torch.device | str = "cpu",
    ) -> None:
        self._plant = Plant(models, ts_s, lanes)  # refuses what cannot run side by side
        self.models, self.ts_s, self.lanes = self._plant.models, ts_s, self._plant.lanes
        try:
            self.device = torch.zeros(1, device=device).device
        except (RuntimeError, AssertionError) as error:
            raise InputError(
                f"device {device!r} is none that torch has here; give 'cpu'"
            ) from error
        self._lanes = Lanes(self.lanes, self.device)
        cores = [model.hysteresis for model in self.models]
        self._hold = self.models[0].converter.samples(ts_s)
        offsets = [model.offset_um for model in self.models]
        # As in `Plant`: behind the core an effect sees the displacement without its offset.
        effects = [
            column
            for column in zip(*(model.effects for model in self.models), strict=True)
            if column[0].slot != "memory"
        ]
        inside = [0.0] * len(offsets) if effects else offsets
        self._offsets = self._tensor(np.array(offsets) - inside)
        self.parameters = {"core": self._tensor(pack(cores, ts_s, inside))}
        for column in effects:
            pairs = zip(column, cores, strict=True)
            rows = np.array([effect.coefficients(ts_s, core) for effect, core in pairs])
            self.parameters[column[0].name] = self._tensor(rows.T)
        self._state: list[Any] = []
        self._awaits = np.zeros(self.lanes, dtype=bool)
        self.reset()
        try:
            translated = self._lanes.translated
            self._rate, self._core = translated(rate_block), translated(type(cores[0]).block)
            kinds = [type(column[0]) for column in effects]
            self._stages = [(kind.slot, kind.name, translated(kind.block)) for kind in kinds]
            self.simulate(torch.zeros(1, self.lanes, dtype=torch.float64, device=self.device))
        except Exception as error:  # a kernel may do on tensors whatever its author did not foresee
            reason = " ".join(str(error).split())[:200]
            raise InputError(
                f"plant {self.models[0].name} cannot be run in torch: {reason}; run it by rdpi_gym.plant.Plant"
            ) from error
        self.reset()

    @property
    def memory(self) -> Tensor:
        """Memory of the core of every lane, as `Plant.memory`: a copy, ``float64[n, B]``."""
        rows = [self._lanes.tensor(row).expand(self.lanes) for row in self._state[0][2:, 0]]
        return torch.stack(rows) if rows else torch.zeros(0, self.lanes, dtype=torch.float64)

    def reset(
        self,
        u0_V: ArrayLike | None = None,
        memory: ArrayLike | None = None,
        lanes: ArrayLike | None = None,
    ) -> None:
        """Forget the past, as :meth:`rdpi_gym.plant.Plant.reset`."""
        if lanes is not None:
            self._plant.restore([self._array(part) for part in self._state])
            kept = self._awaits & ~np.asarray(lanes, dtype=bool)
        else:
            kept = np.zeros(self.lanes, dtype=bool)
            self._samples, self._held = 0, self._tensor(np.zeros(self.lanes))
        self._plant.reset(u0_V, memory, lanes)
        self._state = [self._column(part) for part in self._plant.snapshot()]
        begins = np.ones(self.lanes, dtype=bool) if lanes is None else np.asarray(lanes, bool)
        self._awaits = kept | (begins & (u0_V is None and memory is None))

    @torch.no_grad()
    def step(self, u_V: Tensor) -> Tensor:
        """Advance one sample, without gradients.

        Parameters
        ----------
        u_V
            Command (V), ``[B]``.

        Returns
        -------
        float64[B]
            Displacement (µm) before the sensor.
        """
        return self.simulate(u_V[None])[0]

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
        parameters = {name: self._column(rows) for name, rows in self.parameters.items()}
        displacement = torch.stack([self._advance(row, parameters) for row in u.to(torch.float64)])
        for part in self._state:
            for place, value in np.ndenumerate(part):
                part[place] = self._lanes.tensor(value).detach()
        return displacement.reshape(u_V.shape)

    def _advance(self, u: Tensor, parameters: dict[str, Any]) -> Tensor:
        if self._samples % self._hold == 0:
            self._held = u
        self._samples, u = self._samples + 1, self._held
        if self._awaits.any():
            self._begin(u.detach().cpu().numpy())
        core, *states = self._state

        def run(kernel: Callable[..., Any], *arguments: Any) -> Tensor:
            y = np.full((1, 1), 0.0, dtype=object)
            kernel(*arguments, y)
            found: Tensor = self._lanes.tensor(y[0, 0])
            return found

        def stages(x: Tensor, *slots: Slot) -> Tensor:
            for (slot, name, kernel), state in zip(self._stages, states, strict=True):
                if slot in slots:
                    x = run(kernel, _cell(x), _cell(u), parameters[name], state, self.ts_s)
            return x

        u = stages(u, "input")
        v = stages(run(self._rate, _cell(u), parameters["core"], core, self.ts_s), "rate")
        y = run(self._core, _cell(u), _cell(v), parameters["core"], core)
        return stages(y, "hysteresis", "output") + self._offsets

    def _begin(self, first_V: Array) -> None:
        """Set the memory of lanes whose record begins at commands (V), from the models' own past."""
        for lane in np.flatnonzero(self._awaits):
            model = self.models[lane]
            turns = model.turns_from(float(first_V[lane]))
            for i, value in enumerate(model.hysteresis.settled(turns) if turns else ()):
                row = self._state[0][2 + i, 0].clone()
                row[lane] = float(value)
                self._state[0][2 + i, 0] = row
        self._awaits[:] = False

    def _tensor(self, values: ArrayLike) -> Tensor:
        return torch.tensor(np.asarray(values), dtype=torch.float64, device=self.device)

    def _column(self, rows: Tensor | Array) -> Any:
        """Return rows ``(n, B)`` as a kernel's array of one lane, whose elements are tensors ``(B,)``."""
        tensor = rows if isinstance(rows, Tensor) else self._tensor(rows)
        column = np.empty((len(tensor), 1), dtype=object)
        for i, row in enumerate(tensor.unbind()):
            column[i, 0] = row
        return column

    def _array(self, column: Any) -> Array:
        """Return what :meth:`_column` was made of, as NumPy has it."""
        rows = [self._lanes.tensor(each).expand(self.lanes).cpu().numpy() for each in column[:, 0]]
        return np.array(rows).reshape(len(column), self.lanes)


def _cell(value: Tensor) -> Any:
    cell = np.empty((1, 1), dtype=object)
    cell[0, 0] = value
    return cell
