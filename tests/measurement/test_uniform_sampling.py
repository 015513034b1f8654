"""Uniform within 1 % stays as it is; anything else is resampled, and said so."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rdpi_gym.measurement.sampling import to_uniform
from tests.looping import over


def test_even_steps_pass_without_a_word() -> None:
    t = 5.0 + 1e-3 * np.arange(1000)
    u = np.sin(t)
    grid = to_uniform(t, {"u": u}, "run.csv")
    assert grid.remarks == ()
    assert grid.columns["u"] is u
    np.testing.assert_allclose(grid.t_s, t, rtol=1e-14)


@over("jitter", [0.002, 0.0049])
def test_jitter_within_one_percent_is_taken_as_even(jitter) -> None:
    shift = np.where(np.arange(1000) % 2, jitter, -jitter)  # a step deviates by twice that
    u = np.arange(1000.0)
    grid = to_uniform(1e-3 * (np.arange(1000) + shift), {"u": u}, "run.csv")
    np.testing.assert_array_equal(grid.columns["u"], u)
    assert grid.ts_s == pytest.approx(1e-3, rel=1e-4)
    assert "jitter by up to" in grid.remarks[0]


def test_jitter_above_one_percent_is_resampled() -> None:
    t = 1e-3 * np.arange(1000)
    t[500:900:2] += 1.5e-5
    grid = to_uniform(t, {"u": t**2}, "run.csv")
    assert grid.remarks == (
        "time steps differ by up to 1.5 % from the mean step: "
        "resampled at the median step, 0.001 s, by linear interpolation, 1000 samples became 1000",
    )
    assert grid.columns["u"][500] != t[500] ** 2
    np.testing.assert_allclose(np.diff(grid.t_s), 1e-3, rtol=1e-9)


@pytest.mark.parametrize("as_stamped", [True, False])
def test_samples_whose_stamps_alone_are_off_stay_as_they_are(as_stamped: bool) -> None:
    even = 1e-3 * np.arange(1000)
    t = even + 1e-4 * np.random.default_rng(0).uniform(-1.0, 1.0, even.size)
    taken = t if as_stamped else even
    u = np.abs(np.remainder(9.0 * taken, 2.0) - 1.0)
    grid = to_uniform(t, {"u": u, "y": 0.1 * np.sin(30.0 * taken)}, "run.csv")
    assert np.array_equal(grid.columns["u"], u) is not as_stamped
    assert ("no straighter" in grid.remarks[0]) is not as_stamped


def test_a_clock_that_drifts_by_samples_is_resampled() -> None:
    steps = np.r_[np.full(500, 1.0), np.full(501, 1.009)]
    grid = to_uniform(np.cumsum(steps), {"u": np.cumsum(steps)}, "run.csv")
    assert "resampled" in grid.remarks[0]
    np.testing.assert_allclose(grid.columns["u"], grid.t_s, rtol=1e-12)


@given(st.lists(st.floats(0.5, 3.0), min_size=20, max_size=60), st.floats(-5, 5))
def test_a_straight_line_survives_resampling(steps, slope) -> None:
    t = np.cumsum(steps)
    grid = to_uniform(t, {"u": 2.0 + slope * t}, "run.csv")
    assert grid.t_s[0] == t[0]
    assert grid.t_s[-1] == pytest.approx(t[-1], abs=grid.ts_s)
    if any("resampled" in remark for remark in grid.remarks):
        np.testing.assert_allclose(grid.columns["u"], 2.0 + slope * grid.t_s, atol=1e-9)


def test_a_gap_is_bridged_but_does_not_count() -> None:
    t = np.r_[np.arange(50), np.arange(70, 120)].astype(float)
    grid = to_uniform(t, {"u": t, "period": (t > 60).astype(float)}, "run.csv")
    assert grid.t_s.size == 120
    np.testing.assert_array_equal(np.flatnonzero(~grid.measured), np.arange(50, 70))
    np.testing.assert_array_equal(grid.columns["u"], np.arange(120.0))
    np.testing.assert_array_equal(grid.columns["period"], np.arange(120) >= 70)
    assert grid.remarks == (
        "left out of the error, simulated through in a straight line: 20 of 120 samples (17 %) that "
        "the times skip, the first at 50 s",
    )


def test_gaps_of_more_than_a_fifth_are_bridged_and_do_not_count() -> None:
    t = np.r_[np.arange(50), np.arange(90, 120)].astype(float)
    grid = to_uniform(t, {"u": t}, "run.csv")
    np.testing.assert_array_equal(np.flatnonzero(~grid.measured), np.arange(50, 90))
    assert grid.remarks[1].startswith("left out of the error: 40 samples interpolated across 1 gap")


def test_a_row_that_a_shaken_clock_lost_does_not_count() -> None:
    t = np.arange(200) + np.random.default_rng(0).uniform(-0.1, 0.1, 200)
    grid = to_uniform(np.delete(t, [50, 51, 120]), {"u": np.delete(t, [50, 51, 120])}, "run.csv")
    assert "resampled" in grid.remarks[0]
    left_out = np.flatnonzero(~grid.measured)
    assert {50, 51, 120} <= set(left_out.tolist())
    assert left_out.size < 10


@over("ts_s, decimals", [(3.328e-4, 4), (1.95e-3, 3), (3e-5, 4)])
def test_times_that_were_rounded_are_taken_as_even(ts_s, decimals) -> None:
    k = np.arange(5000)
    u = np.sin(0.01 * k)
    grid = to_uniform(np.round(ts_s * k, decimals), {"u": u}, "run.csv")
    assert grid.columns["u"] is u
    assert grid.ts_s == pytest.approx(ts_s, rel=0.5 * 10**-decimals / (ts_s * 4999) + 1e-12)
    assert grid.remarks[0].startswith(f"times are rounded to {10**-decimals:g} s: taken as even")


def test_the_step_that_the_user_gives_holds_for_rounded_times() -> None:
    k = np.arange(5000)
    t = np.round(3.328e-4 * k, 4)
    grid = to_uniform(t, {"u": np.sin(k)}, "run.csv", sampling_time_s=3.328e-4)
    np.testing.assert_allclose(grid.t_s, 3.328e-4 * k, atol=1e-12)


def test_samples_that_were_lost_are_no_rounding() -> None:
    """One millisecond that is missing is a lost sample, and a clock that wanders is not even."""
    lost = np.delete(np.arange(1000), 500) * 1e-3
    assert "that the times skip" in to_uniform(lost, {"u": lost}, "run.csv").remarks[0]
    wandering = np.cumsum(np.random.default_rng(0).choice([1e-3, 2e-3], 1000))
    assert "resampled" in to_uniform(wandering, {"u": wandering}, "run.csv").remarks[0]


def test_records_may_differ_in_sampling_time(tmp_path) -> None:
    from rdpi_gym.measurement import load

    for name, ts_s in (("fast", 1e-4), ("slow", 1e-2)):
        rows = (f"{ts_s * k:.6f},{np.sin(k):.6f},{np.cos(k):.6f}" for k in range(40))
        (tmp_path / f"{name}.csv").write_text("t,u,y\n" + "\n".join(rows))
    data = load(tmp_path)
    assert [(r.name, round(r.ts_s, 9)) for r in data.records] == [("fast", 1e-4), ("slow", 1e-2)]


@over("share", [0.002, 0.05, 0.2])
def test_stamps_that_are_off_are_kept_as_one_number(share) -> None:
    rng = np.random.default_rng(0)
    t = 1e-3 * (np.arange(5000) + rng.uniform(-share, share, 5000))
    found = to_uniform(t, {"u": t}, "run.csv").jitter_s
    assert found == pytest.approx(1e-3 * share / np.sqrt(3.0), rel=0.05)


def test_even_stamps_lost_rows_and_a_slow_clock_are_no_jitter() -> None:
    even = 1e-3 * np.arange(5000)
    lost = np.delete(even, [100, 101, 700, 2222])
    slow = np.cumsum(np.r_[np.full(2500, 1e-3), np.full(2500, 1.009e-3)])
    for t in (even, lost, slow, 7.0 + np.round(even, 3)):
        assert to_uniform(t, {"u": t}, "run.csv").jitter_s == 0.0


@over("ts_s, decimals", [(3.328e-4, 4), (1.95e-3, 3), (1.5e-3, 3)])
def test_rounding_alone_hides_no_clock(ts_s, decimals) -> None:
    t = ts_s * np.arange(20_000)
    assert to_uniform(np.round(t, decimals), {"u": t}, "run.csv").jitter_s == 0.0


def test_jitter_beneath_the_rounding_shows_unless_the_clock_is_known() -> None:
    t = 3.328e-4 * np.arange(20_000)
    shaken = t + np.random.default_rng(1).uniform(-1.5e-5, 1.5e-5, t.size)
    found = to_uniform(np.round(shaken, 4), {"u": t}, "run.csv")
    assert found.remarks[0].startswith("times are rounded to 0.0001 s: taken as even")
    assert found.jitter_s == pytest.approx(1.5e-5 / np.sqrt(3.0), rel=0.3)
    said = to_uniform(np.round(shaken, 4), {"u": t}, "run.csv", sampling_time_s=3.328e-4)
    assert said.jitter_s == 0.0
