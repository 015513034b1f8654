"""Random plants for the study."""

from __future__ import annotations

import numpy as np

from rdpi_gym.plant import P10, RDPI, PlantModel

NOISE_UM = (0.008, 0.020)
"""Range of the sensor's noise (µm rms) on a stroke of ±40 µm."""


def random_plant(rng: np.random.Generator, name: str = "random") -> tuple[PlantModel, float]:
    """Draw a plant like P10, and the noise of its sensor.

    Parameters
    ----------
    rng
        Where from.
    name
        What tables call it.

    Returns
    -------
    PlantModel
        5 to 12 plays with decaying weights of random shape (ratio of neighbours 0.65 to 0.9, each
        varied by 15 %), their sum within 25 % of P10's and a_0 within 15 %; δ1 within 30 %, δ2
        within a factor of two; range and stroke as P10.
    float
        Noise (µm rms), uniform in :data:`NOISE_UM`.

    Examples
    --------
    >>> plant, noise_um = random_plant(np.random.default_rng(0))
    >>> 5 <= plant.hysteresis.n <= 12, 0.008 <= noise_um <= 0.020
    (True, True)
    """
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
