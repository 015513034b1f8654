"""The law of the tracking environment on tensors: how actions are read, what is shown, what is rewarded.

None of it looks at a value; what a lane has one of is float64, what is shown float32.
"""

from __future__ import annotations

import torch
from torch import Tensor

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.torch_plant.state import ROW


def commanded(
    layout: ObservationLayout, action: Tensor, command_V: Tensor
) -> tuple[Tensor, Tensor]:
    """Read actions as commands."""
    low, high = layout.command_range_V
    given = action.to(ROW)
    place = given.clamp(-1.0, 1.0)
    if layout.action == "command":
        wanted = low + 0.5 * (place + 1.0) * (high - low)
        return wanted.clamp(max=high), place != given
    wanted = command_V + place * layout.action_scale_V
    command = wanted.clamp(low, high)
    return command, (place != given) | (command != wanted)


def error_of(layout: ObservationLayout, shown: Tensor, displacement_um: Tensor) -> Tensor:
    """Tracking error r - y (µm), ``float64[B]``, of references as they are shown, ``float32[B]``."""
    return layout.centre_um + layout.scale_um * shown.to(ROW) - displacement_um


def read(displacement_um: Tensor, noise_um: Tensor | None, resolution_um: Tensor | None) -> Tensor:
    """Return what sensors read (µm): noise, then rounding to the resolution; None: there is none."""
    y = displacement_um if noise_um is None else displacement_um + noise_um
    if resolution_um is None:
        return y
    return torch.where(resolution_um > 0.0, (y / resolution_um).round() * resolution_um, y)


def observed(
    layout: ObservationLayout, shown: Tensor, measured_um: Tensor, command_V: Tensor
) -> Tensor:
    """Observations, ``float32[D, B]``: side by side as devices write them."""
    ends_um = (shown[i].to(ROW) * layout.scale_um + layout.centre_um for i in (-1, 0))
    blocks = layout.encode(shown, ends_um, measured_um, command_V)
    return torch.cat([block.to(torch.float32) for block in blocks])


def rewarded(
    layout: ObservationLayout, error_um: Tensor, moved_V: Tensor, command_cost: float
) -> Tensor:
    """Rewards, ``float32[B]``, of errors (µm) and changes of the command (V), ``float64[B]``."""
    low, high = layout.command_range_V
    reward = -error_um.abs() / layout.scale_um - command_cost * moved_V.abs() / (high - low)
    return reward.to(torch.float32)
