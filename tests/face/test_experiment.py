"""The advised experiment as a command: within the records' range, without jumps, at the rate asked for."""

from dataclasses import replace

import numpy as np
import pytest

import rdpi_gym as rg
from rdpi_gym.diagnosis.notices import RECORDS, Notice
from rdpi_gym.diagnosis.search.separability import next_experiment
from rdpi_gym.diagnosis.words import text_of
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Record
from rdpi_gym.support.errors import InputError
from tests.looping import over


def recorded(low, high):
    """Records of one loop between two commands."""
    t = np.arange(2000) * 1e-3
    u = low + (high - low) * (0.5 - 0.5 * np.cos(2 * np.pi * 2.0 * t))
    return rg.Dataset("one", (Record("one", t, u, 0.1 * u, ts_s=1e-3),))


@over("code", RECORDS)
def test_it_starts_and_ends_where_a_stage_rests_and_stays_in_range(code):
    planned = rg.plan_experiment(Notice(code, ("rdpi", "stop")), recorded(20.0, 100.0), "P5")
    assert planned.u_V[0] == planned.u_V[-1] == 20.0  # the command nearest 0 V
    assert planned.u_V.min() >= 20.0
    assert planned.u_V.max() <= 100.0
    assert np.allclose(np.diff(planned.t_s), 1.0 / planned.rate_hz)


def test_advice_for_a_slow_plant_is_as_slow_as_its_records():
    t = np.arange(5000) * 2.0  # a sample every two seconds, twenty minutes a period
    u = 10.0 * np.sin(2 * np.pi * t / 1200.0)
    wire = rg.Dataset("wire", (Record("wire", t, u, 0.9 * u, ts_s=2.0),))
    fast = rg.plan_experiment("sines at four rates", recorded(-10.0, 10.0), "P5")
    slow = rg.plan_experiment("sines at four rates", wire, "P5")
    assert slow.rate_hz == pytest.approx(1e-3 * fast.rate_hz)
    assert slow.seconds == pytest.approx(1e3 * fast.seconds, rel=1e-3)
    creep, lag = rg.effects["creep"](), rg.effects["actuator_lag"]()
    advice = next_experiment(creep, lag, rg.plants["P5"].hysteresis, data_scale(wire.train))
    assert "slowed 10000-fold" in text_of(advice)
    assert "20000 samples a second" not in text_of(advice)


def test_a_file_at_a_chosen_rate_holds_the_signal(tmp_path):
    planned = rg.plan_experiment("same motion twice", recorded(-10.0, 10.0), "P5", 500.0)
    read = np.genfromtxt(planned.write(tmp_path / "next.csv"), delimiter=",", names=True)
    assert read.dtype.names == ("t_s", "u_V")
    assert np.allclose(read["u_V"], planned.u_V, rtol=0, atol=1e-10)
    assert read.size == planned.seconds * 500.0


def test_the_same_motion_again_is_sampled_four_times_as_fast():
    data = recorded(-10.0, 10.0)
    planned = rg.plan_experiment("Record the same motion again, sampled faster.", data, "P5")
    assert planned.rate_hz == pytest.approx(4000.0)
    assert np.allclose(planned.u_V[::4], data.records[0].u_V, atol=1e-9)


@over("rate, said", [(1.0, "too slow"), (1e7, "samples; give"), (-1.0, "above 0")])
def test_a_rate_that_cannot_be_played_is_one_line(rate, said):
    with pytest.raises(InputError, match=said):
        rg.plan_experiment("steps with holds", recorded(-10.0, 10.0), "P5", rate)


def test_what_is_no_motion_is_none():
    data = recorded(-10.0, 10.0)
    assert rg.plan_experiment(None, data, "P5") is None
    assert rg.plan_experiment("Record longer.", data, "P5") is None


def test_a_controller_tracks_a_drawn_reference_better_the_more_it_believes():
    t = np.arange(600) * 1e-3
    drawn = np.interp(t, [0.0, 0.2, 0.35, 0.6], [0.0, 6.0, -4.0, 5.0])
    creeping = replace(rg.plants["P5"], effects=(rg.effects["creep"](gain_per_decade=0.1),))
    blind = rg.track("extended-inverse", creeping, drawn, 1e-3, belief="P5")
    knowing = rg.track("extended-inverse", creeping, drawn, 1e-3)
    assert knowing.rmse_um < blind.rmse_um / 3
    assert knowing.rmse_um == pytest.approx(
        np.sqrt(np.mean((knowing.displacement_um - drawn)[1:] ** 2)), rel=1e-12
    )


def test_a_reference_beyond_the_range_says_so():
    far = rg.track("extended-inverse", "P5", 500.0 * np.sin(np.arange(100.0)), 1e-3)
    assert "saturated" in far.warning
    with pytest.raises(InputError, match="does not move"):
        rg.track("pi", "P5", np.ones(50), 1e-3)
