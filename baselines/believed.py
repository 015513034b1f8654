"""What a belief makes of a displacement that is wanted: the inverses of its hysteresis and of its linear effects."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.classical import ClassicalReferenceRate
from baselines.core_inverse import CoreInverse
from baselines.feedforward import Feedforward
from baselines.inverses.preview_filter import inverse_series
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import RDPI, PlantModel
from rdpi_gym.plant.effects.linear import linear_block
from rdpi_gym.support.arrays import Array

POWERS = 4
"""Powers of θ, from 0 on, of an inverse of linear effects."""


def hysteresis_inverse(belief: PlantModel, layout: ObservationLayout) -> Feedforward:
    """Return the inverse of a belief's hysteresis: the classical one of RDPI, else the bracketed search."""
    inverse: type[Feedforward] = (
        ClassicalReferenceRate if isinstance(belief.hysteresis, RDPI) else CoreInverse
    )
    return inverse(belief, layout)


def answered(
    inverse: Feedforward,
    observation: NDArray[np.floating[Any]],
    wanted_um: Array,
    memory: Array,
) -> Array:
    """Return u(k+1) (V), ``(B,)``, with which the hysteresis gives what is wanted."""
    return inverse.next_command(observation, np.stack([wanted_um, wanted_um]), memory)


def believed_inverse(belief: PlantModel, ts_s: float) -> tuple[float, Array]:
    """Return the belief's delay in samples, and its linear effects' inverse in powers of θ."""
    delay, series = 0.0, np.array([1.0, *[0.0] * (POWERS - 1)])
    for effect in belief.effects:
        sampled = effect.sampled_at(ts_s)
        if sampled.name == "delay":
            delay += sampled.values["delay_s"] / ts_s
        elif type(sampled).block is linear_block:
            own = inverse_series(sampled.coefficients(ts_s, belief.hysteresis), POWERS - 1)
            series = np.convolve(series, own)[:POWERS]
    return delay, series


def ahead_by(samples: float, powers: int = POWERS) -> Array:
    """Return what looks ahead by so many samples, in powers of θ."""
    return np.array([samples**q / math.factorial(q) for q in range(powers)])
