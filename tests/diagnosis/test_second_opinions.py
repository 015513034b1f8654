"""What the search does where one split, one assumption or one beginning misleads it."""

import itertools
from dataclasses import asdict, replace

import numpy as np
import pytest

from rdpi_gym.diagnosis.features.noise import noise_floor, slowness
from rdpi_gym.diagnosis.notices import Code
from rdpi_gym.diagnosis.preprocessing import inspect
from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.diagnosis.search.setting import Setting
from rdpi_gym.diagnosis.search.verdict import judge, numerical_floor
from rdpi_gym.diagnosis.words import text_of
from rdpi_gym.identification.jacobian import Variant, simulate_effects
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import P10, RDPI
from rdpi_gym.plant.effects import CATALOGUE, load_effect
from rdpi_gym.virtual_lab.independent import simulate_truth
from tests.looping import over

NOISE_UM = 0.01
UNLIKE = RDPI((1.0, 0.3, 0.0, 0.15, 0.0, 0.25), (4.0, 9.0, 11.0, 20.0, 23.0), 2e-5)


def chirp(t, level, low_hz, high_hz):
    growth = np.log(high_hz / low_hz) / t[-1]
    return level * np.sin(2.0 * np.pi * low_hz / growth * np.expm1(growth * t))


def ramps(levels, hold, ramp):
    """Levels that are held, and go from one to the next along a cosine."""
    found = [np.full(hold, levels[0])]
    for a, b in itertools.pairwise(levels):
        share = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, ramp + 1) / ramp)
        found += [a + (b - a) * share, np.full(hold, b)]
    return np.concatenate(found)


def measured(hysteresis, effects, commands, seed=0):
    """Records one after the other: ``{name: (u_V, ts_s)}``; a name with "other" validates."""
    rng, clock, records = np.random.default_rng(seed), 0.0, []
    for name, (u, ts) in commands.items():
        t = clock + ts * np.arange(u.size)
        y = simulate_truth(asdict(hysteresis), list(effects), t, u)
        role = "validation" if "other" in name else "train"
        y = y + NOISE_UM * rng.standard_normal(u.size)
        records.append(Record(name, t, u, y, ts_s=ts, role=role))
        clock = float(t[-1]) + 1.0
    return Dataset("records", tuple(records))


def fast_and_slow():
    levels = np.random.default_rng(3).uniform(-38.0, 38.0, 30)
    return {
        "chirp": (chirp(np.arange(8000) * 1e-4, 40.0, 5.0, 150.0), 1e-4),
        "stairs": (ramps(np.array([0.0, 20.0, 40.0, 0.0, -40.0, -20.0, 0.0]), 500, 25), 2e-3),
        "other-stairs": (ramps(np.concatenate([[0.0, 40.0, -40.0], levels]), 90, 25), 2e-3),
    }


@pytest.mark.slow
def test_unlike_weights_are_not_smoothed_away_where_loops_have_one_size():
    hidden = load_effect("creep", "one time constant")(gain=0.02, time_constant_s=0.4)
    data = measured(UNLIKE, [], fast_and_slow())
    variant = Variant(UNLIKE, (hidden,))
    rng = np.random.default_rng(1)
    records = tuple(
        replace(
            r,
            y_um=simulate_effects([variant], r)[:, 0] + NOISE_UM * rng.standard_normal(r.t_s.size),
        )
        for r in data.records
    )
    found = discover(replace(data, records=records), catalogue={"creep": CATALOGUE["creep"]})
    assert [c.effect for c in found.added] == ["creep"]
    assert found.final.validation_rmse_um < 1.3 * NOISE_UM


@pytest.mark.slow
def test_what_a_record_to_validate_on_does_not_show_is_judged_within_the_records():
    hidden = [{"effect": "sensor_lag", "time_constant_s": 1.2e-3}]
    drift = [{"effect": "gain_drift", "rate_per_s": 5e-4}]
    names = ("sensor_lag", "gain_drift", "saturation", "creep", "delay")
    catalogue = {name: CATALOGUE[name] for name in names}
    found = discover(measured(P10.hysteresis, hidden + drift, fast_and_slow()), catalogue=catalogue)
    assert {c.effect for c in found.added} == {"sensor_lag", "gain_drift"}
    assert found.verdict == "explained"
    # what was taken out again, if anything, does not lead the ranking
    assert found.candidates[0].effect == found.added[0].effect


def test_a_corner_that_a_model_misses_is_no_outlier():
    u = 40.0 * np.sin(2.0 * np.pi * 25.0 * np.arange(4000) * 1e-3)
    kinds = {"slew_limit": CATALOGUE["slew_limit"]}
    data = measured(
        P10.hysteresis, [{"effect": "slew_limit", "rate_V_s": 3000.0}], {"run": (u, 1e-3)}
    )
    assert not [f for f in inspect(data).findings if f.kind == "spikes"]
    assert not [f for f in discover(data, catalogue=kinds).findings if f.kind == "spikes"]


def test_the_numerical_floor_holds_a_turn_that_no_sample_shows():
    ts, fine = 1e-3, 40
    t = np.arange(3000 * fine) * ts / fine
    turns = 40.0 * (2.0 / np.pi) * np.arcsin(np.sin(2.0 * np.pi * 7.3137 * t))
    variant = Variant(P10.hysteresis, (CATALOGUE["backlash"](half_width_um=3.0),))
    slow = Variant(replace(P10.hysteresis, delta2_s=0.0), variant.effects)
    truth = simulate_effects([slow], Record("fine", t, turns, turns, ts_s=ts / fine))[::fine, 0]
    record = Record("run", t[::fine], turns[::fine], truth, ts_s=ts)
    missed_um = float(np.std(truth - simulate_effects([slow], record)[:, 0]))
    floor = numerical_floor(slow, [record])
    assert missed_um > 0.01
    assert floor.turned_um == pytest.approx(missed_um, rel=0.3)
    assert floor.total_um < 2.0 * missed_um


