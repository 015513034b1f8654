"""Signals that code is tried on."""

import numpy as np

from rdpi_gym.firmware.writing.source import Source
from rdpi_gym.firmware.writing.vectors import vectors, vectors_text
from tests.firmware.hand_made import CONTROLLER, PLANT

REACH = (-20.0, 20.0)


def test_they_are_the_same_every_time_and_stay_nearly_within_reach():
    source = Source(CONTROLLER, REACH)
    one, other = vectors(source), vectors(source)
    assert vectors_text(source, one) == vectors_text(source, other)
    reference, measured = one.inputs["reference_um"], one.inputs["measured_um"]
    assert (len(reference), len(measured), len(one.expected)) == (2001, 2000, 2000)
    assert 20.0 < np.abs(reference).max() < 25.0
    assert np.ptp(one.expected) > 20.0
    assert (np.abs(one.expected) == 25.0).mean() < 0.5
    assert 0.0 < np.abs(measured - reference[:2000]).mean() < 3.0


def test_lanes_differ_and_nearly_all_go_beyond():
    many = vectors(Source(CONTROLLER, REACH), 1000, 50)
    reference = many.inputs["reference_um"]
    assert len(np.unique(reference[500])) == 50
    assert (np.abs(reference).max(axis=0) > 20.0).mean() > 0.5


def test_those_of_a_plant_are_commands():
    made = vectors(Source(PLANT), 300, 2)
    assert made.inputs["command_V"].shape == made.expected.shape == (300, 2)


def test_every_number_reads_back_as_it_was():
    source = Source(PLANT)
    made = vectors(source, 50)
    text = vectors_text(source, made)
    body = text[text.index("rdpi_vector_expected_um") :]
    found = [float(word.partition(")")[0]) for word in body.split("RDPI_V(")[1:]]
    assert found == made.expected[:, 0].tolist()
