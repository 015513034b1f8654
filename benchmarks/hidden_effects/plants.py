"""Random plants for the study."""

from __future__ import annotations

import numpy as np

from rdpi_gym.plant import P10, RDPI, PlantModel

NOISE_UM = (0.008, 0.020)
"""Range of the sensor's noise (µm rms) on a stroke of ±40 µm."""


def random_plant(rng: np.random.Generator, name: str = "random") -> tuple[PlantModel, float]:
    """Draw a plant like P10, and the noise of its sensor."""
    h = P10.hysteresis
    n = int(rng.integers(5, 13))
    shape = rng.uniform(0.65, 0.9) ** np.arange(n) * np.exp(rng.normal(0.0, 0.15, n))
    shape = np.sort(shape)[::-1]
    weights = h.S * rng.uniform(0.75, 1.25) * shape / shape.sum()
    a0 = h.a0 * rng.uniform(0.85, 1.15)
    hysteresis = RDPI.from_law(
        [a0, *weights.tolist()],
        delta1_V=h.thresholds_V[0] * rng.uniform(0.7, 1.3),
        delta2_s=h.delta2_s * 2.0 ** rng.uniform(-1.0, 1.0),
    )
    plant = PlantModel(hysteresis, name, P10.command_range_V, P10.reference_um)
    return plant, float(rng.uniform(*NOISE_UM))
