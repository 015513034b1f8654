"""What is no measurement is found, said and left out; what is one is left alone."""

import time
from dataclasses import replace

import numpy as np
import pytest

import rdpi_gym as rg
from rdpi_gym.diagnosis.preprocessing import inspect, opening, stretches
from rdpi_gym.diagnosis.preprocessing.command import rebuilt_command
from rdpi_gym.diagnosis.suitability import limits
from rdpi_gym.diagnosis.words import text_of
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import Plant, named_plant, settled_memory
from tests.looping import over

TS_S = 1e-3


def noisy(y, noise_um=0.012, seed=1):
    return y + noise_um * np.random.default_rng(seed).standard_normal(y.size)


def record(u, name="run", noise_um=0.012, ts_s=TS_S, plant="P10"):
    y = Plant(named_plant(plant), ts_s).simulate(u)
    return Record(name, np.arange(u.size) * ts_s, u, noisy(y, noise_um), ts_s=ts_s)


def sine(samples=6000, amplitude_V=25.0, frequency_hz=2.0, ts_s=TS_S):
    return amplitude_V * np.sin(2 * np.pi * frequency_hz * np.arange(samples) * ts_s)


def changed(run, y=None, u=None):
    return replace(run, y_um=run.y_um if y is None else y, u_V=run.u_V if u is None else u)


def looked(*records):
    return inspect(Dataset("made of known plants", records))


def kinds(inspected):
    return [finding.kind for finding in inspected.findings]


@pytest.fixture(scope="module")
def protocols():
    """The standard protocol on plants with unlike effects hidden."""
    return [
        rg.simulate("P10", hide=hide, seed=seed)
        for seed, hide in enumerate([None, "saturation", "resonance", "creep", "backlash"])
    ]


@pytest.mark.slow
def test_nothing_is_found_on_any_record_of_the_standard_protocol(protocols):
    for data in protocols:
        found = inspect(data)
        assert found.findings == ()
        for before, after in zip(data.records, found.dataset.records, strict=True):
            assert after.error_mask.all()
            assert np.array_equal(before.y_um, after.y_um)


def test_the_standard_protocol_has_no_limit_that_is_worth_saying(protocols):
    assert all(limits(data) == () for data in protocols)


def test_a_hundred_thousand_samples_are_looked_through_in_a_second(protocols):
    inspect(protocols[0])
    taken = []
    for _ in range(3):
        start = time.process_time()
        inspect(protocols[0])
        taken.append(time.process_time() - start)
    samples = sum(r.t_s.size for r in protocols[0].records)
    assert min(taken) < samples / 100_000


def test_spikes_of_one_sample_or_two_are_found_and_nothing_else():
    run = record(sine())
    at = np.random.default_rng(3).choice(np.arange(20, 5980), 60, replace=False)
    at[:10] = at[10:20] + 1
    y = run.y_um.copy()
    y[np.unique(at)] += 2.0
    found = looked(changed(run, y))
    assert kinds(found) == ["spikes"]
    assert np.array_equal(np.flatnonzero(~found.dataset.records[0].error_mask), np.unique(at))
    assert found.findings[0].samples == np.unique(at).size
    assert found.findings[0].sentence.startswith(f"{np.unique(at).size} samples (")
    # the trace is bridged there, so that nothing that looks at all of it is misled
    assert np.max(np.abs(found.dataset.records[0].y_um - run.y_um)) < 0.4


STAIRS = np.repeat([0.0, 5.0, -5.0, 2.0, 0.0, 7.0], 1000)
AGE = np.arange(6000) % 1000
ORDINARY = {
    "steps": (STAIRS, STAIRS),
    "corners": (SAW := 8.0 * np.abs((np.arange(6000) / 250.0) % 2.0 - 1.0), SAW),
    "ringing": (STAIRS, STAIRS + 3.0 * np.exp(-AGE / 80.0) * np.cos(0.7 * AGE)),
    "near Nyquist": (FAST := 5.0 * np.sin(np.arange(6000) * 2.0), FAST),
    "coarse": (sine(), 0.5 * np.round(sine() / 5.0 / 0.5)),
    "hum": (sine(), sine() / 5.0 + 0.5 * np.sin(2 * np.pi * 50.0 * np.arange(6000) * TS_S)),
}


