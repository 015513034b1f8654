"""With the true rate the classical inverse is exact, memory included."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from baselines.classical import inverse_memory, pack_inverse
from rdpi_gym.plant import RDPI, Plant, PlantModel, pack, settled_memory
from rdpi_gym.plant.cores.play import given_rate_block, rate_block

TS = 1e-4


@st.composite
def models(draw):
    n = draw(st.integers(0, 50))
    a0 = draw(st.floats(0.1, 2.0))
    weights = draw(st.lists(st.floats(0.0, 1.0), min_size=n, max_size=n))
    gaps = draw(st.lists(st.floats(0.02, 3.0), min_size=n, max_size=n))
    return RDPI((a0, *weights), tuple(np.cumsum(gaps)), draw(st.floats(0.0, 1e-3)))


@settings(max_examples=150, deadline=None)
@given(
    model=models(),
    seed=st.integers(0, 2**32 - 1),
    extrema=st.lists(st.floats(-30.0, 30.0), max_size=4),
    bandwidth_hz=st.sampled_from([None, 800.0]),
)
def test_exact_with_the_true_rate(model, seed, extrema, bandwidth_hz):
    model = model.band_limited(bandwidth_hz)
    rng = np.random.default_rng(seed)
    t = TS * np.arange(600)
    u = sum(
        rng.uniform(1, 10) * np.sin(2 * np.pi * rng.uniform(5, 200) * t + rng.uniform(0, 6))
        for _ in range(3)
    )[:, None]
    memory = settled_memory(model.thresholds_V, extrema)
    plant = Plant(PlantModel(model, "drawn", (-99.0, 99.0), (0.0, 10.0)), TS)
    plant.reset(memory=memory)
    y = plant.simulate(u)

    state = np.concatenate([[np.nan, 0.0], memory])[:, None]
    rate = np.empty_like(u)
    rate_block(u, pack([model], TS, [0.0]), state, TS, rate)
    inverse = np.concatenate([[np.nan, 0.0], inverse_memory(model, memory)])[:, None]
    found = np.empty_like(u)
    given_rate_block(y, rate, pack_inverse([model], TS), inverse, found)
    plant.reset(memory=memory)
    reached = plant.simulate_given(found, rate)
    assert np.abs(reached - y).max() <= 1e-12 * np.abs(y).max()


def test_the_rate_enters_every_threshold_alike():
    """s_i = a_0 δ1 i + δ1 Σ_{j<i} a_j (i - j) + a_0 δ2 |v| for Eq. 8."""
    weights, delta1, delta2 = [0.7, 0.2, 0.1, 0.3], 1.5, 4e-4
    column = pack_inverse([RDPI.from_law(weights, delta1, delta2)], TS)[:, 0]
    expected = [
        weights[0] * delta1 * i + delta1 * sum(weights[j] * (i - j) for j in range(1, i))
        for i in (1, 2, 3)
    ]
    np.testing.assert_allclose(column[4:7], expected, rtol=1e-14)
    assert column[7] == weights[0] * delta2
