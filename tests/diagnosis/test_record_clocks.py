"""A record with another clock than the others is named, and nothing else is."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rdpi_gym.diagnosis.results import SearchResult
from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.plant import P10
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.report.discovery_text import lines
from rdpi_gym.virtual_lab import Truth, simulate_dataset
from tests.looping import over

NOISE_UM = 0.012
NAMES = (
    "triangle-slow", "sine-10hz", "sine-50hz", "sine-100hz-half", "sine-200hz-quarter",
    "validation-chirp", "quiet",
)  # fmt: skip
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
    k = np.arange(record.y_um.size)
    return replace(record, y_um=np.interp(k - samples, k, record.y_um))


def changed(data, name, change):
    return replace(data, records=tuple(change(r) if r.name == name else r for r in data.records))


def clocks(data, kind=None):
    kinds = {} if kind is None else {kind.name: CATALOGUE[kind.name]}
    return tuple(f for f in discover(data, catalogue=kinds).findings if f.kind == "clock")


@over("name", ["sine-50hz", "validation-chirp"])
@over("effects", [(), (LAG,)])
def test_a_record_that_was_fitted_or_not_and_has_another_clock_is_named(name, effects):
    data = protocol(*effects)
    kind = type(effects[0]) if effects else None
    found = clocks(changed(data, name, lambda r: stretched(r, 2.0)), kind)
    assert [(f.kind, f.record) for f in found] == [("clock", name)]
    assert found[0].sentence.startswith(f"{name} seems to be written with 2 times its time step")
    assert "ts_s in dataset.toml" in found[0].next_step
    found = clocks(changed(data, name, lambda r: late(r, 1.7)), kind)
    assert [(f.kind, f.record) for f in found] == [("clock", name)]
    assert found[0].sentence.startswith(f"{name} lags the other records by 0.085 ms (1.7 samples)")


def test_what_all_records_want_or_none_can_know_is_no_clock():
    assert clocks(protocol()) == ()
    assert clocks(protocol(LAG), type(LAG)) == ()
    # a delay of the plant, and a bend, that the bare model lacks
    for effect in (CATALOGUE["delay"](1e-4), BEND):
        assert clocks(protocol(effect)) == ()
    late_together = protocol()
    moving = tuple(r if r.is_quiet else late(r, 1e-4 / r.ts_s) for r in late_together.records)
    assert clocks(replace(late_together, records=moving)) == ()


@pytest.mark.slow
def test_a_discovery_says_it_and_what_to_check():
    few = {"asymmetry": CATALOGUE["asymmetry"]}
    data = changed(protocol(), "validation-chirp", lambda r: stretched(r, 2.0))
    tasks = set()
    found = discover(data, catalogue=few, progress=lambda task, done, total: tasks.add(task))
    # a record in a wrong time is no reason for another kind of hysteresis, or for a portrait
    assert found.verdict == "unexplained"
    assert "candidates" in tasks
    assert not tasks & {"kinds of hysteresis", "portrait"}
    assert found.left is None
    assert "validation-chirp" in found.remainder
    said = [f for f in found.findings if f.record == "validation-chirp"]
    assert len(said) == 1
    assert said[0].sentence in lines(found)
    assert found.next_experiment == said[0].next_step
    again = SearchResult.from_dict(found.to_dict())
    assert [f.to_dict() for f in again.findings] == [f.to_dict() for f in found.findings]
    quiet = discover(protocol(), catalogue=few)
    assert quiet.findings == ()
