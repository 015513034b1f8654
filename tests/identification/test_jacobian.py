"""Derivatives over a record are those of lanes that are simulated one by one."""

from dataclasses import replace

import numpy as np

from rdpi_gym.identification.jacobian import Neighbours, Variant, simulate_effects
from rdpi_gym.measurement import Record
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.effects import load_effect
from rdpi_gym.plant.effects.base import in_chain_order

TS = 1e-3


def test_a_fit_steps_the_weights_of_plays_between_envelopes_too():
    core = RDPI((0.7, 0.3, 0.2), (2.0, 5.0), 1e-4, 300.0)
    effects = (
        load_effect("asymmetry", "unlike envelopes")(0.2, 0.1, 0.3, 0.0, 5.0, 60.0),
        load_effect("congruency")(0.1),
    )
    u = 40.0 * np.sin(np.arange(1500) / 30.0) * np.linspace(0.2, 1.0, 1500)
    record = Record("run", np.arange(u.size) * TS, u, np.zeros_like(u), ts_s=TS)
    base = Variant(core, in_chain_order(effects))
    faster = replace(base, hysteresis=replace(core, delta2_s=2e-4))
    gain_steps = np.full(len(core.gains), 1e-3)
    lanes = Neighbours(base, [faster], np.array([1e-4]), gain_steps)
    rows = lanes.derivatives(record, np.arange(u.size))
    y = simulate_effects([base], record)[:, 0]
    for k in range(3):
        stepped = (*core.weights[:k], core.weights[k] + 1e-3, *core.weights[k + 1 :])
        lane = replace(base, hysteresis=replace(core, weights=stepped))
        alone = simulate_effects([lane], record)[:, 0]
        np.testing.assert_allclose(rows[:, k], (alone - y) / 1e-3, atol=1e-8)
    np.testing.assert_allclose(
        rows[:, 3], (simulate_effects([faster], record)[:, 0] - y) / 1e-4, atol=1e-6
    )
    np.testing.assert_allclose(rows[:, 4], -y, atol=1e-12)
