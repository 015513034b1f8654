"""A model against records: one free offset, every record weighted by its samples."""

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.identification import pooled_rmse, simulate_record, validation_rmse
from rdpi_gym.measurement import Record
from rdpi_gym.plant import P10, Plant, settled_memory


def make_record(samples, error_um, extremum_V=0.0, name="run"):
    t = np.arange(samples) * 1e-3
    u = 15.0 * np.sin(2 * np.pi * 5.0 * t)
    plant = Plant(P10, 1e-3)
    plant.reset(memory=settled_memory(P10.hysteresis.thresholds_V, [extremum_V]))
    wobble = error_um * np.where(np.arange(samples) % 2, 1.0, -1.0)
    return Record(name, t, u, plant.simulate(u) + 7.0 + wobble, ts_s=1e-3)


def test_the_offset_is_free_and_the_model_is_simulated_whole():
    left = simulate_record(P10, make_record(400, 0.5))
    assert left.offset_um == pytest.approx(7.0)
    assert left.rmse_um == pytest.approx(0.5)
    assert left.simulated_um.shape == left.error_um.shape == (400,)
    assert left.counted == 400


def test_masked_samples_do_not_count():
    record = make_record(400, 0.5)
    mask = np.ones(400, dtype=bool)
    mask[:100] = False
    record.y_um[:100] += 99.0
    left = simulate_record(P10, replace(record, error_mask=mask))
    assert (left.counted, left.rmse_um) == (300, pytest.approx(0.5))


def test_the_memory_of_a_record_is_given_by_its_extremum():
    record = make_record(400, 0.0, extremum_V=9.0)
    assert simulate_record(P10, record, 9.0).rmse_um < 1e-12
    assert simulate_record(P10, record).rmse_um > 0.1
    assert validation_rmse(P10, [record], {"run": 9.0}) < 1e-12


def test_records_weigh_by_their_samples():
    short, long = make_record(200, 1.0, name="a"), make_record(600, 0.2, name="b")
    expected = np.sqrt((200 * 1.0**2 + 600 * 0.2**2) / 800)
    assert validation_rmse(P10, [short, long]) == pytest.approx(expected)
    assert pooled_rmse([simulate_record(P10, short)]) == pytest.approx(1.0)
