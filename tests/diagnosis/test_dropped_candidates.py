"""A candidate without a fit is dropped with a remark; the search ends with the others."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

import rdpi_gym as rg
from rdpi_gym.diagnosis.search import discover as diagnosis
from rdpi_gym.diagnosis.search.plants import on_comb
from rdpi_gym.identification import joint
from rdpi_gym.identification.cores import fit_core
from rdpi_gym.identification.kinds import choose_kind
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import CORES
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.support.errors import InputError
from tests.looping import over

FAILURES = [
    InputError("weights are below 0 µm/V"),
    FloatingPointError("overflow"),
    ValueError("array must not contain infs or NaNs"),
    OverflowError("math range error"),
    np.linalg.LinAlgError("singular matrix"),
]
BEGUN = joint._begun
FEW = {name: CATALOGUE[name] for name in ("creep", "delay", "sensor_lag")}


@pytest.fixture(scope="module")
def creeping():
    data = rg.simulate("P5", "creep", seed=1, ts_factor=4.0)
    return data.select("sine-10hz", "validation-loops")


@pytest.fixture(scope="module")
def leaning():
    """Return records of which much is left that no effect of FEW explains."""
    t = np.arange(600) * 4e-3
    both = []
    for name, role, rate_hz in (("a", "train", 1.0), ("b", "validation", 1.7)):
        u = 20.0 * np.sin(2.0 * np.pi * rate_hz * t) * np.linspace(0.3, 1.0, t.size)
        y = 0.6 * u + 4e-3 * u**2 + 3.0 * np.tanh(u / 5.0) - 2.0 * np.roll(np.tanh(u / 8.0), 5)
        y += np.random.default_rng(0).normal(0.0, 2e-3, t.size)
        both.append(Record(name, t, u, y, ts_s=4e-3, role=role))
    return Dataset("leaning", tuple(both))


class Fault:
    """Raise where fits begin, as often as asked; count them."""

    def __init__(self, error, is_meant):
        self.error, self.is_meant, self.calls, self.raised = error, is_meant, 0, 0

    def __call__(self, records, start, effects, *rest):
        self.calls += 1
        if self.is_meant(self, start, effects):
            self.raised += 1
            raise type(self.error)(*self.error.args)
        return BEGUN(records, start, effects, *rest)


@pytest.fixture
def fault(monkeypatch):
    def install(error=None, is_meant=lambda fault, start, effects: False):
        made = Fault(error, is_meant)
        monkeypatch.setattr(joint, "_begun", made)
        return made

    return install


def at_call(place, fault, start, effects):
    return fault.calls == place


def with_effect(name, fault, start, effects):
    return any(effect.name == name for effect in effects)


def of_core(name, fault, start, effects):
    return start.name == name


@over("error", FAILURES)
def test_a_candidate_without_a_fit_is_dropped_with_a_remark(creeping, fault, error):
    made = fault(error, partial(with_effect, "delay"))
    found = diagnosis.diagnose(creeping, catalogue=FEW)
    assert made.raised
    ranked = {candidate.effect: candidate for candidate in found.rounds[0]}
    assert ranked.keys() == FEW.keys()
    assert ranked["delay"].remarks == (f"did not converge: {type(error).__name__}: {error}",)
    assert [name for step in found.steps for name in step.effects] == ["creep"]


def test_a_fault_of_the_program_is_no_candidate(creeping, fault):
    fault(TypeError("unsupported operand"), partial(with_effect, "delay"))
    with pytest.raises(TypeError, match="unsupported operand"):
        diagnosis.diagnose(creeping, catalogue=FEW)


class Mine(CATALOGUE["delay"]):
    """An effect of a user's own."""

    name = "mine"


def test_an_effect_of_a_user_may_raise_anything(creeping, fault):
    made = fault(RuntimeError("no licence"), partial(with_effect, "mine"))
    found = diagnosis.diagnose(creeping, catalogue=FEW | {"mine": Mine})
    assert made.raised
    ranked = {candidate.effect: candidate for candidate in found.rounds[0]}
    assert ranked["mine"].remarks == ("did not converge: RuntimeError: no licence",)
    assert [name for step in found.steps for name in step.effects] == ["creep"]


