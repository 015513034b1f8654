"""The tracking environment's whole step on a device: command, plant, sensor, observation, reward."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from numpy.typing import ArrayLike
from torch import Tensor

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.errors import InputError
from rdpi_gym.torch_plant.law import commanded, error_of, observed, read, rewarded
from rdpi_gym.torch_plant.plant import TorchPlant
from rdpi_gym.torch_plant.state import ROW


class TorchTracking:
    """B tracking problems stepped together on a device, as `PiezoTrackingEnv` steps one.

    Actions, observations, rewards and the starting state are those of
    :class:`rdpi_gym.envs.PiezoTrackingEnv`; all lanes begin together, and nothing terminates an
    episode. A step neither waits for the device nor looks at a value, so an action that is NaN is
    not refused by it: it spoils its lane, which :meth:`check` finds. The sensors' noise comes from
    torch's own generator of the device, which a captured graph knows how to advance
    (``torch.manual_seed``).

    Parameters
    ----------
    models
        One plant for all lanes, or one a lane, sensor included.
    layout
        What is shown, in which units, at which sampling time; its action is ``command`` or
        ``increment``.
    lanes
        Number of lanes B where one model is given.
    command_cost
        Price of a command change over the whole range.
    device, dtype
        As :class:`TorchPlant`.

    Raises
    ------
    InputError
        As :class:`TorchPlant`; actions that correct a baseline.

    Attributes
    ----------
    plant : TorchPlant
        The plants.
    displacement_um, error_um : Tensor
        True displacement y and tracking error r - y (µm), ``float64[B]``, of the last step.
    command_V : Tensor
        Command u (V), ``float64[B]``.
    saturated : Tensor
        Steps of this episode whose action or command was clipped, ``int64[B]``.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> layout = ObservationLayout.for_plant(named_plant("P5"), ts_s=1e-3, preview=1)
    >>> task = TorchTracking(named_plant("P5"), layout, lanes=2)
    >>> task.reset(torch.zeros(100, 2)).shape
    torch.Size([2, 4])
    >>> observation, reward = task.step(torch.tensor([0.0, 0.1]))
    >>> task.error_um.round(decimals=3).tolist(), round(float(reward[1]), 4)
    ([0.0, -1.823], -0.1823)
    """

    def __init__(
        self,
        models: PlantModel | Sequence[PlantModel],
        layout: ObservationLayout,
        lanes: int = 1,
        *,
        command_cost: float = 0.0,
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float32,
    ) -> None:
        if layout.action == "correction":
            raise InputError(
                "action is 'correction', whose baseline does not run on the device; "
                "give a layout of action 'command' or 'increment'"
            )
        self.plant = TorchPlant(models, layout.ts_s, lanes, device, dtype)
        self.layout, self.lanes, self.command_cost = layout, self.plant.lanes, command_cost
        low, high = layout.command_range_V
        self._rest_V = min(max(0.0, low), high)
        sensors = [model.sensor for model in self.plant.models]
        self._noise_um = self._row_or_none([sensor.noise_um for sensor in sensors])
        self._resolution_um = self._row_or_none([sensor.resolution_um for sensor in sensors])
        self._k = torch.zeros((), dtype=torch.int64, device=self.plant.device)
        self._ahead = torch.arange(layout.preview + 1, device=self.plant.device)
        self._shown = torch.zeros((1, 1), dtype=torch.float32, device=self.plant.device)
        zeros = torch.zeros(self.lanes, dtype=ROW, device=self.plant.device)
        self.displacement_um, self.error_um = zeros.clone(), zeros.clone()
        self.command_V = zeros
        self.saturated = torch.zeros_like(zeros, dtype=torch.int64)

    def reset(self, reference_um: ArrayLike | Tensor) -> Tensor:
        """Begin new episodes, every plant at rest at the command nearest 0 V of the range.

        Parameters
        ----------
        reference_um
            References (µm), ``(K, B)``, or ``(K, 1)`` for all lanes; the last sample is held once
            it ends. Kept as it is shown, in float32.

        Returns
        -------
        float32[B, D]
            The first observation.

        Raises
        ------
        InputError
            A reference of another shape or not finite.
        """
        reference = torch.as_tensor(reference_um, device=self.plant.device)
        if reference.ndim != 2 or len(reference) == 0 or reference.shape[1] not in (1, self.lanes):
            raise InputError(
                f"a reference of shape {tuple(reference.shape)} for {self.lanes} lanes; "
                f"give (samples, {self.lanes}) or (samples, 1)"
            )
        if not bool(torch.isfinite(reference).all()):
            sample, lane = torch.argwhere(~torch.isfinite(reference))[0].tolist()
            raise InputError(
                f"sample {sample} of the reference of lane {lane} is {float(reference[sample, lane])}; "
                "give finite displacements (µm)"
            )
        layout = self.layout
        self._shown = ((reference - layout.centre_um) / layout.scale_um).to(torch.float32)
        self.plant.reset(u0_V=self._rest_V)
        self._k.fill_(-1)
        self.saturated.zero_()
        self.command_V.fill_(self._rest_V)
        observation, _ = self._apply(self.command_V.clone())
        return observation

    @torch.no_grad()
    def step(self, action: Tensor) -> tuple[Tensor, Tensor]:
        """Set the next commands.

        Parameters
        ----------
        action
            ``[B]`` or ``[B, 1]``, any floating type, read as the layout says.

        Returns
        -------
        tuple of float32[B, D] and float32[B]
            Observation and reward. The observation is a view of ``[D, B]``, in which the device
            writes side by side.

        Raises
        ------
        InputError
            Another shape.
        """
        if action.shape not in ((self.lanes,), (self.lanes, 1)):
            raise InputError(
                f"an action of shape {tuple(action.shape)} for {self.lanes} lanes; "
                f"give ({self.lanes},) or ({self.lanes}, 1)"
            )
        command, clipped = commanded(self.layout, action.reshape(self.lanes), self.command_V)
        self.saturated.add_(clipped)
        return self._apply(command)

    def check(self) -> None:
        """Refuse lanes that a command which was not finite has spoilt; waits for the device.

        Raises
        ------
        InputError
            With the first such lane.
        """
        spoilt = ~torch.isfinite(self.command_V + self.displacement_um)
        if bool(spoilt.any()):
            raise InputError(
                f"lane {int(spoilt.int().argmax())} was given an action that is not finite; "
                "give numbers of -1 to 1, and reset the lanes"
            )

    def _apply(self, command_V: Tensor) -> tuple[Tensor, Tensor]:
        layout = self.layout
        before_V = self.command_V.clone()
        self.command_V.copy_(command_V)
        self._k.add_(1)
        y = self.plant.step(command_V)
        rows = (self._k + self._ahead).clamp(max=len(self._shown) - 1)
        shown = self._shown.index_select(0, rows).expand(-1, self.lanes)
        self.displacement_um.copy_(y)
        self.error_um.copy_(error_of(layout, shown[0], y))
        seen = observed(layout, shown, self._read(y), command_V)
        reward = rewarded(layout, self.error_um, command_V - before_V, self.command_cost)
        return seen.T, reward

    def _read(self, y_um: Tensor) -> Tensor:
        """What the sensors show of displacements (µm): noise, then rounding to the resolution."""
        noise = None if self._noise_um is None else self._noise_um * torch.randn_like(y_um)
        return read(y_um, noise, self._resolution_um)

    def _row_or_none(self, values: Sequence[float]) -> Tensor | None:
        return torch.tensor(values, dtype=ROW, device=self.plant.device) if any(values) else None
