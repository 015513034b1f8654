"""How much a program makes of roundings, and what is allowed of it."""

from dataclasses import replace

import numpy as np

from rdpi_gym.firmware.writing.roundings import ALLOWED, ROUGH, Roundings
from rdpi_gym.firmware.writing.source import Source
from rdpi_gym.firmware.writing.vectors import vectors
from tests.firmware.hand_made import CONTROLLER


class Unstable:
    """u(k+1) = 1.5 u(k) + r(k+1), wrapped into the range: roundings grow."""

    def controller(self, reference_um, measured_um):
        u = np.zeros_like(measured_um)
        for k in range(1, len(u)):
            u[k] = (1.5 * u[k - 1] + reference_um[k + 1] + 25.0) % 50.0 - 25.0
        return u


def test_what_makes_much_of_roundings_is_told_so():
    calm, wild = (Source(replace(CONTROLLER, twin=t)) for t in (CONTROLLER.twin, Unstable()))
    assert Roundings.of(calm, vectors(calm)).fine < ROUGH / 3
    assert Roundings.of(calm, vectors(calm)).warning is None
    found = Roundings.of(wild, vectors(wild))
    assert found.fine > 1e6
    assert "times as much of every rounding" in found.warning


def test_what_is_allowed():
    assert Roundings().allowed == ALLOWED
    assert Roundings(1e30).allowed == {64: 1.0, 32: 1.0, 31: 1.0}
    assert 1e-6 < Roundings(1e9).allowed[64] < 1e-4
    assert (Roundings(1e9) | Roundings(1.0, 2.0, True)) == Roundings(1e9, 2.0, True)


def test_single_precision_in_python_is_allowed_for():
    single = replace(CONTROLLER, exact=False, inexact_because="numbers that are float32 in Python")
    found = Roundings.of(Source(single), vectors(Source(single)))
    assert found.single
    assert found.allowed[64] == ALLOWED[32]
    assert Roundings(1.0, 1e3, True).allowed[64] > ALLOWED[32]
