"""Residual of a record from several sides, and a stretch that is brushed in one of them."""

import numpy as np
import pytest

from rdpi_gym.laboratory.views import brushed, residual_views
from rdpi_gym.measurement import Record
from rdpi_gym.support.errors import InputError

TS_S = 1e-3
T_S = 5.0 + np.arange(4000) * TS_S


@pytest.fixture
def record():
    """A sine of 2 Hz and 10 V for two periods, then a step to 10 V that is held for three seconds."""
    since_s = T_S - 5.0
    u_V = np.where(since_s < 1.0, 10.0 * np.sin(4.0 * np.pi * since_s), 10.0)
    return Record("stairs", T_S, u_V, 0.5 * u_V, ts_s=TS_S)


def model_um(record):
    """Misses 0.1 µm at 20 Hz, and what creeps by 0.3 µm in each second of the hold."""
    since_s = T_S - 6.0
    missed = 0.1 * np.sin(40.0 * np.pi * T_S) + 0.3 * np.clip(since_s, 0.0, None)
    return record.y_um - missed


def test_residual_stands_where_it_is(record):
    views = residual_views(record, model_um(record), 0.02)
    hz, um = (np.array(views["frequency"][key]) for key in ("hz", "um"))
    near = hz > 10.0
    assert hz[near][np.argmax(um[near])] == pytest.approx(20.0, rel=0.13)
    s, gone = (np.array(views["rest"][key]) for key in ("s", "um"))
    late = s > 0.5
    np.testing.assert_allclose(gone[late] - gone[-1], 0.3 * (s[late] - s[-1]), atol=0.12)
    assert views["noise_um"] == 0.02


def test_a_stretch_over_the_command_is_where_the_command_is(record):
    found = brushed(record, model_um(record), "command", 4.0, 6.0)
    assert len(found["spans_s"]) == 4  # up and down in each of two periods
    up = [np.arcsin(level / 10.0) / (4.0 * np.pi) for level in (4.0, 6.0)]
    assert found["spans_s"][0] == pytest.approx([5.0 + up[0], 5.0 + up[1]], abs=TS_S)
    assert found["loop"]["u"].count(None) == 3
    assert found["rms_um"] == pytest.approx(0.1 / np.sqrt(2.0), rel=0.4)  # the hum alone
    u = np.array(found["command"]["u"])
    assert ((u >= 4.0) & (u <= 6.0)).all()


@pytest.mark.parametrize("by", ["time", "command", "rate", "rest"])
def test_an_open_stretch_is_all_that_the_side_shows(by, record):
    found = brushed(record, model_um(record), by, None, None)
    assert found["spans_s"] == [[pytest.approx(6.001 if by == "rest" else 5.0), T_S[-1]]]


def test_a_stretch_without_samples_is_empty_everywhere(record):
    found = brushed(record, model_um(record), "time", 1.0, 2.0)
    assert found["spans_s"] == found["time"]["t_s"] == found["loop"]["u"] == []
    assert found["frequency"]["hz"] == found["rest"]["s"] == []
    assert found["rms_um"] is None


def test_a_side_that_is_none_is_refused(record):
    with pytest.raises(
        InputError, match="by is 'frequency'; give one of time, command, rate, rest"
    ):
        brushed(record, model_um(record), "frequency", 1.0, 2.0)
