"""Records of known plants, for comparisons of which the answer is known."""

import numpy as np
import pytest

from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import Plant, PlantModel


@pytest.fixture
def sine_record():
    """Build a record of a plant under a sine command (V, Hz), with a gain, noise and offset (µm)."""

    def build(
        model: PlantModel,
        frequency_hz: float = 5.0,
        amplitude_V: float = 10.0,
        *,
        name: str = "sine",
        periods: float = 8.0,
        gain: float = 1.0,
        noise_um: float = 0.0,
        offset_um: float = 0.0,
        per_period: int = 400,
        **keywords,
    ) -> Record:
        ts_s = 1.0 / (frequency_hz * per_period)
        t = np.arange(round(periods * per_period)) * ts_s
        u = amplitude_V * np.sin(2 * np.pi * frequency_hz * t)
        y = gain * Plant(model, ts_s).simulate(u) + offset_um
        y += noise_um * np.random.default_rng(7).standard_normal(t.size)
        return Record(name, t, u, y, ts_s=ts_s, **keywords)

    return build


@pytest.fixture
def dataset():
    """Put records into a data set."""

    def build(*records: Record) -> Dataset:
        return Dataset("made of known plants", records)

    return build
