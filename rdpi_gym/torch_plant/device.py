"""Which device of torch is asked for, and whether it is there."""

from __future__ import annotations

import torch

from rdpi_gym.support.errors import InputError


def checked_device(device: torch.device | str) -> torch.device:
    """Return a device of torch, or refuse one that is not there."""
    try:
        found = torch.device(device)
    except RuntimeError as error:
        raise InputError(
            f"device {device!r} is none that torch knows; give 'cpu' or 'cuda'"
        ) from error
    if found.type == "cuda" and not torch.cuda.is_available():
        raise InputError(f"device {device!r} asked for and no CUDA device is there; give 'cpu'")
    return found
