"""How a command runs between the samples: smooth curves and held steps on a fine grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rdpi_gym.measurement.record import Role
from rdpi_gym.support.arrays import Array


@dataclass(frozen=True, eq=False)
class Drive:
    """What drives the plant during one record.

    Parameters
    ----------
    name, role
        Of the record.
    ts_s
        Sampling time (s).
    parts
        Points of the fine grid in a sampling time; even.
    fine_V : float64[(T - 1) parts + 1]
        True command (V); the k-th sample is taken at point k times `parts`.
    cut
        Samples at the beginning that are not recorded.
    """

    name: str
    role: Role
    ts_s: float
    parts: int
    fine_V: Array
    cut: int = 0

    @property
    def step_s(self) -> float:
        """Step of the fine grid (s)."""
        return self.ts_s / self.parts

    @property
    def command_V(self) -> Array:
        """Command at every sample, those that are not recorded among them."""
        return self.fine_V[:: self.parts]

    @property
    def duration_s(self) -> float:
        """From the first to the last sample (s)."""
        return self.ts_s * (len(self.command_V) - 1)

    @property
    def is_held(self) -> bool:
        """Whether the command is level about every sample, and jumps between."""
        return bool(np.array_equal(self.fine_V[1 :: self.parts], self.command_V[:-1]))


def smooth(curve: Callable[[Array], Array], samples: int, ts_s: float, parts: int) -> Array:
    """Evaluate a command that is a function of time (s) on the fine grid."""
    return curve((ts_s / parts) * np.arange((samples - 1) * parts + 1, dtype=np.float64))


def between(values: Array, parts: int) -> Array:
    """Go from sample to sample in straight lines."""
    points = np.arange((len(values) - 1) * parts + 1)
    return np.interp(points / parts, np.arange(len(values)), values)


def held(u_V: Array, parts: int) -> Array:
    """Hold each sample of a command; a sample is taken in the middle of its hold."""
    points = np.arange((len(u_V) - 1) * parts + 1)
    return u_V[(points + parts // 2) // parts]