@over("case", list(ORDINARY))
@over("noise_um", [0.0, 0.01])
def test_steps_corners_ringing_coarse_steps_and_hum_are_no_faults(case, noise_um):
    u, y = ORDINARY[case]
    run = Record("run", np.arange(6000) * TS_S, u, noisy(y, noise_um), ts_s=TS_S)
    assert kinds(looked(run)) == []


def test_a_sensor_that_drops_out_is_left_out_with_a_margin():
    run = record(sine())
    y = run.y_um.copy()
    y[1000:1050] = 0.0
    found = looked(changed(run, y))
    assert kinds(found) == ["dropout"]
    left_out = np.flatnonzero(~found.dataset.records[0].error_mask)
    assert left_out[0] in range(995, 1001)
    assert left_out[-1] in range(1049, 1055)


@over("step_um", [0.0, 0.05])
def test_a_frozen_displacement_is_left_out(step_um):
    run = record(sine())
    y = run.y_um.copy()
    y[1000:1100] = y[1000]
    if step_um:
        y = step_um * np.round(y / step_um)
    found = looked(changed(run, y))
    assert kinds(found) == ["frozen"]
    assert not found.dataset.records[0].error_mask[1002:1098].any()


def test_a_stage_that_rests_behind_a_coarse_converter_is_not_frozen():
    u = np.repeat([0.0, 10.0, -10.0, 5.0], 1500)
    run = record(u)
    assert kinds(looked(changed(run, 0.1 * np.round(run.y_um / 0.1)))) == []


def test_a_stage_with_lost_motion_and_no_noise_is_not_frozen():
    u = sine()
    y = u.copy()
    for k in range(1, y.size):
        y[k] = min(max(y[k - 1], u[k] - 4.0), u[k] + 4.0)
    assert kinds(looked(Record("gap", np.arange(6000) * TS_S, u, y, ts_s=TS_S))) == []


@over("upper", [True, False])
def test_a_converter_that_clips_is_left_out(upper):
    run = record(sine())
    rail = 20.0 if upper else -20.0
    y = np.minimum(run.y_um, rail) if upper else np.maximum(run.y_um, rail)
    found = looked(changed(run, y))
    assert kinds(found) == ["clipped output"]
    assert not found.dataset.records[0].error_mask[y == rail].any()
    assert found.dataset.records[0].error_mask.sum() > 0.7 * y.size


def test_a_rail_is_that_of_its_own_record_and_of_those_that_end_there_too():
    low, high, same = (
        record(sine(amplitude_V=a), name) for a, name in ((25, "a"), (30, "b"), (25, "c"))
    )
    rail = float(np.quantile(low.y_um, 0.97))
    low, same = (changed(r, y=np.minimum(r.y_um, rail)) for r in (low, same))
    found = looked(low, high, same)
    assert [(f.kind, f.record) for f in found.findings] == [("clipped output", r) for r in "ac"]
    assert found.dataset.records[1].error_mask.all()


def test_a_level_that_clips_while_the_command_rests_is_left_out():
    steps = record(np.repeat([0.0, 10.0, 25.0, -5.0, 25.0, 0.0], 800))
    rail = float(np.mean(steps.y_um[2000:2300])) - 0.5
    found = looked(changed(steps, y=np.minimum(steps.y_um, rail)))
    assert kinds(found) == ["clipped output"]
    assert not found.dataset.records[0].error_mask[1700:2300].any()


def test_an_amplifier_that_saturates_is_no_converter():
    clipped = np.clip(sine(), -15.0, 15.0)
    run = record(clipped)
    assert kinds(looked(changed(run, u=sine()))) == []


