"""Actor and critic on a torch device."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from baselines.learned.native.networks import ActorCritic


class DeviceActorCritic(ActorCritic):
    """:class:`~baselines.learned.native.networks.ActorCritic` on a device, of the same first weights.

    Parameters
    ----------
    widths, log_std, seed
        As there.
    device
        Where the parameters live.

    Examples
    --------
    >>> from baselines.learned.native.networks import Workspace
    >>> both = DeviceActorCritic((3, 8, 1), log_std=-1.0, seed=0, device="cpu")
    >>> both.forward(torch.zeros(5, 3), Workspace(both.widths)).shape
    torch.Size([2, 5, 1])
    """

    def __init__(
        self, widths: Sequence[int], log_std: float, seed: int, device: torch.device | str
    ) -> None:
        super().__init__(widths, log_std, seed)
        self._point(self.parameters.to(device))

    def _bend(self, layer: Tensor) -> None:
        layer.tanh_()
