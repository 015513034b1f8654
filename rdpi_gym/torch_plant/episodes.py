"""Tracking problems whose episodes begin at times of their own, with plants and references of a pool."""

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


class TorchEpisodes:
    """B tracking problems on a device, each at a time of its own in an episode of its own.

    Everything that an episode may begin with is made once, in pools: plants that have been at rest
    for a sample, and references. So lanes begin by copying columns on the device, and as little as
    :meth:`step` does :meth:`begin` wait for it or look at a value. Noise is handed in: no generator
    stands in what is captured. Otherwise as :class:`TorchTracking`.

    Parameters
    ----------
    models
        Pool of plants: the same effects, core and sensor, at sizes of their own.
    references_um
        Pool of references (µm), ``(K, R)``; the last sample is held once one ends.
    layout
        What is shown; its action is ``command`` or ``increment``.
    lanes
        Number of lanes B.
    command_cost
        Price of a command change over the whole range.
    bound_um
        Distance from the layout's centre (µm) at which readings end; None: nowhere.
    device
        As :class:`TorchPlant`.

    Raises
    ------
    InputError
        As :class:`TorchPlant`; actions that correct a baseline; a pool of references of another
        shape or not finite.

    Attributes
    ----------
    plant : TorchPlant
        The plants of the lanes.
    error_um, command_V : Tensor
        Tracking error (µm) and command (V) of the last step, ``float64[B]``.

    Examples
    --------
    >>> import numpy as np
    >>> from rdpi_gym.plant import named_plant
    >>> layout = ObservationLayout.for_plant(named_plant("P5"), ts_s=1e-3, preview=1)
    >>> lanes = TorchEpisodes([named_plant("P5")], np.zeros((9, 1)), layout, lanes=2)
    >>> every, first, still = torch.arange(2), torch.zeros(2, dtype=torch.int64), torch.zeros(2)
    >>> lanes.begin(every, first, first, still).shape
    torch.Size([2, 4])
    >>> observation, reward = lanes.step(torch.tensor([0.0, 0.1]), still)
    >>> round(float(reward[1]), 4)
    -0.1823
    """

    def __init__(
        self,
        models: Sequence[PlantModel],
        references_um: ArrayLike,
        layout: ObservationLayout,
        lanes: int,
        *,
        command_cost: float = 0.0,
        bound_um: float | None = None,
        device: torch.device | str = "cpu",
    ) -> None:
        if layout.action == "correction":
            raise InputError(
                "action is 'correction', whose baseline does not run on the device; "
                "give a layout of action 'command' or 'increment'"
            )
        references = torch.as_tensor(references_um, dtype=ROW)
        if references.ndim != 2 or 0 in references.shape or not bool(references.isfinite().all()):
            raise InputError(
                f"a pool of references of shape {tuple(references.shape)}; give finite displacements "
                "(µm) of shape (samples, references)"
            )
        self._pool = TorchPlant(list(models), layout.ts_s, device=device)
        self.layout, self.lanes, self.command_cost = layout, lanes, command_cost
        where = self._pool.device
        # One reference after the other: what a lane sees ahead lies side by side.
        shown = ((references.T - layout.centre_um) / layout.scale_um).to(torch.float32)
        self._samples, self._shown = shown.shape[1], shown.contiguous().to(where).view(-1)
        low, high = layout.command_range_V
        self._rest_V = min(max(0.0, low), high)
        rest = torch.full((self._pool.lanes,), self._rest_V, dtype=ROW, device=where)
        self._pool.reset(u0_V=rest)
        self._first_um = self._pool.step(rest)
        sensor = self._pool.models[0].sensor
        self._noise_um = sensor.noise_um
        self._resolution_um: Tensor | None = None
        if sensor.resolution_um:
            self._resolution_um = torch.full((), sensor.resolution_um, dtype=ROW, device=where)
        self._bound_um = torch.inf if bound_um is None else bound_um
        self.plant = self._pool.picked(torch.zeros(lanes, dtype=torch.int64, device=where))
        self._k = torch.zeros(lanes, dtype=torch.int64, device=where)
        self._reference = torch.zeros_like(self._k)
        self._ahead = torch.arange(layout.preview + 1, device=where)[:, None]
        self.error_um = torch.zeros(lanes, dtype=ROW, device=where)
        self.command_V = torch.full_like(self.error_um, self._rest_V)

    @property
    def counts(self) -> tuple[int, int]:
        """Numbers of plants and of references in the pools."""
        return self._pool.lanes, len(self._shown) // self._samples

    @torch.no_grad()
    def begin(self, lanes: Tensor, plants: Tensor, references: Tensor, noise: Tensor) -> Tensor:
        """Begin episodes in some lanes, their plants at rest at the command nearest 0 V of the range.

        Parameters
        ----------
        lanes
            Which, ``int64[m]``.
        plants, references
            Of the pools, ``int64[m]``.
        noise
            Of the first reading, in units of the sensor's, ``[m]``.

        Returns
        -------
        float32[m, D]
            Their first observations.
        """
        self.plant.become(lanes, self._pool, plants)
        self._k.index_fill_(0, lanes, 0)
        self._reference.index_copy_(0, lanes, references)
        self.command_V.index_fill_(0, lanes, self._rest_V)
        shown = self._ahead_of(torch.zeros_like(references), references)
        command = torch.full_like(noise, self._rest_V, dtype=ROW)
        first_um = self._first_um.index_select(0, plants)
        self.error_um.index_copy_(0, lanes, error_of(self.layout, shown[0], first_um))
        return observed(self.layout, shown, self._read(first_um, noise), command).T

    @torch.no_grad()
    def step(self, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor]:
        """Set the next commands.

        Parameters
        ----------
        action
            ``[B]``, any floating type, read as the layout says.
        noise
            Of the readings, in units of the sensor's, ``[B]``.

        Returns
        -------
        tuple of float32[B, D] and float32[B]
            Observation and reward.
        """
        command, _ = commanded(self.layout, action, self.command_V)
        y = self.plant.step(command)
        self._k.add_(1)
        shown = self._ahead_of(self._k, self._reference)
        self.error_um.copy_(error_of(self.layout, shown[0], y))
        moved_V = command - self.command_V
        self.command_V.copy_(command)
        seen = observed(self.layout, shown, self._read(y, noise), command)
        return seen.T, rewarded(self.layout, self.error_um, moved_V, self.command_cost)

    def _ahead_of(self, k: Tensor, reference: Tensor) -> Tensor:
        """References now and ahead as they are shown, ``float32[preview + 1, m]``."""
        sample = (k + self._ahead).clamp(max=self._samples - 1)
        return torch.take(self._shown, reference * self._samples + sample)

    def _read(self, y_um: Tensor, noise: Tensor) -> Tensor:
        added = self._noise_um * noise.to(ROW) if self._noise_um else None
        low, high = (self.layout.centre_um + sign * self._bound_um for sign in (-1.0, 1.0))
        return read(y_um, added, self._resolution_um).clamp(low, high)