def test_a_command_that_was_clipped_in_the_recorder_is_left_out():
    run = record(sine())
    recorded = np.clip(run.u_V, -15.0, 15.0)
    found = looked(changed(run, u=recorded))
    assert kinds(found) == ["clipped input"]
    assert np.array_equal(~found.dataset.records[0].error_mask, np.abs(recorded) == 15.0)


def test_every_stretch_of_a_clipped_command_is_left_out_however_short():
    t = np.arange(6000) * TS_S
    u = 20.0 * np.sin(2 * np.pi * 2.0 * t) + 5.05 * np.sin(2 * np.pi * 0.7 * t)
    run = record(u)
    recorded = np.minimum(u, 16.0)
    found = looked(changed(run, u=recorded))
    assert np.array_equal(~found.dataset.records[0].error_mask, recorded == 16.0)


def multisine(samples=6000):
    t, rng = np.arange(samples) * TS_S, np.random.default_rng(3)
    waves = [np.sin(2 * np.pi * f * t + rng.uniform(0, 6.3)) for f in (0.7, 1.9, 3.1, 5.3, 8.9)]
    return 10.0 * np.sum(waves, axis=0)


@over("hidden", [(), ("actuator_lag", 0.004), ("sensor_lag", 0.004)])
def test_a_clipped_command_is_rebuilt_to_a_thirtieth_of_what_was_lost(hidden):
    effects = (rg.effects[hidden[0]](hidden[1]),) if hidden else ()
    u = multisine()
    y = Plant(replace(named_plant("P10"), effects=effects), TS_S).simulate(u)
    recorded = np.clip(u, *np.quantile(u, [0.04, 0.96]))
    run = Record("run", np.arange(u.size) * TS_S, recorded, noisy(y), ts_s=TS_S)
    found = looked(run)
    rebuilt = found.dataset.records[0].u_V
    lost = recorded != u
    assert kinds(found) == ["clipped input"]
    assert "rebuilt from the displacement" in found.findings[0].sentence
    assert np.array_equal(rebuilt[~lost], u[~lost])
    assert np.std((rebuilt - u)[lost]) < np.std((recorded - u)[lost]) / 30.0


def test_a_displacement_that_does_not_tell_the_command_rebuilds_nothing():
    u = multisine()
    run = Record("run", np.arange(u.size) * TS_S, u, multisine()[::-1].copy(), ts_s=TS_S)
    assert rebuilt_command(run, u > 0.9 * u.max(), np.zeros(u.size, dtype=bool)) is None


def test_a_command_that_rests_at_its_extreme_is_not_clipped():
    trapezium = np.clip(sine(), -15.0, 15.0)
    run = record(trapezium)
    assert kinds(looked(run)) == []
    # the stage creeps on, and rings
    creeping = Plant(replace(named_plant("P10"), effects=(rg.effects["creep"](0.03),)), TS_S)
    assert kinds(looked(changed(run, noisy(creeping.simulate(trapezium))))) == []
    ringing = Plant(
        replace(named_plant("P10"), effects=(rg.effects["resonance"](60.0, 0.05),)), TS_S
    )
    assert kinds(looked(changed(run, noisy(ringing.simulate(trapezium))))) == []


def late(y, samples):
    """What is recorded some samples late (or early); at the ends it stands still."""
    return y[np.clip(np.arange(y.size) - samples, 0, y.size - 1)]


def shifted(data, samples):
    records = tuple(replace(r, y_um=late(r.y_um, samples)) for r in data.records)
    return Dataset(data.title, records)


def test_a_displacement_that_leads_by_a_sample_is_moved(protocols):
    for data in protocols:
        found = inspect(shifted(data, -1))
        assert [(f.kind, f.sentence[:8]) for f in found.findings] == [("clock", "1 sample")]
        for truth, record in zip(data.records, found.dataset.records, strict=True):
            if not record.is_quiet:
                assert np.array_equal(truth.y_um[1:], record.y_um[1:])
                assert not record.error_mask[0]


