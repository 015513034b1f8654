"""Probabilities over effects: what speaks for an effect, and what is done with one that nothing does."""

from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.diagnosis.probability import (
    LEAST_PROBABLE,
    Calibration,
    Course,
    Probabilities,
    of_classes,
    of_the_package,
    probabilities,
)
from rdpi_gym.diagnosis.results import Candidate, Errors
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_json

ERRORS = Errors(0.01, 0.01, 0.1, {})


def sign(effect, share, confidence=1.0, alike=()):
    return Candidate(effect, ERRORS, {}, {}, confidence, share, tuple(alike), "")


def course(*added, left=1.0, tried=(), base=10.0):
    return Course(0.01 * base, 0.01 * left, 0.01, added, (*added, *tried))


def test_an_effect_that_takes_all_and_leaves_the_noise_is_nearly_certain():
    found = probabilities(course(sign("creep", 0.999), base=20.0), {})
    assert found.effects["creep"] > 0.9
    assert found.probable[0] == "creep"
    assert found.other < 0.05
    assert found.none < 0.05


def test_what_takes_little_and_leaves_much_is_less_probable_than_not():
    doubtful = course(sign("creep", 0.1), left=5.0)
    assert of_classes(doubtful)[0] < LEAST_PROBABLE
    found = probabilities(doubtful, {})
    sure = probabilities(course(sign("creep", 0.999)), {})
    assert found.effects["creep"] < sure.effects["creep"]
    assert found.other > 5 * sure.other


def test_rivals_that_fit_as_well_share_the_probability_of_a_name():
    alone = probabilities(course(sign("delay", 0.98)), {})
    beside = probabilities(course(sign("delay", 0.98, alike=("sensor_lag", "actuator_lag"))), {})
    assert beside.effects["delay"] < alone.effects["delay"]
    assert beside.classes["delay"] == alone.classes["delay"]


def test_the_kin_of_what_was_added_is_more_probable_than_others():
    went = course(sign("delay", 0.98), tried=(sign("sensor_lag", 0.0), sign("backlash", 0.0)))
    found = probabilities(went, {"sensor_lag": {"delay"}})
    assert found.effects["sensor_lag"] > 2 * found.effects["backlash"]


def test_kin_that_leaves_more_in_its_place_is_no_longer_probable():
    kin = {"sensor_lag": {"delay"}}

    def set_with(share, left=1.0):
        went = course(sign("delay", 0.999), left=left, tried=(sign("sensor_lag", share),))
        return probabilities(went, kin).probable

    assert set_with(0.998) == ("delay", "sensor_lag")
    assert set_with(0.9) == ("delay",)  # three noise floors in the place of a delay
    assert "sensor_lag" in set_with(0.9, left=3.0)  # where much is left, both may be there


def test_where_nothing_was_added_and_the_noise_is_left_nothing_is_missing():
    quiet = probabilities(course(tried=(sign("creep", 0.01),), base=1.0), {})
    assert quiet.none > 0.7
    assert quiet.effects["creep"] < 0.1
    loud = probabilities(course(left=8.0, base=8.0), {})
    assert loud.none < quiet.none
    assert loud.other > 0.5


def test_scales_do_not_matter():
    went = course(sign("creep", 0.9), left=2.0, tried=(sign("delay", 0.2),))
    larger = replace(went, base_um=1e4 * went.base_um, end_um=1e4 * went.end_um, floor_um=100.0)
    assert probabilities(larger, {}) == probabilities(went, {})


def test_extremes_give_numbers():
    for share in (-np.inf, -1e9, 0.0, 1.0, 1e9):
        found = probabilities(Course(1e9, 1e9, 0.0, (sign("creep", share),), ()), {})
        assert 0.0 < found.effects["creep"] < 1.0


def test_the_package_has_a_calibration_that_survives_its_file(tmp_path):
    own = of_the_package()
    path = write_json(tmp_path / "probabilities.json", own.to_dict())
    assert Calibration.load(path) == own
    path.write_text(path.read_text().replace('"least"', '"most"'))
    with pytest.raises(InputError, match="least"):
        Calibration.load(path)


def test_what_is_saved_is_read_again():
    found = probabilities(course(sign("creep", 0.9), tried=(sign("delay", 0.2),)), {})
    assert Probabilities.from_dict(found.to_dict()) == found
