"""What the search may reach: bounds that follow from the data."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rdpi_gym.identification.stack import Stack


class Bounds(NamedTuple):
    """What the search may reach.

    Parameters
    ----------
    delta1_V : tuple of float
        Smallest and largest δ1 (V).
    delta2_s : tuple of float
        Smallest and largest δ2 (s).
    a0 : float
        Smallest a_0 (µm/V).
    motion : float
        A play whose output moves (rms) less than this part of its command in every record is held
        at weight 0.
    reach_V : float
        Largest |memory extremum| (V).
    """

    delta1_V: tuple[float, float]
    delta2_s: tuple[float, float]
    a0: float
    motion: float
    reach_V: float


class Scales(NamedTuple):
    """Sizes of a data set.

    Parameters
    ----------
    excursion_V : float
        Half the largest range (V) of a record's command.
    slowest_V_s, fastest_V_s : float
        Smallest and largest rms rate (V/s) of a record.
    """

    excursion_V: float
    slowest_V_s: float
    fastest_V_s: float


def data_scales(stack: Stack) -> Scales:
    """Measure the commands of a stack."""
    parts = [stack.record(r) for r in range(stack.edges.size - 1)]
    rates = [float(np.sqrt(np.mean(stack.rate_V_s[part] ** 2))) for part in parts]
    excursion = max(float(np.ptp(stack.u_V[part])) for part in parts) / 2
    return Scales(excursion, min(rates), max(rates))


def set_bounds(stack: Stack, n: int, min_motion: float) -> Bounds:
    """Bound a search by what can show in its data.

    A threshold above half the largest range slides once at most, one above the largest command
    never; far below the largest δ2, every threshold is beyond that even in the slowest record.
    """
    scales = data_scales(stack)
    largest = float(np.max(np.abs(stack.u_V)))
    displacement = float(np.linalg.norm(stack.root_weight * stack.y_um))
    gain = displacement / float(np.linalg.norm(stack.root_weight)) / (2 * scales.excursion_V)
    return Bounds(
        delta1_V=(1e-3 * scales.excursion_V / n, min(2 * scales.excursion_V, largest)),
        delta2_s=(0.0, 10 * scales.excursion_V / scales.slowest_V_s),
        a0=1e-4 * gain,
        motion=min_motion,
        reach_V=3 * largest,
    )
