"""The C of every controller against the one that a benchmark makes and scores."""

import pytest

from rdpi_gym.plant import P10
from studies.firmware_truth import cases, measure
from tests.firmware.programs import needs_compiler

SHARE = 1e-9
"""Largest difference in double, in ranges of the command."""


@needs_compiler
@pytest.mark.slow
def test_the_field_is_the_scored_one_over_100_000_samples():
    asked = (case for case in cases() if case.controller and case.model is P10)
    field = [case for case in asked if not case.controller.startswith("learned:")]
    table = measure(field, records=100, seed=1)
    found = table[table["verdict"] != "no C"]
    assert len(found) >= len(field) - 1  # h-infinity asks for a package that is not everywhere
    assert (found["double"] <= SHARE).all(), found[["what", "double"]]