def test_one_record_with_another_clock_is_moved_alone():
    runs = [record(sine(frequency_hz=f), name) for f, name in ((1.0, "a"), (2.0, "b"))]
    runs[1] = changed(runs[1], late(runs[1].y_um, -3))
    found = looked(*runs)
    assert [(f.kind, f.record) for f in found.findings] == [("clock", "b")]
    assert found.findings[0].sentence.startswith("3 samples")


def test_what_is_late_by_a_sample_in_every_record_is_no_delay(protocols):
    found = inspect(shifted(protocols[0], 1))
    assert kinds(found) == ["clock"]
    assert "late in every record" in found.findings[0].sentence
    assert all(r.error_mask.all() for r in found.dataset.records)


@over("effect", ["delay", "sensor_lag", "actuator_lag"])
def test_what_the_plant_lags_is_no_clock(effect):
    assert inspect(rg.simulate("P10", hide=effect, seed=4)).findings == ()


def test_a_record_that_begins_in_motion_is_said_and_still_counts():
    running = record(sine(8000))
    cut = slice(1700, None)
    run = Record("run", running.t_s[cut], running.u_V[cut], running.y_um[cut], ts_s=TS_S)
    found = looked(run)
    assert kinds(found) == ["in motion"]
    assert found.dataset.records[0].error_mask.all()
    start = found.openings["run"]
    assert 250 < start.sum() <= 500
    assert start[: int(start.sum())].all()


def test_what_came_before_a_record_adds_an_offset_to_each_stretch_and_nothing_else():
    t = np.arange(10_000) * 1e-3
    wave = np.sin(2 * np.pi * t)
    plant = Plant(named_plant("P10"), 1e-3)
    thresholds_V = named_plant("P10").hysteresis.thresholds_V
    low, high = thresholds_V[1], thresholds_V[-1]
    for reach in (np.ones(t.size), np.where(t < 2.0, 0.5, np.where(t < 7.0, 0.92, 1.0))):
        u = 1.2 * high * wave * reach
        responses = []
        for turns in ((), (2.0 * high, -low), (-2.0 * high, high)):
            plant.reset(memory=settled_memory(thresholds_V, turns))
            responses.append(plant.simulate(u))
        masks = stretches(Record("run", t, u, u, ts_s=1e-3))
        assert sum(mask.sum() for mask in masks) >= 0.75 * t.size
        for other in responses[1:]:
            apart = other - responses[0]
            assert np.ptp(apart) > 1.0
            for mask in masks:
                assert np.ptp(apart[mask]) < 0.02 * np.ptp(responses[0])


def test_an_opening_lasts_until_the_longest_stretch_in_which_the_range_grows_no_more():
    t = np.arange(10_000) * 1e-3

    def ended(u):
        start = opening(Record("run", t, u, u, ts_s=1e-3))
        return 0 if start is None else int(start.sum())

    wave = np.sin(2 * np.pi * t)
    assert 700 < ended(wave) <= 750  # the trough
    late = wave * np.where(t < 2.0, 0.5, np.where(t < 7.0, 0.92, 1.0))
    assert 2600 < ended(late) <= 2750
    # more than a quarter of a record is not left out where its range ends to grow in time
    assert ended(wave * np.minimum(t / 4.0, 1.0)) < 5000


def test_a_record_that_begins_at_rest_is_not_in_motion():
    assert kinds(looked(record(sine()))) == []
    turned_on = 25.0 * np.cos(2 * np.pi * 2.0 * np.arange(6000) * TS_S + 0.8)
    assert kinds(looked(record(turned_on))) == []


def test_what_one_record_cannot_tell_is_said():
    said = " ".join(text_of(each) for each in limits(Dataset("one", (record(sine()),))))
    limits_of_one = (
        "One record",
        "One frequency (2 Hz)",
        "One amplitude",
        "No rest",
        "No small-amplitude",
    )
    for words in limits_of_one:
        assert words in said
    assert "No repetition" not in said
    assert "300 samples" in " ".join(
        text_of(each) for each in limits(Dataset("short", (record(sine(400)),)))
    )
