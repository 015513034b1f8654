"""Checks of what a caller hands to the vector environment."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numba import njit
from numpy.typing import NDArray

from rdpi_gym.envs.vector.lanes import Flags
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_whole, shape_of, shown
from rdpi_gym.support.errors import InputError


def checked_count(name: str, value: Any, what: str, most: int) -> int:
    """Return a whole number of at least 1 and at most `most`."""
    if not is_whole(value, 1) or value > most:
        raise InputError(
            f"{name} is {shown(value)}; give a whole number of {what}, at least 1 and at most {most}"
        )
    return int(value)


def checked_mode(mode: Any) -> AutoresetMode:
    """Return an autoreset mode, given as such or by its value."""
    try:
        return AutoresetMode(mode)
    except (TypeError, ValueError):
        modes = ", ".join(repr(each.value) for each in AutoresetMode)
        raise InputError(f"autoreset_mode is {shown(mode)}; give one of {modes}") from None


def checked_seeds(seed: Any, lanes: int) -> list[int | None]:
    """Return a seed for each lane: None leaves its generator as it is."""
    if seed is None:
        return [None] * lanes
    if is_whole(seed, -math.inf):
        seeds: list[Any] = [int(seed) + lane for lane in range(lanes)]
    elif isinstance(seed, Sequence | np.ndarray) and not isinstance(seed, str):
        seeds = list(np.atleast_1d(seed) if isinstance(seed, np.ndarray) else seed)
    else:
        raise InputError(f"seed is {shown(seed)}; give a whole number, or one for each lane")
    if len(seeds) != lanes:
        raise InputError(f"{len(seeds)} seeds for {lanes} lanes; give one for each lane")
    for lane, each in enumerate(seeds):
        if each is not None and not (is_whole(each, 0) and each < 2**64):
            raise InputError(f"the seed of lane {lane} is {shown(each)}; seeds are 0 to 2**64 - 1")
    return seeds


def checked_mask(mask: Any, lanes: int) -> Flags:
    """Return a mask of lanes."""
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (lanes,):
        found = f"{type(mask).__name__}"
        if isinstance(mask, np.ndarray):
            found = f"{mask.dtype} of shape {mask.shape}"
        raise InputError(f"reset_mask is {found}; give a numpy array of bool of shape ({lanes},)")
    if not mask.any():
        raise InputError("reset_mask is false for every lane; give one that is true somewhere")
    return mask


@njit(cache=True, fastmath={"reassoc"})
def _read(actions: NDArray[np.floating[Any]], numbers: Array) -> float:
    # NaN where a number is NaN or infinite; the sum may be reordered, so it runs on vector units.
    total = 0.0
    for b in range(len(actions)):
        numbers[b] = actions[b]
        total += 0.0 * numbers[b]
    return total


def checked_actions(actions: Any, lanes: int) -> Array:
    """Return actions ``(B, 1)`` as contiguous ``float64[B]``."""
    numeric = isinstance(actions, np.ndarray) and actions.dtype.kind in "fiu"
    if not numeric or actions.shape != (lanes, 1):
        raise InputError(
            f"actions are {type(actions).__name__} of shape {shape_of(actions)}; "
            f"give a numpy array of numbers of shape ({lanes}, 1), -1 to 1"
        )
    if actions.dtype != np.float32:
        actions = actions.astype(np.float64)
    numbers = np.empty(lanes)
    if _read(np.ascontiguousarray(actions.reshape(-1)), numbers) != 0.0:
        lane = int(np.argmin(np.isfinite(numbers)))
        raise InputError(
            f"action of lane {lane} is {numbers[lane]}; give finite numbers of -1 to 1"
        )
    return numbers