@pytest.mark.slow
def test_wherever_one_fit_fails_the_search_ends(creeping, fault):
    whole = fault()
    diagnosis.discover(creeping, catalogue=FEW)
    for place in np.unique(np.geomspace(2, whole.calls, 4).astype(int)):
        made = fault(FAILURES[place % len(FAILURES)], partial(at_call, place))
        assert diagnosis.discover(creeping, catalogue=FEW).plant is not None
        assert made.raised == 1


@pytest.mark.slow
def test_all_later_refits_may_fail(creeping, fault):
    whole = fault()
    diagnosis.diagnose(creeping, catalogue=FEW)
    ranked = whole.calls // 2
    fault(FAILURES[0], lambda fault, start, effects: fault.calls > ranked)
    assert diagnosis.discover(creeping, catalogue=FEW).plant is not None


def test_the_base_model_says_why_it_has_no_fit(creeping, fault):
    fault(InputError("record run: no sample counts"), lambda *_: True)
    with pytest.raises(InputError, match=r"^record run: no sample counts$"):
        diagnosis.discover(creeping, catalogue=FEW)


def test_a_kind_without_a_fit_is_left_out(leaning, fault):
    fault(FAILURES[1], partial(of_core, "dahl"))
    found = choose_kind(leaning)
    assert found.refused["dahl"] == "overflow"
    assert "dahl" not in {fit.plant.hysteresis.name for fit in found.fits}
    asked = diagnosis.diagnose(leaning, catalogue=FEW, core="auto")
    assert "the core dahl was left out: overflow" in asked.notes


def test_the_model_itself_may_be_the_kind_without_a_fit(leaning, fault):
    fault(FAILURES[1], partial(of_core, "rdpi"))
    found = diagnosis.diagnose(leaning, catalogue=FEW, core="auto")
    assert found.plant.hysteresis.name != "rdpi"


@pytest.mark.slow
def test_an_addition_without_a_fit_is_refused(creeping, fault):
    model = diagnosis.diagnose(creeping, catalogue={}).plant
    fault(FAILURES[2], partial(with_effect, "delay"))
    with pytest.raises(InputError, match=r"^delay: did not converge: ValueError: array must not"):
        diagnosis.add_effect(creeping, CATALOGUE["delay"], model)


def test_no_portrait_without_blocks(leaning, fault):
    fault(FAILURES[3], partial(with_effect, "unknown"))
    found = diagnosis.diagnose(leaning, catalogue=FEW)
    assert found.portrait is None
    assert any(note.startswith("no portrait of what is missing") for note in found.notes)


@over("name", ["stop", "rdpi"])
def test_a_comb_for_wider_records_loses_no_weight(name):
    """A search that judges within all records meets a wider comb: no threshold of it was there before."""
    t = np.arange(2000) * 1e-3
    records = [
        Record(f"{reach:g}", t, u := reach * np.sin(9.0 * t), u + np.tanh(u), ts_s=1e-3)
        for reach in (3.0, 5.0)
    ]
    core = CORES[name].comb(data_scale(records[:1]))
    if name == "stop":  # a line that falls, steeper than any weight but less than their sum
        core = core.with_gains([-0.9 * sum(core.weights), *core.weights])
    wider = on_comb(core, records)
    assert wider.thresholds_V == CORES[name].comb(data_scale(records)).thresholds_V
    assert sum(wider.gains) == pytest.approx(sum(core.gains))


def test_a_start_of_a_core_without_a_fit_is_left_out(leaning, monkeypatch):
    kind = CORES["bouc_wen"]
    from rdpi_gym.identification import cores

    searched = cores._Problem.searched
    first = kind.starts(data_scale(leaning.train))[0]

    def failing(self, start, steps):
        if start == first:
            raise ValueError("residuals are not finite")
        return searched(self, start, steps)

    monkeypatch.setattr(cores._Problem, "searched", failing)
    assert np.isfinite(fit_core(leaning, kind).train_rmse_um)
    monkeypatch.setattr(cores._Problem, "searched", lambda *_: 1 / 0)
    with pytest.raises(InputError, match="core bouc_wen: division by zero"):
        fit_core(leaning, kind)