def test_the_numerical_floor_of_a_stretch_is_that_of_the_record_where_it_is_scored():
    t = 1e-3 * np.arange(3000)
    u = 40.0 * np.sin(2.0 * np.pi * (0.5 + 3.0 * t) * t)
    creep = load_effect("creep", "one time constant")(gain=0.2, time_constant_s=1.0)
    variant = Variant(P10.hysteresis, (creep, CATALOGUE["sensor_lag"](time_constant_s=3e-3)))
    whole = Record("run", t, u, u, ts_s=1e-3, error_mask=np.arange(3000) >= 1000)
    stretch = Record("run", t, u, u, ts_s=1e-3).cut(slice(1000, 3000))
    ours, theirs = numerical_floor(variant, [stretch]), numerical_floor(variant, [whole])
    assert ours.total_um == pytest.approx(theirs.total_um, rel=1e-9)


def shaken_record(variant, off_s, ts=1e-3, fine=50):
    """Samples of a plant at times that are off an even clock, as if they were not."""
    k = np.arange(4000)
    taken = k * fine
    taken[1:-1] += np.random.default_rng(3).choice([-1, 1], k.size - 2) * round(off_s / ts * fine)
    t = np.arange(taken[-1] + 1) * ts / fine
    path = 40.0 * np.sin(2.0 * np.pi * 6.3 * t)
    u = np.interp(np.arange(t.size), taken, path[taken])
    y = simulate_effects([variant], Record("fine", t, u, u, ts_s=ts / fine))[taken, 0]
    return Record("run", k * ts, u[taken], y, ts_s=ts, jitter_s=off_s)


@over("off_s", [2e-5, 6e-5, 1.2e-4])
def test_the_numerical_floor_holds_what_uneven_samples_change(off_s):
    lag = CATALOGUE["sensor_lag"](time_constant_s=3e-3)
    variant = Variant(replace(P10.hysteresis, delta2_s=1e-3), (lag,))
    record = shaken_record(variant, off_s)
    step = shaken_record(variant, 0.0)
    wrong = record.y_um - simulate_effects([variant], record)[:, 0]
    coarse = step.y_um - simulate_effects([variant], step)[:, 0]
    missed_um = float(np.std(wrong - coarse))
    floor = numerical_floor(variant, [record])
    assert floor.jittered_um == pytest.approx(missed_um, rel=0.2)
    assert floor.off_s == off_s
    even = numerical_floor(variant, [replace(record, jitter_s=0.0)])
    assert replace(floor, jittered_um=0.0, off_s=0.0) == even
    # what only follows the command has no clock
    still = Variant(replace(P10.hysteresis, delta2_s=0.0), ())
    assert numerical_floor(still, [record]).total_um < 1e-9


def test_a_model_within_the_floor_of_its_clock_is_explained_and_the_clock_is_the_advice():
    variant = Variant(P10.hysteresis, (CATALOGUE["sensor_lag"](time_constant_s=3e-3),))
    record = shaken_record(variant, 1.2e-4)
    setting = Setting((record,), (record,), data_scale([record]))
    floor = numerical_floor(variant, [record])
    assert floor.jittered_um > 3.0 * floor.sampled_um
    noise_um = 0.3 * floor.jittered_um
    found = judge(setting, variant, floor.jittered_um, noise_um, floor, added=True)
    assert found.verdict == "explained"
    assert found.sampling is not None
    assert text_of(found.sampling).startswith(
        "Write time stamps with more digits, or trigger the samples by a clock: stamps that are off "
        "an even one by 120 µs rms change the model by "
    )
    assert found.again.code is Code.CLOCKED
    beyond = judge(setting, variant, 5.0 * floor.jittered_um, noise_um, floor, added=True)
    assert (beyond.verdict, beyond.sampling) == ("unexplained", None)


def test_a_command_held_about_its_samples_is_not_late():
    variant = Variant(P10.hysteresis, (CATALOGUE["sensor_lag"](time_constant_s=5e-3),))
    t = np.arange(4000) * 1e-3
    u = 40.0 * np.sin(2.0 * np.pi * 2.0 * t)
    record = Record("run", t, u, u, ts_s=1e-3)
    a_sample_um = float(np.std(np.diff(simulate_effects([variant], record)[:, 0])))
    assert numerical_floor(variant, [record]).held_um < 0.02 * a_sample_um


def test_repetitions_that_differ_by_motion_do_not_make_the_noise_slow():
    rng = np.random.default_rng(0)
    t = np.arange(4000) * 1e-3
    u = np.sin(2.0 * np.pi * 5.0 * t)
    beat = 0.5 * np.sin(2.0 * np.pi * 0.4 * t) * np.abs(u)
    y = 5.0 * u + beat + NOISE_UM * rng.standard_normal(t.size)
    record = Record("run", t, u, y, ts_s=1e-3)
    floor, _ = noise_floor([], [record], [NOISE_UM * rng.standard_normal(4000)])
    assert floor == pytest.approx(NOISE_UM, rel=0.1)


def test_a_short_part_that_is_held_out_does_not_hide_the_colour_of_the_noise():
    white = np.random.default_rng(2).standard_normal(9001)
    slow = white[1:] + 0.5 * white[:-1]
    assert slowness([slow]) == pytest.approx(slowness([slow[:8000], slow[8000:]]), rel=0.05)
