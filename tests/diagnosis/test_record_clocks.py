"""A record with another clock than the others is named, and nothing else is."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from rdpi_gym.diagnosis.results import SearchResult
from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.report.discovery_text import lines
from rdpi_gym.virtual_lab import Truth, simulate_dataset
from tests.looping import over

NOISE_UM = 0.012
NAMES = ("triangle-slow", "sine-10hz", "sine-50hz", "sine-100hz-half", "validation-chirp", "quiet")
LAG = CATALOGUE["sensor_lag"](2.4e-4)
BEND = CATALOGUE["asymmetry"](0.02, 40.0)


@cache
def protocol(*effects):
    data = simulate_dataset(Truth(P10, effects, NOISE_UM, 3))
    return replace(data, records=tuple(r for r in data.records if r.name in NAMES))


def stretched(record, factor):
    ts_s = record.ts_s * factor
    return replace(record, ts_s=ts_s, t_s=record.t_s[0] + ts_s * np.arange(record.t_s.size))


def late(record, samples):
    """A displacement that is late by the command: each sample keeps its noise."""
    k = np.arange(record.u_V.size)
    return replace(record, u_V=CubicSpline(k, record.u_V)(np.minimum(k + samples, k[-1])))


def changed(data, name, change):
    return replace(data, records=tuple(change(r) if r.name == name else r for r in data.records))


def clocks(data, *names):
    found = discover(data, catalogue={name: CATALOGUE[name] for name in names})
    return tuple(f.record for f in found.findings if f.kind == "clock")


TWICE = " seems to be written with 2 times its time step: the model"
LATE = " lags the other records by 0.085 ms (1.7 samples): its displacement"


@pytest.mark.slow
@over(
    "name, effects, change, says",
    [
        ("sine-50hz", (), lambda r: stretched(r, 2.0), TWICE),
        ("validation-chirp", (LAG,), lambda r: late(r, 1.7), LATE),
    ],
)
def test_a_record_that_was_fitted_or_not_and_has_another_clock_is_named(
    name, effects, change, says
):
    data = changed(protocol(*effects), name, change)
    found = discover(data, catalogue={e.name: CATALOGUE[e.name] for e in effects})
    assert [c.effect for c in found.added] == [e.name for e in effects]
    (said,) = found.findings
    assert (said.kind, said.record) == ("clock", name)
    assert said.sentence.startswith(name + says)
    # errors are of the record with its clock set right: a wrong time is no missing effect
    assert found.final.validation_rmse_um < 1.15 * NOISE_UM
    assert found.verdict in ("explained", "no missing effect")
    assert found.portrait is None
    assert said.sentence in lines(found)
    assert found.next_experiment == said.next_step
    again = SearchResult.from_dict(found.to_dict())
    assert [f.to_dict() for f in again.findings] == [f.to_dict() for f in found.findings]


@pytest.mark.slow
def test_what_all_records_want_or_none_can_know_is_no_clock():
    assert clocks(protocol(LAG), LAG.name) == ()
    # a delay of the plant, and a bend, that the bare model lacks
    for effect in (CATALOGUE["delay"](1e-4), BEND):
        assert clocks(protocol(effect)) == ()
