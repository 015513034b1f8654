"""The noise floor: from quiet records, repetitions and the residual, white noise or not."""

import numpy as np
import pytest
from scipy.signal import lfilter

from rdpi_gym.diagnosis.features.noise import flattened, noise_floor, repeat_noise, rough_part
from rdpi_gym.diagnosis.words import text_of
from rdpi_gym.measurement import Record
from tests.looping import over

TS = 1e-3
NOISE_UM = 0.02


def white(samples, seed=0):
    return NOISE_UM * np.random.default_rng(seed).standard_normal(samples)


def slow(samples, seed=0):
    """Noise through a low-pass of five samples: as from a sensor that is sampled too fast."""
    noise = lfilter([0.2], [1.0, -0.8], np.random.default_rng(seed).standard_normal(samples))
    return NOISE_UM * noise / noise.std()


def quiet(y):
    t = np.arange(y.size) * TS
    return Record("rest", t, np.zeros(y.size), y, ts_s=TS)


def moving(y, samples=8000, **keywords):
    t = np.arange(samples) * TS
    u = np.sin(2 * np.pi * 4.0 * t)
    return Record("sine", t, u, 30.0 * u + 5.0 * u**3 + y, ts_s=TS, **keywords)


def test_rough_part_leaves_out_what_is_smooth():
    smooth = 40.0 * np.sin(2 * np.pi * np.arange(20_000) / 2000)
    assert rough_part(smooth + white(20_000)) == pytest.approx(NOISE_UM, rel=0.03)


@over("drift", [0.0, 1.0])
def test_quiet_record_with_drift_creep_and_hum(drift):
    t = np.arange(8000) * TS
    course = drift * (0.05 * t + 0.1 * np.sin(2 * np.pi * 50.2 * t) + 0.02 * (t - 4.0) ** 2)
    noise = np.std(flattened(quiet(white(8000) + course)), ddof=4)
    assert noise == pytest.approx(NOISE_UM, rel=0.03)


def test_repetitions_are_found_without_being_named():
    drift = 0.3 * np.log10(1.0 + np.arange(8000))
    assert repeat_noise(moving(white(8000) + drift)) == pytest.approx(NOISE_UM, rel=0.05)
    named = moving(white(8000), period=np.arange(8000) // 250)
    assert repeat_noise(named) == pytest.approx(NOISE_UM, rel=0.03)


def test_a_gain_that_drifts_from_one_repetition_to_the_next_is_no_noise():
    drifting = np.sin(2 * np.pi * 4.0 * np.arange(8000) * TS) * np.arange(8000) / 4000
    assert repeat_noise(moving(white(8000) + drifting)) is None
    settled = drifting * (np.arange(8000) < 500)  # one unlike all the others is left out
    assert repeat_noise(moving(white(8000) + settled)) == pytest.approx(NOISE_UM, rel=0.05)


def test_nothing_repeated_is_no_noise():
    t = np.arange(1000) * TS
    assert repeat_noise(Record("ramp", t, t, t, ts_s=TS)) is None


def test_floor_of_white_noise_from_any_of_the_three():
    still, wave = quiet(white(8000, 1)), moving(white(8000, 2))
    for arguments in (([still], [], []), ([], [wave], []), ([], [], [white(8000, 3)])):
        assert noise_floor(*arguments)[0] == pytest.approx(NOISE_UM, rel=0.04)


def test_floor_is_the_smallest_that_is_said():
    bad_model = white(8000, 3) + 0.5 * np.sin(np.arange(8000))
    floor, origin = noise_floor([quiet(white(8000, 1))], [], [bad_model])
    assert floor == pytest.approx(NOISE_UM, rel=0.04)
    assert "the quiet record rest" in text_of(origin)


@over("still", [True, False])
def test_slow_noise_is_not_taken_for_little_noise(still):
    records = [quiet(slow(8000, 1))] if still else []
    residual = slow(8000, 3)
    assert rough_part(residual) < 0.6 * NOISE_UM
    floor, _ = noise_floor(records, [moving(slow(8000, 2))], [residual])
    assert floor == pytest.approx(NOISE_UM, rel=0.12)


def test_too_short_records_say_so():
    floor, origin = noise_floor([], [], [np.zeros(10)])
    assert floor == 0.0
    assert "too short" in text_of(origin)
