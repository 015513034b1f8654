"""Data that no fit can use are refused in one line."""

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.identification import fit, pooled_rmse, simulate_record, validation_rmse
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import P10, Plant
from rdpi_gym.support.errors import InputError
from studies.identification import yardstick
from tests.looping import over


def sine(name="sine", samples=600, sign=1.0):
    t = np.arange(samples) * 1e-3
    u = 30.0 * np.sin(2 * np.pi * 5.0 * t)
    return Record(name, t, u, sign * Plant(P10, 1e-3).simulate(u), ts_s=1e-3)


def still():
    t = np.arange(100) * 1e-3
    return Record("rest", t, np.ones(100), np.zeros(100), ts_s=1e-3)


def masked():
    return replace(sine(), error_mask=np.zeros(600, dtype=bool))


@over(
    "records, keywords, words",
    [
        ([], {}, "no record to fit"),
        ([still()], {}, "no record to fit"),
        ([masked()], {}, "record sine has no sample that counts"),
        ([sine(), sine()], {}, "two records are named 'sine'"),
        ([sine(sign=-1.0)], {}, "the displacement falls where the voltage rises"),
        ([sine()], {"n": 0}, "0 play operators; give 1 or more"),
        ([sine(samples=20)], {}, "20 samples count for 14 parameters"),
        ([sine()], {"rate_bandwidth_hz": 0.0}, "rate_bandwidth_hz is 0.0"),
        ([sine()], {"rate_bandwidth_hz": float("nan")}, "rate_bandwidth_hz is nan"),
        ([sine()], {"min_motion": 1.0}, "min_motion is 1.0"),
    ],
)
def test_a_fit_says_what_is_wrong(records, keywords, words):
    with pytest.raises(InputError, match=words) as refused:
        fit(records, **keywords)
    assert "\n" not in str(refused.value)


def test_a_data_set_without_training_records_is_refused():
    held = replace(sine(), role="validation")
    with pytest.raises(InputError, match="no record to fit"):
        fit(Dataset("only validation", (held,)))


def test_the_yardstick_refuses_too():
    with pytest.raises(InputError, match="method 'newton' is unknown; give trf or SLSQP"):
        yardstick([sine()], method="newton")
    with pytest.raises(InputError, match="0 play operators"):
        yardstick([sine()], n=0)


def test_so_does_a_comparison():
    with pytest.raises(InputError, match="no sample that counts"):
        simulate_record(P10, masked())
    with pytest.raises(InputError, match="no record to compare"):
        pooled_rmse([])
    with pytest.raises(InputError, match="no record to compare"):
        validation_rmse(P10, [])
