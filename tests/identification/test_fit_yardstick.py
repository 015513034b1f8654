"""The paper's own way of identification, kept as the yardstick."""

import numpy as np
import pytest

from rdpi_gym.identification import fit
from rdpi_gym.measurement import Record
from rdpi_gym.plant import P5, Plant
from studies.identification import yardstick


def sines(noise_um):
    rng = np.random.default_rng(0)
    records = []
    for frequency_hz, ts_s in ((5.0, 1e-3), (50.0, 1e-4)):
        t = np.arange(0.0, 3 / frequency_hz, ts_s)
        u = 20.0 * np.sin(2 * np.pi * frequency_hz * t)
        y = Plant(P5, ts_s).simulate(u) + noise_um * rng.standard_normal(t.size)
        records.append(Record(f"{frequency_hz:g} Hz", t, u, y + 3.0, ts_s=ts_s))
    return records


def test_both_ways_meet_the_same_optimum():
    records = sines(0.02)
    ours, theirs = fit(records, n=5), yardstick(records, n=5)
    assert ours.train_rmse_um <= theirs.train_rmse_um * (1 + 1e-6)
    assert theirs.hysteresis.delta2_s == pytest.approx(ours.parameters["delta2_s"], rel=0.01)
    assert theirs.train_rmse_um == pytest.approx(0.02, rel=0.05)


def test_the_quadratic_programme_minimises_the_same_sum():
    records = sines(0.02)
    found = yardstick(records, n=5, method="SLSQP")
    assert fit(records, n=5).train_rmse_um <= found.train_rmse_um * (1 + 1e-6)
    assert found.train_rmse_um < 0.2
    assert found.evaluations > 100
